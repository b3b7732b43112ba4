#include "engine/geometry/camera.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

namespace patina {
namespace {

/// Nearer to the camera's plane than this share of the distances involved, a projection is rounding only.
constexpr double kSmallestDepth = 1e-9;
/// Newton's method stops here, in units of the focal length: 1e-6 of a pixel at f = 10000 px.
constexpr double kUndistortTolerance = 1e-10;
/// Quadratic convergence takes 3 to 6 steps; more means that there is no solution.
constexpr int kUndistortSteps = 30;

/// The lens: ideal image coordinates (x/z, y/z) to distorted ones, and the Jacobian.
/// Source: OpenCV, "Camera Calibration and 3D Reconstruction", with k1 k2 p1 p2 k3.
struct Distorted {
  Eigen::Vector2d point;
  Eigen::Matrix2d jacobian;
  double radialSlope;  ///< d(radius after)/d(radius before), radial terms only
};

Distorted distort(const Eigen::Matrix<double, 5, 1>& lens, const Eigen::Vector2d& ideal) {
  const double k1 = lens[0], k2 = lens[1], p1 = lens[2], p2 = lens[3], k3 = lens[4];
  const double x = ideal.x(), y = ideal.y();
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double slope = k1 + r2 * (2 * k2 + 3 * r2 * k3);  // d radial / d r2
  Distorted result;
  result.point = {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                  y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
  const double cross = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y;
  result.jacobian << radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x, cross,  //
      cross, radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x;
  result.radialSlope = radial + 2 * r2 * slope;
  return result;
}

struct Undistorted {
  Eigen::Vector2d ideal;
  bool found;
};

Undistorted undistort(const Eigen::Matrix<double, 5, 1>& lens, const Eigen::Vector2d& seen) {
  if (lens.isZero(0.0)) return {seen, true};
  Eigen::Vector2d ideal = seen;
  Distorted now = distort(lens, ideal);
  // Beyond the fold Newton's method would walk away; begin nearer to the axis, where the map is one to one.
  for (int i = 0; i < kUndistortSteps && now.radialSlope <= 0; ++i) {
    ideal *= 0.5;
    now = distort(lens, ideal);
  }
  for (int i = 0; i < kUndistortSteps; ++i) {
    const Eigen::Vector2d miss = now.point - seen;
    if (miss.norm() <= kUndistortTolerance) return {ideal, now.radialSlope > 0};
    const double determinant = now.jacobian.determinant();
    if (!(std::abs(determinant) > 1e-12)) break;  // on the fold itself: no step is defined
    Eigen::Vector2d step = -now.jacobian.inverse() * miss;
    // Halve a step that makes things worse or crosses the fold.
    bool better = false;
    for (int half = 0; half < kUndistortSteps && !better; ++half) {
      const Distorted next = distort(lens, ideal + step);
      better = next.radialSlope > 0 && (next.point - seen).norm() < miss.norm();
      if (better) {
        ideal += step;
        now = next;
      } else {
        step *= 0.5;
      }
    }
    if (!better) break;
  }
  // Rounding can stall just above the tolerance when coordinates are large.
  const double stall = 1e3 * kUndistortTolerance * std::max(1.0, seen.norm());
  return {ideal, (now.point - seen).norm() <= stall && now.radialSlope > 0};
}

Undistorted idealFromPixel(const Camera& camera, const Eigen::Vector2d& pixel) {
  const Eigen::Matrix3d& k = camera.intrinsics;
  return undistort(camera.distortion, {(pixel.x() - k(0, 2)) / k(0, 0), (pixel.y() - k(1, 2)) / k(1, 1)});
}

}  // namespace

std::optional<Eigen::Vector2d> Camera::pixelFromWorld(const Eigen::Vector3d& pointMm) const {
  const Eigen::Vector3d seen = cameraFromWorld * pointMm + translationMm;
  if (!(seen.z() > kSmallestDepth * (seen.norm() + translationMm.norm()))) return std::nullopt;
  const Distorted distorted = distort(distortion, {seen.x() / seen.z(), seen.y() / seen.z()});
  if (!(distorted.radialSlope > 0)) return std::nullopt;
  return Eigen::Vector2d(intrinsics(0, 0) * distorted.point.x() + intrinsics(0, 2),
                         intrinsics(1, 1) * distorted.point.y() + intrinsics(1, 2));
}

Eigen::Vector3d Camera::rayFromPixel(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d ideal = idealFromPixel(*this, pixel).ideal;
  return cameraFromWorld.transpose() * Eigen::Vector3d(ideal.x(), ideal.y(), 1.0).normalized();
}

std::optional<Eigen::Vector3d> Camera::samplePlaneFromPixel(const Eigen::Vector2d& pixel) const {
  const Undistorted undistorted = idealFromPixel(*this, pixel);
  if (!undistorted.found) return std::nullopt;
  const Eigen::Vector3d origin = positionMm();
  const Eigen::Vector3d ray = cameraFromWorld.transpose() *
                              Eigen::Vector3d(undistorted.ideal.x(), undistorted.ideal.y(), 1.0).normalized();
  if (!(std::abs(ray.z()) > kSmallestDepth)) return std::nullopt;  // along the plane
  const double distance = -origin.z() / ray.z();
  if (!(distance > 0)) return std::nullopt;
  Eigen::Vector3d point = origin + distance * ray;
  point.z() = 0;
  return point;
}

}  // namespace patina
