#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "engine/image/image.h"

namespace patina {

/// Noise of a sensor in pixel units: variance = shot * value + read^2.
struct PhotoNoise {
  double shot = 0, read = 0;
  double variance(double value) const { return shot * (value > 0 ? value : 0) + read * read; }
};

/// One photograph and which of its pixels count (width x height, 0 or 1).
struct MaskedPhoto {
  const Image* image = nullptr;
  const std::vector<std::uint8_t>* mask = nullptr;
};

/// A photograph's noise, from itself: what a quadratic surface through every 3 x 3 patch leaves over (3 of 9
/// degrees of freedom), its median in bins of brightness, then a weighted line. Whatever changes from pixel
/// to pixel counts as noise, the sample's own grain too: it averages out in the same way. One photograph at a
/// time, because gain and unit may differ between them. Falls back on 1 % of the mean where fewer than 100
/// patches lie inside the mask. Cost: one pass.
PhotoNoise estimateNoise(const MaskedPhoto& photo);

/// Pixel values at which a photograph is clipped, R G B; infinite where nothing says that it is.
///
/// With `saturation` > 0 (the bundle says it) that value. Otherwise a plateau: at least 16 masked pixels and
/// 0.01 % of them hold exactly the largest value, and ten times as many as hold the next one below (a smooth
/// maximum, rounded to the file's digits, has about as many of each). A picture in which every masked pixel
/// holds the same value says nothing: it is then as clipped as `limit`, the level found elsewhere or the
/// encoding's largest value, says.
Eigen::Array3d clipLevels(const MaskedPhoto& photo, double saturation, double limit);

}  // namespace patina
