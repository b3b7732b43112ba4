#pragma once

#include <Eigen/Core>

#include "engine/fourier/maps.h"
#include "engine/image/image.h"
#include "engine/surface/svbrdf.h"

namespace patina {

/// A small light. Radiance towards the eye = BRDF * n.l * intensity / distance^2.
struct PointLight {
  Eigen::Vector3f positionMm = Eigen::Vector3f(0, 150, 200);  ///< world
  Eigen::Array3f intensity = Eigen::Array3f::Constant(1e5f);  ///< R G B, radiance units times mm^2
};

/// Where the sheet is looked at from, and how big the picture is.
struct SheetView {
  Eigen::Vector3f eyeMm = Eigen::Vector3f(0, -260, 360);  ///< world, z > 0; looks at the sheet's centre
  int width = 512, height = 512;                          ///< pixels
  int samplesPerPixelSide = 2;                            ///< squared; more: smoother edges, slower
  float background = 0.0f;                                ///< radiance beside the sheet
};

/// The material at a place of fitted maps, interpolated linearly. u, v in 0 to 1 over the sample, v from row
/// 0 down.
SvbrdfParameters parametersFromMaps(const SvbrdfMaps& maps, float u, float v);

/// The fitted sheet under a point light, linear radiance R G B: `svbrdfBrdf` at every point, perspective, no
/// shadows or interreflection. Texels that no photograph measured show the background. Source:
/// frequency-domain paper, section 5.3 (with the two Gaussians of the fit instead of Blinn lobes). All cores.
/// Cost: about 20 ms a megapixel sample.
Image relitSheet(const SvbrdfMaps& maps, const PointLight& light, const SheetView& view);

}  // namespace patina
