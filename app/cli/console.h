#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>

#include "engine/base/job.h"
#include "engine/base/result.h"

namespace patina::cli {

/// The terminal: results go to stdout; progress, notes and failures to stderr. On a terminal progress is one
/// line that rewrites itself; in a pipe or a file, one line a stage; with `json`, one object a line: progress
/// as
/// {"stage", "done", "total", "unit"}, a failure as {"error": {"what", "where", "try"}} (and notes then go to
/// stdout, so that stderr stays readable by programs). Only what is wrong with the command line itself, found
/// before the style of the output is known, is always plain text. Threading: any.
class Console : public ProgressSink, public LogSink {
 public:
  Console();
  void useJson(bool json);

  void progress(std::string_view stage, std::int64_t done, std::int64_t total,
                std::string_view unit) override;
  void log(Level level, std::string_view sentence) override;

  /// A line of the result, to stdout.
  void say(std::string_view line);
  /// A failure, to stderr.
  void complain(std::string_view line);
  /// The same with its parts known; `prefix` ("Error: ") is for people.
  void complain(std::string_view prefix, const Error& error);
  /// Takes the progress line away, if there is one.
  void finishProgress();

 private:
  using Clock = std::chrono::steady_clock;
  void clearLine();
  void drawLine(std::int64_t done, std::int64_t total, std::string_view unit, Clock::time_point now);

  std::mutex mutex_;
  bool json_ = false;
  bool terminal_ = false;
  bool lineShown_ = false;
  std::string stage_;
  std::int64_t last_ = -1;
  Clock::time_point stageStart_, lastShown_;
};

}  // namespace patina::cli
