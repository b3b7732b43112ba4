#include "devices/simulated/simulated_sensor.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace patina {
namespace {

/// A well mixed 64-bit value of a counter (splitmix64's finaliser): the noise of a sample depends on where it
/// is, not on which thread came first.
std::uint64_t mixed(std::uint64_t value) {
  value += 0x9E3779B97F4A7C15ull;
  value = (value ^ (value >> 30)) * 0xBF58476D1CE4E5B9ull;
  value = (value ^ (value >> 27)) * 0x94D049BB133111EBull;
  return value ^ (value >> 31);
}

/// Standard normal for a counter (Box and Muller).
double normal(std::uint64_t counter) {
  const double u = (static_cast<double>(mixed(2 * counter) >> 11) + 0.5) * 0x1.0p-53;
  const double v = static_cast<double>(mixed(2 * counter + 1) >> 11) * 0x1.0p-53;
  return std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi * v);
}

}  // namespace

std::size_t senseInPlace(Image& photo, const SensorNoise& noise, double fullScale, std::uint64_t seed,
                         std::uint64_t photoIndex, double clipsAt) {
  const std::uint64_t stream = mixed(seed) + photoIndex * photo.samples().size();
  std::size_t clipped = 0, index = 0;
  const double most = clipsAt > 0 ? clipsAt : fullScale;
  for (float& sample : photo.samples()) {
    const double variance =
        fullScale * noise.shot * std::max(0.0f, sample) + noise.read * noise.read * fullScale * fullScale;
    double value = sample + std::sqrt(variance) * normal(stream + index++);
    if (value >= most) {
      value = most;
      ++clipped;
    }
    sample = static_cast<float>(value);  // may fall below zero where the black level is low
  }
  return clipped;
}

}  // namespace patina
