#pragma once

#include <filesystem>
#include <string>

#include "engine/base/result.h"
#include "engine/image/image.h"

namespace patina {

/// A photograph as a file holds it.
struct PhotoFile {
  Image image;          ///< R G B
  bool linear = false;  ///< OpenEXR: linear; PNG and JPEG: encoded, 0..1
  int codes = 0;        ///< 255 or 65535 of encoded ones as far as it is known; 0: linear
};

/// Reads a photograph whose format is told by its content: PNG, JPEG or OpenEXR (R G B, or Y repeated), every
/// pixel finite. Errors: those of the format's reader, Unsupported (another format), Malformed (pixels that
/// aren't finite).
Result<PhotoFile> readPhotoFile(const std::filesystem::path& file);

}  // namespace patina
