#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "engine/fourier/maps.h"

namespace patina {

/// A point light and an eye over a sheet, world frame.
struct SheetView {
  Eigen::Vector3d lightMm{0, 0, 200};
  Eigen::Vector3d eyeMm{0, -200, 300};
  double exposureEv = 0;
  /// The light's radiant intensity is chosen so that a white Lambertian sheet right below it at this distance
  /// has radiance 1.
  double referenceDistanceMm = 200;
};

/// The radiance that each texel of the maps sends to the eye under the light, exactly by the engine's BRDF
/// with the texel's own directions, as sRGB bytes R G B, bottom row first (as textures want it). Every
/// `step`-th texel is evaluated in both directions, the others repeat it: 1 is exact. On all cores. Texels
/// that were not measured are dark grey. Output: width x height x 3 bytes.
void shadeSheet(const SvbrdfMaps& maps, const SheetView& view, int step, std::vector<std::uint8_t>& rgb);

}  // namespace patina
