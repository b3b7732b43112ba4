#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/result.h"
#include "engine/image/image.h"
#include "engine/image/image_size.h"

namespace patina {

/// Reads the named channels of an OpenEXR file, half or float (or 32-bit integers), in the order asked for,
/// as float. The data window is the picture. With `expected`, a picture of another size is refused before its
/// pixels take memory. Errors: NotFound; Malformed (truncated, not OpenEXR, a wanted channel missing, absurd
/// size: over 2^28 pixels); Invalid (not the expected size). Non-finite samples are not looked for here; see
/// `requireFinite`. No exception leaves. Threading: any number of files at a time.
Result<Image> readExr(const std::filesystem::path& file, const std::vector<std::string>& channels,
                      std::optional<ImageSize> expected = {});

/// The same from bytes in memory; `where` names them in errors.
Result<Image> readExrBytes(std::string_view bytes, const std::string& where,
                           const std::vector<std::string>& channels, std::optional<ImageSize> expected = {});

/// Reads rows firstRow .. firstRow + rowCount - 1 (0: the data window's top) of a file whose picture has the
/// `expected` size, without the rest ever being in memory: `out` is rowCount x width x channels, interleaved.
/// Opens the file each time; rows of one compressed block (16 or 32 in most files) are best read together,
/// and rows of tiles likewise. Errors as `readExr`. Threading: any number of files at a time.
Status readExrRows(const std::filesystem::path& file, const std::string& where,
                   const std::vector<std::string>& channels, ImageSize expected, int firstRow, int rowCount,
                   std::span<float> out);

/// The channel names that a file holds, sorted.
Result<std::vector<std::string>> exrChannels(const std::filesystem::path& file);

/// Writes float channels (names count = image channels), ZIP-compressed, with string attributes (units,
/// frame, source). Written to a neighbouring temporary file and renamed, so that a failed write leaves
/// nothing half done. `half` rounds to 16-bit floats (values beyond 65504 become infinite). Errors:
/// WriteFailed, Refused.
Status writeExr(const std::filesystem::path& file, const Image& image,
                const std::vector<std::string>& channels,
                const std::map<std::string, std::string>& attributes = {}, bool half = false);

/// The failure of an image with a sample that is no number.
Error notFinite(float value, std::size_t x, std::size_t y, std::size_t channel, const std::string& where);

/// Fails (Invalid) with the first pixel that holds a NaN or an infinity. Cost: one pass.
Status requireFinite(const Image& image, const std::string& where);

}  // namespace patina
