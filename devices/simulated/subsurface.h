#pragma once

#include <Eigen/Core>
#include <vector>

#include "devices/simulated/simulated_sheet.h"
#include "engine/geometry/camera.h"

namespace patina {

/// Light that enters the sheet at one place and leaves at another: the diffuse reflection spread over the
/// sheet with the profile exp(-r / l) / (2 pi l^2), mean distance 2 l. What crosses from one colour to
/// another takes the geometric mean of the two albedos: half of its path is in either. A pixel is one place;
/// its size is accounted for by sixteen points in it.
class Subsurface {
 public:
  /// `patterns`: of a response. `side`: samples a pixel, squared.
  Subsurface(const Camera& camera, double meanRadiusMm, int patterns, int side);
  /// Adds one sample of a pixel: its diffuse response for albedo 1. Pixels may be filled from several
  /// threads, each from one.
  void add(int x, int y, const SheetPoint& material, const Eigen::Ref<const Eigen::VectorXf>& response);
  /// Once all pixels are filled: scattered minus not scattered radiance of a pixel, patterns x R G B.
  /// Thread-safe. Cost: the pixels within 6 l.
  Eigen::ArrayX3f change(int x, int y) const;

 private:
  int width_, height_;
  double lengthMm_;
  float share_;
  Eigen::MatrixXf light_;  ///< patterns x pixels
  Eigen::Matrix3Xf root_;  ///< mean square root of albedo, R G B x pixels
  Eigen::Matrix3Xf albedo_;
  Eigen::Matrix2Xd at_;                 ///< mm
  std::vector<Eigen::Matrix2d> pixel_;  ///< mm per pixel along x and y
};

}  // namespace patina
