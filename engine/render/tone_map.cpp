#include "engine/render/tone_map.h"

#include <algorithm>
#include <cmath>

namespace patina {
namespace {

constexpr float kShoulderStart = 0.6f;

float withShoulder(float value) {
  if (value <= kShoulderStart) return value;
  constexpr float room = 1 - kShoulderStart;  // slope 1 where the bend starts
  const float over = (value - kShoulderStart) / room;
  const float compressed =
      std::log1p(over);  // a glossy highlight is some fifty times brighter than what it lies on
  return kShoulderStart + room * compressed / (1 + compressed);
}

}  // namespace

float srgbFromLinear(float linear) {
  const float v = std::clamp(linear, 0.0f, 1.0f);
  return v <= 0.0031308f ? 12.92f * v : 1.055f * std::pow(v, 1 / 2.4f) - 0.055f;
}

float linearFromSrgb(float encoded) {
  const float v = std::clamp(encoded, 0.0f, 1.0f);
  return v <= 0.04045f ? v / 12.92f : std::pow((v + 0.055f) / 1.055f, 2.4f);
}

Image toneMap(const Image& linear, float exposure, Highlights highlights) {
  Image shown(linear.width(), linear.height(), linear.channels());
  const auto from = linear.samples();
  const auto to = shown.samples();
  for (std::size_t i = 0; i < from.size(); ++i) {
    float value = std::isfinite(from[i]) ? from[i] * exposure : 0.0f;
    if (highlights == Highlights::Shoulder) value = withShoulder(value);
    to[i] = srgbFromLinear(value);
  }
  return shown;
}

float autoExposure(const Image& linear, float fraction, float target) {
  std::vector<float> lit;
  for (float value : linear.samples())
    if (std::isfinite(value) && value > 0) lit.push_back(value);
  if (lit.empty()) return 1.0f;
  const auto rank =
      static_cast<std::ptrdiff_t>(std::clamp(fraction, 0.0f, 1.0f) * static_cast<float>(lit.size() - 1));
  std::nth_element(lit.begin(), lit.begin() + rank, lit.end());
  return target / lit[static_cast<std::size_t>(rank)];
}

}  // namespace patina
