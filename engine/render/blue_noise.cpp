#include "engine/render/blue_noise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace patina {
namespace {

constexpr int kSide = 64;
constexpr std::size_t kCells = std::size_t{kSide} * kSide;

std::array<float, kCells> makeMask() {
  constexpr float kSigma = 1.9f;
  std::array<float, kCells> falloff{};  // by distance round the torus
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const int dx = std::min(x, kSide - x), dy = std::min(y, kSide - y);
      falloff[static_cast<std::size_t>(y) * kSide + x] =
          std::exp(-static_cast<float>(dx * dx + dy * dy) / (2 * kSigma * kSigma));
    }
  // Each number goes to the emptiest place; a trace of disorder at the beginning, or the places would form a
  // lattice.
  std::vector<float> crowd(kCells);
  unsigned state = 1;
  for (float& value : crowd) {
    state = state * 1664525u + 1013904223u;
    value = 1e-3f * static_cast<float>(state >> 8) * 0x1p-24f;
  }
  std::array<float, kCells> mask{};
  for (std::size_t rank = 0; rank < kCells; ++rank) {
    const std::size_t place =
        static_cast<std::size_t>(std::min_element(crowd.begin(), crowd.end()) - crowd.begin());
    mask[place] = (static_cast<float>(rank) + 0.5f) / kCells;
    const int px = static_cast<int>(place % kSide), py = static_cast<int>(place / kSide);
    for (int y = 0; y < kSide; ++y) {
      const std::size_t row = static_cast<std::size_t>((y - py + kSide) % kSide) * kSide;
      for (int x = 0; x < kSide; ++x)
        crowd[static_cast<std::size_t>(y) * kSide + x] +=
            falloff[row + static_cast<std::size_t>((x - px + kSide) % kSide)];
    }
    crowd[place] = 1e30f;  // taken
  }
  return mask;
}

}  // namespace

float blueNoise(int x, int y, int channel) {
  static const std::array<float, kCells> mask = makeMask();
  const unsigned u = static_cast<unsigned>(x + 23 * channel), v = static_cast<unsigned>(y + 41 * channel);
  return mask[static_cast<std::size_t>(v % kSide) * kSide + u % kSide];
}

}  // namespace patina
