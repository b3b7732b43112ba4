#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "engine/calibration/board.h"
#include "engine/geometry/camera.h"
#include "engine/image/image.h"

namespace patina::test {

/// A flat picture in space: `picture` (one channel, linear) fills a rectangle of the plane
/// world = rotation * (x, y, 0) + originMm, x right and y up on it, its middle at the origin.
struct FlatPicture {
  Image picture;
  double widthMm = 0, heightMm = 0;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d originMm = Eigen::Vector3d::Zero();
  bool facesOnly = true;  ///< dark from behind
};

/// A flat mirror: a rectangle of the plane z = heightMm.
struct FlatMirror {
  Eigen::Vector2d centreMm = Eigen::Vector2d::Zero(), sizeMm = Eigen::Vector2d::Zero();
  double heightMm = 0, reflectance = 0.85;
};

struct RayCastOptions {
  int samplesPerSide = 3;
  double blurPx = 0.6;   ///< Gaussian, of the lens
  double noise = 0.004;  ///< standard deviation, of a photograph whose white is 1
  double background = 0.25;
  bool encoded = true;  ///< sRGB-like power and 8 bits, as from a webcam
  std::uint64_t seed = 1;
};

/// A board as a flat picture, drawn with `pixelsPerSquare`; its middle at the origin.
FlatPicture boardPicture(Board* board, int pixelsPerSquare, double marginSquares = 0.6);

/// A photograph by following rays from many points of every pixel: through the lens (its distortion undone by
/// fixed-point iteration), to the nearest picture or mirror, off the mirror to the pictures. Shares no
/// formula with the calibration, which goes from points to pixels.
Image rayCast(const Camera& camera, const std::vector<FlatPicture>& pictures,
              const std::optional<FlatMirror>& mirror, const RayCastOptions& options = {});

/// A camera at `positionMm` that looks at `targetMm`, its picture's up near world +y (or +z where it looks
/// along y), turned by `rollDeg` about its axis.
Camera lookAt(Camera lens, const Eigen::Vector3d& positionMm, const Eigen::Vector3d& targetMm,
              double rollDeg);

}  // namespace patina::test
