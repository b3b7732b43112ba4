#pragma once

#include <Eigen/Core>

namespace patina {

/// The material at one point, as the fit and the renderers exchange it.
struct SvbrdfParameters {
  Eigen::Array3f diffuse = Eigen::Array3f::Zero();
  Eigen::Array3f specular = Eigen::Array3f::Zero();  ///< at normal incidence
  Eigen::Vector3f normal = Eigen::Vector3f::UnitZ();
  float sigma = 0.1f;
  float kurtosis = 1.0f;
};

}  // namespace patina
