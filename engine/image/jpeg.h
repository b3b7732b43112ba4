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
/// (motion JPEG) are understood: the standard's tables are assumed. `where` names it in errors. Errors:
/// Malformed (not JPEG, damaged or cut off); Invalid (not of the `expected` size). Threading: any.
struct JpegPixels {
  ImageSize size;
  std::vector<std::uint8_t> rgb;
};
Result<JpegPixels> decodeJpeg(std::string_view bytes, const std::string& where,
                              std::optional<ImageSize> expected = {});

/// A JPEG as R, G, B floats in 0..1, still display-encoded, as `readPng` does. Errors also: NotFound.
Result<Image> readJpeg(const std::filesystem::path& file, std::optional<ImageSize> expected = {});

}  // namespace patina
