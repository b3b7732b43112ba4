#pragma once

#include <Eigen/Core>

#include "engine/screen/screen.h"

namespace patina {

/// What the model needs of the rig, in pattern units (unitMm of `Screen`) and in the screen's frame.
/// Source: frequency-domain paper, section 4.1 (equation 2) and 4.2; fourier-model notes in
/// docs/fourier_fit.md.
struct ScreenFrame {
  double unitMm = 1;
  Eigen::Matrix3d screenFromWorld = Eigen::Matrix3d::Identity();
  Eigen::Vector3d originUnits = Eigen::Vector3d::Zero();      ///< t, world frame
  Eigen::Vector2d halfExtent = Eigen::Vector2d::Ones();       ///< of the lit area
  Eigen::Vector2d windowPrecision = Eigen::Vector2d::Ones();  ///< 1 / sigma_W^2
  Eigen::Vector2d emissionMean = Eigen::Vector2d::Zero();
  Eigen::Vector2d emissionPrecision =
      Eigen::Vector2d::Zero();  ///< 1 / sigma_E^2 at unit distance; 0: Lambertian panel
  double emissionGain = 1;

  explicit ScreenFrame(const Screen& screen);
  ScreenFrame() = default;
};

/// A measured point: where it lies relative to the screen, from where the camera sees it, and the window
/// times the emission as seen from it: peak * exp(-1/2 sum_k precision_k (x'_k - mean_k)^2), x' = x - foot.
struct SiteGeometry {
  float footX = 0, footY = 0;             ///< orthogonal projection onto the screen, pattern units
  float distance = 1;                     ///< d(p): orthogonal distance from the screen, pattern units
  float viewX = 0, viewY = 0, viewZ = 1;  ///< toView, unit, screen frame
  float lightMeanX = 0, lightMeanY = 0, lightPrecisionX = 1, lightPrecisionY = 1, lightPeak = 1;
};

/// Geometry of a sample point (world, mm) seen from `cameraMm`.
SiteGeometry siteGeometry(const ScreenFrame& frame, const Eigen::Vector3d& pointMm,
                          const Eigen::Vector3d& cameraMm);

}  // namespace patina
