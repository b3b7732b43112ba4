#pragma once

#include <Eigen/Core>

#include "engine/fourier/maps.h"

namespace patina {

/// A point light and an eye over a sheet, world frame, millimetres.
struct SheetLighting {
  Eigen::Vector3d lightMm{0, 0, 200};
  Eigen::Vector3d eyeMm{0, -200, 300};
  /// The light's radiant intensity is chosen so that a white Lambertian sheet right below it at this distance
  /// has radiance 1.
  double referenceDistanceMm = 200;
};

/// The linear radiance R G B that each texel of the maps sends to the eye under the light, exactly by the
/// engine's BRDF with the texel's own directions. Every `step`-th texel is evaluated in both directions, the
/// others repeat it: 1 is exact. On all cores. Texels that were not measured are dark grey. `radiance` is
/// made to the maps' size where it isn't.
void shadeSheet(const SvbrdfMaps& maps, const SheetLighting& lighting, int step, Image& radiance);

}  // namespace patina
