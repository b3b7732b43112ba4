#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "engine/image/jpeg.h"

/// Any bytes as a JPEG: an image of values from 0 to 1 or a sentence, never a crash. Small pictures only: a
/// header that promises a large one is refused before its pixels take memory.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  const auto image = patina::readJpegBytes(bytes, "photo.jpg", patina::ImageSize{16, 8});
  if (!image) {
    if (image.error().what.empty()) std::abort();
    return 0;
  }
  for (const float v : image->samples())
    if (!(v >= 0 && v <= 1)) std::abort();
  return 0;
}
