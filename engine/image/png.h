#pragma once

#include <filesystem>

#include "engine/base/result.h"
#include "engine/image/image.h"

namespace patina {

/// Reads an 8- or 16-bit PNG (or TIFF) as R, G, B floats in 0..1, still encoded as in the file (grey is repeated).
/// Errors as `readExr`.
Result<Image> readPng(const std::filesystem::path& file);

/// Writes 1 or 3 channels, values 0..1 taken as already display-encoded, clamped, as 8-bit PNG. Atomic like `writeExr`.
Status writePng(const std::filesystem::path& file, const Image& displayEncoded);

}  // namespace patina
