#pragma once

#include <functional>
#include <string>
#include <vector>

namespace patina::test {

struct Finished {
  int status = -1;  ///< exit status; 128 + signal where one ended it
  std::string out, err;
};

struct RunOptions {
  long fileSizeLimit = -1;  ///< bytes that a file may have; -1: as many as it likes
  std::function<int(const std::string& err)>
      watch;                ///< sees stderr as it grows; a number above 0 is sent as a signal, once
  int secondsAtMost = 120;  ///< then the program is killed
};

/// Runs a program to its end, without a terminal.
Finished runProgram(const std::vector<std::string>& command, const RunOptions& options = {});

}  // namespace patina::test
