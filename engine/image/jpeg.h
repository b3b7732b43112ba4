#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "engine/base/result.h"
#include "engine/image/image.h"
#include "engine/image/image_size.h"

namespace patina {

/// Reads a JPEG as R, G, B floats in 0..1, still encoded as in the file (grey is repeated, colour profiles
/// and the orientation in EXIF are ignored: pixels as the sensor had them). With `expected`, another size is
/// refused before pixels take memory. Errors: NotFound; Malformed (truncated, damaged, over 2^28 pixels);
/// Unsupported (CMYK); Invalid (not the expected size). Threading: any.
Result<Image> readJpeg(const std::filesystem::path& file, std::optional<ImageSize> expected = {});

/// The same from bytes in memory; `where` names them in errors.
Result<Image> readJpegBytes(std::string_view bytes, const std::string& where,
                            std::optional<ImageSize> expected = {});

}  // namespace patina
