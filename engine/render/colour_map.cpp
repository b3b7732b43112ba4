#include "engine/render/colour_map.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace patina {

std::array<float, 3> mapColour(ColourMap map, float value) {
  static constexpr std::array<std::uint32_t, 9> kViridis{0x440154, 0x472d7b, 0x3b528b, 0x2c728e, 0x21918c,
                                                         0x28ae80, 0x5ec962, 0xaddc30, 0xfde725};
  static constexpr std::array<std::uint32_t, 9> kMagma{0x000004, 0x1c1044, 0x4f127b, 0x812581, 0xb5367a,
                                                       0xe55064, 0xfb8761, 0xfec287, 0xfcfdbf};
  const auto& keys = map == ColourMap::Viridis ? kViridis : kMagma;
  const float at = std::isnan(value) ? 0.0f : std::clamp(value, 0.0f, 1.0f) * 8;
  const std::size_t index = std::min<std::size_t>(7, static_cast<std::size_t>(at));
  const float t = at - static_cast<float>(index);
  std::array<float, 3> colour{};
  for (int c = 0; c < 3; ++c) {
    const int shift = 16 - 8 * c;
    const float a = static_cast<float>((keys[index] >> shift) & 0xff),
                b = static_cast<float>((keys[index + 1] >> shift) & 0xff);
    colour[static_cast<std::size_t>(c)] = (a + (b - a) * t) / 255;
  }
  return colour;
}

}  // namespace patina
