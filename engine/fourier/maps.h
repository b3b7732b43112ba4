#pragma once

#include <Eigen/Core>

#include "engine/surface/svbrdf_maps.h"

namespace patina {

/// Standard deviations of a point's parameters from the measurements' noise and the priors alone: what the
/// model lacks is not in them. 0 where nothing was solved.
struct SiteUncertainty {
  Eigen::Array3f diffuse = Eigen::Array3f::Zero(), specular = Eigen::Array3f::Zero();
  Eigen::Array2f normal = Eigen::Array2f::Zero();  ///< of the normal's slopes in x and y
  float sigma = 0, kurtosis = 0;
};

}  // namespace patina
