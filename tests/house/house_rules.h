#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace patina::test {

/// One place that breaks a house rule.
struct Violation {
  std::string file;  ///< relative to the root
  int line = 0;      ///< from 1; 0: the file as a whole
  std::string rule;  ///< a sentence for whoever reads the failing test
};

/// "file:line: rule", one a line; what a failing test prints.
std::string describe(const std::vector<Violation>& violations);

/// Source files (C++ headers, sources and .inc) below app, devices, engine, tests and widgets, sorted,
/// relative to `root`.
std::vector<std::filesystem::path> sourceFiles(const std::filesystem::path& root);

/// Every `#include` that climbs, is not written from the root, names a file that isn't there, or names a
/// library that the room may not know. The table of rooms is in CONTRIBUTING.md; the code form of it stands
/// in the .cpp.
std::vector<Violation> checkIncludes(const std::filesystem::path& root);

/// CMake files that link what no program of ours may carry: Qt 5, OpenCV's highgui, VTK's Qt module.
std::vector<Violation> checkLinkedModules(const std::filesystem::path& root);

/// Source files longer than `maxLines`.
std::vector<Violation> checkLengths(const std::filesystem::path& root, int maxLines);

/// Text files that name a place on somebody's own machine: an absolute path into a home, work or temporary
/// folder.
std::vector<Violation> checkForeignPaths(const std::filesystem::path& root);

/// Identifiers that mean different things to different people (`wi`, `wo`, bare `roughness`), outside
/// comments and strings.
std::vector<Violation> checkNames(const std::filesystem::path& root);

/// `source` with comments, string and character literals blanked out, line breaks kept.
std::string withoutCommentsAndStrings(const std::string& source);

/// Libraries in the output of `ldd` that no program of ours may load, e.g. "libQt5Core.so.5".
std::vector<std::string> forbiddenLibraries(const std::string& lddOutput);

}  // namespace patina::test
