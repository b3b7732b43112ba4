#pragma once

#include <cstddef>
#include <cstdint>

#include "engine/image/image.h"

namespace patina {

/// What the simulated sensor adds: variance = fullScale * shot * radiance + (read * fullScale)^2.
struct SensorNoise {
  double shot = 2e-5;
  double read = 2e-4;
  bool operator==(const SensorNoise&) const = default;
};

/// Adds the sensor's noise and clips at `clipsAt` (0: at `fullScale`); returns how many samples were clipped.
/// The noise of a sample depends on `seed`, the photograph and the place, never on threads: `photoIndex`
/// numbers photographs of the same size.
std::size_t senseInPlace(Image& photo, const SensorNoise& noise, double fullScale, std::uint64_t seed,
                         std::uint64_t photoIndex, double clipsAt = 0);

}  // namespace patina
