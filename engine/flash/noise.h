#pragma once

#include <span>

#include "engine/capture/flash_capture.h"

namespace patina {

/// What is known about the scatter of a decoded pixel value v: variance = read^2 + shot v + step(v)^2 / 12.
struct FlashNoise {
  double shot = 0, read = 0;
  std::array<std::vector<float>, 3> valueOfCode;  ///< of 8-bit photographs; see FlashPixels
  double variance(double value, int channel) const;
};

/// Measured in the photographs' own smoothest places, brightness by brightness: second differences of 8 x 8
/// pixel blocks, of which the quietest twentieth counts. Texture everywhere makes it too large, smoothing by
/// the camera too small. Source: J. Immerkaer 1996, "Fast noise variance estimation". `largest`: values from
/// there on are clipped.
FlashNoise measureFlashNoise(std::span<const FlashPixels> photos, const std::array<float, 3>& largest);

}  // namespace patina
