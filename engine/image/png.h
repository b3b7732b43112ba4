#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "engine/base/result.h"
#include "engine/image/image.h"
#include "engine/image/image_size.h"

namespace patina {

/// Reads a PNG of 1 to 16 bits as R, G, B floats in 0..1, still encoded as in the file: no gamma is undone
/// and colour profiles are ignored (grey is repeated, palettes are looked up, opacity is dropped). With
/// `expected`, another size is refused before pixels take memory. Errors as `readExr`. Threading: any.
Result<Image> readPng(const std::filesystem::path& file, std::optional<ImageSize> expected = {});

/// The same from bytes in memory; `where` names them in errors.
Result<Image> readPngBytes(std::string_view bytes, const std::string& where,
                           std::optional<ImageSize> expected = {});

/// Reads a PNG from top to bottom, some rows at a time, as codes of 16 bits (an 8-bit code times 257). The
/// picture is never in memory as a whole, unless it is interlaced. Movable. Threading: one thread at a time.
class PngRows {
 public:
  /// Errors as `readPng`.
  static Result<PngRows> open(const std::filesystem::path& file, const std::string& where,
                              ImageSize expected);
  PngRows(PngRows&&) noexcept;
  PngRows& operator=(PngRows&&) noexcept;
  ~PngRows();

  /// The next rows, [row][x][R G B]; as many as `out` has room for. The file is open only meanwhile. Errors:
  /// Malformed (truncated, damaged).
  Status next(std::span<std::uint16_t> out);

 private:
  struct State;
  explicit PngRows(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// The bytes of an 8-bit PNG of 1 or 3 channels, values as `writePng` takes them. Errors: WriteFailed (no
/// memory).
Result<std::string> encodePng(const Image& displayEncoded);

/// Writes 1 or 3 channels, values 0..1 taken as already display-encoded, clamped (not a number: 0), as 8-bit
/// PNG. Atomic like `writeExr`.
Status writePng(const std::filesystem::path& file, const Image& displayEncoded);

}  // namespace patina
