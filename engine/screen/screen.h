#pragma once

#include <Eigen/Core>
#include <numbers>
#include <optional>

namespace patina {

/// The Gaussian that the monitor calibration found: radiance of screen point x seen by an eye at unit
/// distance (pattern units) straight in front of the screen's centre. Source: frequency-domain paper,
/// section 4.2; capture format.
struct ScreenEmission {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();   ///< pattern units
  Eigen::Vector2d sigma = Eigen::Vector2d::Ones();  ///< pattern units
  double gain = 1.0;                                ///< peak
};

/// A flat panel. Screen frame: x right, y up on the displayed picture, origin at the centre of the lit area,
/// third column of the rotation the emitting normal. Pattern units: x = pi * xMm / (widthMm / 2).
struct Screen {
  double widthMm = 0, heightMm = 0;
  int widthPx = 0, heightPx = 0;
  Eigen::Matrix3d worldFromScreen = Eigen::Matrix3d::Identity();
  Eigen::Vector3d originMm = Eigen::Vector3d::Zero();              ///< world
  Eigen::Vector2d windowSigma = Eigen::Vector2d(1.0, 9.0 / 16.0);  ///< pattern units, zero mean, peak 1
  std::optional<ScreenEmission> emission;

  /// One pattern unit in millimetres.
  double unitMm() const { return widthMm / (2.0 * std::numbers::pi); }
  double aspect() const { return widthMm / heightMm; }
  /// Half extents in pattern units: (pi, pi / aspect).
  Eigen::Vector2d halfExtent() const { return {std::numbers::pi, std::numbers::pi / aspect()}; }
};

}  // namespace patina
