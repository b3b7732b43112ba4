#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "engine/image/exr.h"

/// Any bytes as an OpenEXR image. A small picture is expected, as a bundle's photographs have a declared
/// size, so that the time goes into decoding and not into clearing memory.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  const auto image = patina::readExrBytes(bytes, "photo.exr", {"R", "G", "B"}, patina::ImageSize{12, 12});
  if (image && (image->width() != 12 || image->channels() != 3)) std::abort();
  if (!image && image.error().what.empty()) std::abort();
  if (image) (void)patina::requireFinite(*image, "photo.exr");
  return 0;
}
