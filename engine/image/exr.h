#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "engine/base/result.h"
#include "engine/image/image.h"

namespace patina {

/// Reads the named channels of an OpenEXR file, half or float, in the order asked for, as float. The data window
/// is the picture. Errors: NotFound; Malformed (truncated, not OpenEXR, a wanted channel missing, absurd size: over
/// 2^28 pixels). Non-finite samples are not looked for here; see `requireFinite`. No exception leaves.
Result<Image> readExr(const std::filesystem::path& file, const std::vector<std::string>& channels);

/// The channel names that a file holds, sorted.
Result<std::vector<std::string>> exrChannels(const std::filesystem::path& file);

/// Writes float channels (names count = image channels), ZIP-compressed, with string attributes (units, frame,
/// source). Written to a neighbouring temporary file and renamed, so that a failed write leaves nothing half done.
Status writeExr(const std::filesystem::path& file, const Image& image, const std::vector<std::string>& channels,
                const std::map<std::string, std::string>& attributes = {}, bool half = false);

/// Fails with the first pixel that holds a NaN or an infinity.
Status requireFinite(const Image& image, const std::string& where);

}  // namespace patina
