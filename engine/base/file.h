#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "engine/base/result.h"

namespace patina {

/// The whole content of a regular file. Errors: NotFound (nothing there, or a folder), Malformed (over
/// `maxBytes`), Refused (a device or pipe, which might never end, or no permission). Threading: any. Cost:
/// one read.
Result<std::string> readFile(const std::filesystem::path& file, std::uint64_t maxBytes);

/// A regular file, open for reading at any place. Movable. Threading: any number of reads at a time.
class RandomAccessFile {
 public:
  /// Errors as `readFile`.
  static Result<RandomAccessFile> open(const std::filesystem::path& file, std::uint64_t maxBytes);
  RandomAccessFile(RandomAccessFile&& other) noexcept;
  RandomAccessFile& operator=(RandomAccessFile&& other) noexcept;
  ~RandomAccessFile();

  /// Length when it was opened.
  std::uint64_t size() const { return size_; }
  /// Fills `to` from byte `at` on; false where the file ends before or the disk fails.
  bool read(std::uint64_t at, char* to, std::size_t count) const;

 private:
  RandomAccessFile(int descriptor, std::uint64_t size) : descriptor_(descriptor), size_(size) {}
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
};

}  // namespace patina
