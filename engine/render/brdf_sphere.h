#pragma once

#include <Eigen/Core>

#include "engine/image/image.h"
#include "engine/surface/svbrdf.h"

namespace patina {

/// What lights a BRDF sphere.
struct SphereLighting {
  bool studio = true;  ///< a grey room with two soft boxes: shows gloss as a photographer would
  Eigen::Vector3f toLight = Eigen::Vector3f(
      -0.45f, 0.6f, 0.66f);  ///< of the small light; need not be unit. x right, y up, z to the eye
  Eigen::Array3f lightIrradiance =
      Eigen::Array3f::Constant(1.5f);  ///< R G B, on a surface that faces it; 0: no small light
};

/// A sphere of one material, seen from afar: linear radiance R G B, `size` x `size` pixels, `background`
/// (radiance) round it. The parameters' normal is replaced by the sphere's. The room is sampled with
/// `samples` half-vectors from the lobe itself (the diffuse part: spherical harmonics of the room),
/// so that it is smooth for mirrors as for matte; integrand over the half-vector's slope y: specular p(y) (1
/// + y.v_t / n.v) F / F0 (unit shadowing). Deterministic. All cores; 256 pixels and 48 samples: about 0.1 s.
Image brdfSphere(const SvbrdfParameters& parameters, int size, const SphereLighting& lighting = {},
                 int samples = 48, float background = 0.0f);

/// Radiance of the studio from a direction (unit; x right, y up, z to the eye). Between 0 and 12.
float studioRadiance(const Eigen::Vector3f& direction);

}  // namespace patina
