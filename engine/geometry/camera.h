#pragma once

#include <Eigen/Core>
#include <optional>

namespace patina {

/// A pinhole camera with OpenCV's lens distortion. `x_cam = rotation * X_world + translationMm`, +z forward,
/// +y down in the image; pixel centres at integer coordinates; `u = fx x/z + cx`. Source: capture format,
/// version 1, "Frames and units".
struct Camera {
  int width = 0, height = 0;                                                     ///< pixels
  Eigen::Matrix3d intrinsics = Eigen::Matrix3d::Identity();                      ///< K, pixels
  Eigen::Matrix<double, 5, 1> distortion = Eigen::Matrix<double, 5, 1>::Zero();  ///< k1 k2 p1 p2 k3
  Eigen::Matrix3d cameraFromWorld = Eigen::Matrix3d::Identity();                 ///< rotation R
  Eigen::Vector3d translationMm = Eigen::Vector3d::Zero();                       ///< t

  /// Camera centre in the world, mm.
  Eigen::Vector3d positionMm() const { return -cameraFromWorld.transpose() * translationMm; }
  /// World point (mm) to pixel coordinates through the lens, inside the picture or not; empty behind the
  /// camera and so far off the axis that the lens model has folded over (its radius no longer grows with the
  /// angle).
  std::optional<Eigen::Vector2d> pixelFromWorld(const Eigen::Vector3d& pointMm) const;
  /// Pixel (centre at integers) to the unit viewing direction in the world, distortion undone by Newton's
  /// method to 1e-10 of the focal length. Where no direction is seen at that pixel (beyond the lens model's
  /// fold), that of the nearest point found; `samplePlaneFromPixel` is then empty. Cost: about 3 steps of
  /// some 40 operations.
  Eigen::Vector3d rayFromPixel(const Eigen::Vector2d& pixel) const;
  /// Where the pixel's ray meets the sample plane z = 0, mm; empty where it doesn't.
  std::optional<Eigen::Vector3d> samplePlaneFromPixel(const Eigen::Vector2d& pixel) const;
};

}  // namespace patina
