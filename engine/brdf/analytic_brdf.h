#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "engine/base/result.h"
#include "engine/brdf/brdf.h"

namespace patina {

/// Parameters of the analytic models, one struct for all: a model reads those that it has.
struct AnalyticBrdfParameters {
  Eigen::Array3d diffuse = Eigen::Array3d::Constant(0.2);  ///< Lambertian albedo, [0, 1]
  Eigen::Array3d specular = Eigen::Array3d::Constant(
      0.04);  ///< Fresnel reflectance at normal incidence (Schlick), [0, 1]; Ward: the lobe's albedo
  double alphaX = 0.2;   ///< width along x: GGX and Beckmann alpha, Ward's alpha; (0, 1]
  double alphaY = 0.2;   ///< width along y; equal to alphaX for an isotropic surface
  double exponent = 50;  ///< Blinn's, > 0
};

/// Ids: "lambert", "blinn", "beckmann", "ggx", "ggx-anisotropic", "ward". Each with a Lambertian part.
std::vector<std::string> analyticBrdfModels();

/// An analytic model. Errors: Unsupported (no such model; the nearest is named), Invalid (a parameter out of
/// range, named).
Result<BrdfPtr> makeAnalyticBrdf(const std::string& model, const AnalyticBrdfParameters& parameters);

}  // namespace patina
