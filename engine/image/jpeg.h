#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/result.h"
#include "engine/image/image.h"
#include "engine/image/image_size.h"

namespace patina {

/// Pixels of a JPEG as 8-bit R, G, B, row 0 first (grey is repeated). Camera frames without Huffman tables
/// (motion JPEG) are understood: the standard's tables are assumed. `where` names it in errors. Errors and
/// threading as `readJpeg`.
struct JpegPixels {
  ImageSize size;
  std::vector<std::uint8_t> rgb;
};
Result<JpegPixels> decodeJpeg(std::string_view bytes, const std::string& where,
                              std::optional<ImageSize> expected = {});

/// Reads a JPEG as R, G, B floats in 0..1, still encoded as in the file (grey is repeated, colour profiles
/// and the orientation in EXIF are ignored: pixels as the sensor had them). With `expected`, another size is
/// refused before pixels take memory. Errors: NotFound; Malformed (truncated, damaged, over 2^28 pixels);
/// Unsupported (CMYK); Invalid (not the expected size). Threading: any.
Result<Image> readJpeg(const std::filesystem::path& file, std::optional<ImageSize> expected = {});

/// The same from bytes in memory; `where` names them in errors.
Result<Image> readJpegBytes(std::string_view bytes, const std::string& where,
                            std::optional<ImageSize> expected = {});

}  // namespace patina
