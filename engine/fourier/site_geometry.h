#pragma once

#include <Eigen/Core>
#include <functional>

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
  /// FourierCorrections::logEmission; empty: nothing beside the Gaussian.
  std::function<double(const Eigen::Vector2d& screenPoint, const Eigen::Vector2d& foot, double distance)>
      logEmission;

  explicit ScreenFrame(const Screen& screen);
  ScreenFrame() = default;
};

/// What a site's lobe has beyond the standard model's two Gaussians. Known beforehand, not solved for. With
/// LobeMapping::ExactMoments only.
struct LobeTerms {
  /// The slope plane's covariance is sigma^2 exp([[stretch[0], stretch[1]], [stretch[1], -stretch[0]]]), its
  /// first axis the sheet's x turned into the plane: a lobe whose sigma along the direction alpha is `ratio`
  /// times that across has stretch = log(ratio) (cos 2 alpha, sin 2 alpha).
  float stretch[2] = {0, 0};
  /// A third Gaussian's share of the lobe's mass, and its standard deviation over sigma; stretched like the
  /// others.
  float thirdShare = 0, thirdRatio = 4;
  bool stretched() const { return stretch[0] != 0 || stretch[1] != 0; }
  bool operator==(const LobeTerms&) const = default;
};

/// The inverse of exp([[a, b], [b, -a]]): along, mixed, across.
struct LobeShape {
  float along = 1, mixed = 0, across = 1;
};
LobeShape lobeShape(const LobeTerms& terms);

/// Which of it any site of a sheet has: what the kernel must do.
struct LobeVariant {
  bool skewedLight = false;  ///< SiteGeometry::lightPrecisionXY
  bool stretched = false;
  bool third = false;
};

/// A measured point: where it lies relative to the screen, from where the camera sees it, and the window
/// times the emission as seen from it: peak * exp(-1/2 sum_k precision_k (x'_k - mean_k)^2), x' = x - foot
/// (and a mixed term with precisionXY).
struct SiteGeometry {
  float footX = 0, footY = 0;             ///< orthogonal projection onto the screen, pattern units
  float distance = 1;                     ///< d(p): orthogonal distance from the screen, pattern units
  float viewX = 0, viewY = 0, viewZ = 1;  ///< toView, unit, screen frame
  float lightMeanX = 0, lightMeanY = 0, lightPrecisionX = 1, lightPrecisionY = 1, lightPeak = 1;
  float lightPrecisionXY = 0;  ///< only where an emission's expansion has a mixed term
  LobeTerms lobe;
};

/// `ScreenFrame::logEmission` near a site's lobe, to second order: value + sum_k slope_k u_k + 1/2 sum_k
/// curve_k u_k^2 + mixed u_0 u_1, u = x - centre, x on the screen.
struct EmissionExpansion {
  float centre[2] = {0, 0};
  float value = 0, slope[2] = {0, 0}, curve[2] = {0, 0}, mixed = 0;
};

/// Geometry of a sample point (world, mm) seen from `cameraMm`. The light's Gaussian is window times the
/// emission's Gaussian, times the exponential of `expansion` (null: 1). A curve that would leave less than a
/// tenth of the precision is cut there, and a mixed term where it would leave no Gaussian.
SiteGeometry siteGeometry(const ScreenFrame& frame, const Eigen::Vector3d& pointMm,
                          const Eigen::Vector3d& cameraMm, const EmissionExpansion* expansion = nullptr);

/// The sheet's surface: the plane z = 0, or a height over it.
struct SheetShape {
  /// FourierCorrections::heightMm; empty: the plane.
  std::function<double(const Eigen::Vector2d& pointMm)> heightMm;
  Eigen::Vector3d cameraMm = Eigen::Vector3d::UnitZ();

  /// What the camera sees where it would see a point of the plane: the point of the same ray at the height.
  Eigen::Vector3d pointMm(const Eigen::Vector2d& onPlane) const {
    const Eigen::Vector3d flat(onPlane.x(), onPlane.y(), 0);
    return heightMm ? flat + (cameraMm - flat) * (heightMm(onPlane) / cameraMm.z()) : flat;
  }
};

}  // namespace patina
