#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "engine/image/png.h"

/// Any bytes as a PNG of at most 64 x 64 pixels (larger ones only take time).
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t kWidthAt = 16, kHeightAt = 20, kHeaderEnd = 24;
  if (size >= kHeaderEnd) {
    for (const std::size_t at : {kWidthAt, kHeightAt}) {
      if (data[at] || data[at + 1] || data[at + 2] || data[at + 3] > 64) return 0;
    }
  }
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  const auto image = patina::readPngBytes(bytes, "photo.png");
  if (!image) {
    if (image.error().what.empty()) std::abort();
    return 0;
  }
  for (const float sample : image->samples()) {
    if (!(sample >= 0.0f && sample <= 1.0f)) std::abort();
  }
  return 0;
}
