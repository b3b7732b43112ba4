#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/result.h"

namespace patina {

/// The diary of a capture: lines of JSON, each whole and flushed to the disk before `append` returns. A last
/// line that a crash cut off is dropped when it is opened again. Threading: one thread.
class CaptureJournal {
 public:
  /// Opens or makes it. `lines` of what is there. Errors: Malformed (damaged before its last line, which no
  /// crash does: line named), WriteFailed.
  static Result<CaptureJournal> open(const std::filesystem::path& file);
  CaptureJournal(CaptureJournal&&) noexcept;
  CaptureJournal& operator=(CaptureJournal&&) noexcept;
  ~CaptureJournal();

  const std::vector<nlohmann::json>& lines() const { return lines_; }
  /// Errors: WriteFailed; what a failed write left is dropped by the next one.
  Status append(const nlohmann::json& line);

 private:
  CaptureJournal() = default;
  int descriptor_ = -1;
  std::uint64_t length_ = 0;
  std::filesystem::path file_;
  std::vector<nlohmann::json> lines_;
};

/// Removes what a killed process left half written (hidden neighbours of `writeFileAtomically`) in a folder,
/// not below it. For folders that are one capture's own.
void removeHalfWritten(const std::filesystem::path& folder);

/// Its name in a capture's folder.
inline constexpr const char* kCaptureJournal = "journal.jsonl";

/// The journal of a capture's folder, made with its `photos/` where it is new; what a killed process left
/// half written there is removed. Errors: Refused (a capture was begun there and `resume` is false, or the
/// folder holds something else), WriteFailed, and those of `CaptureJournal::open`.
Result<CaptureJournal> beginCapture(const std::filesystem::path& folder, bool resume);

/// Hash of a file's bytes, as 16 hexadecimal digits (XXH3, 64 bits). Errors: as `readFile`.
Result<std::string> fileHash(const std::filesystem::path& file);

}  // namespace patina
