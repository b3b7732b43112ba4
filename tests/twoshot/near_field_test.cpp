#include "engine/twoshot/near_field.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace patina {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

Eigen::Vector3d direction(double thetaDeg, double azimuthDeg) {
  const double t = thetaDeg * kDegree, a = azimuthDeg * kDegree;
  return {std::sin(t) * std::cos(a), std::sin(t) * std::sin(a), std::cos(t)};
}

TEST(ShotFromHalfDiff, HasTheAnglesAndTheCameraAtAzimuthZero) {
  for (const double h : {0.0, 3.0, 40.0})
    for (const double d : {0.0, 20.0, 45.0})
      for (const double p : {10.0, 89.0, 91.5, 170.0}) {
        const ShotDirections shot = shotFromHalfDiff({h * kDegree, d * kDegree, p * kDegree});
        EXPECT_NEAR(shot.toCamera.norm(), 1, 1e-12);
        EXPECT_NEAR(shot.toLight.norm(), 1, 1e-12);
        EXPECT_NEAR(shot.toCamera.y(), 0, 1e-12);
        EXPECT_GE(shot.toCamera.x(), -1e-12);
        const HalfDiffAngles centre = shot.centre();
        EXPECT_NEAR(centre.thetaHRad, h * kDegree, 1e-9);
        EXPECT_NEAR(centre.thetaDRad, d * kDegree, 1e-9);
        if (h > 0 && d > 0) {
          EXPECT_NEAR(centre.phiDRad, p * kDegree, 1e-7);
        }
      }
}

TEST(DiscDirections, APointSampleIsItsCentre) {
  const ShotDirections shot{direction(30, 170), direction(50, 0)};
  const auto directions = discDirections(shot, {0, 300});
  ASSERT_EQ(directions.size(), 1u);
  EXPECT_NEAR(directions[0].thetaHRad, shot.centre().thetaHRad, 1e-12);
  EXPECT_NEAR(directions[0].thetaDRad, shot.centre().thetaDRad, 1e-12);
}

// From the angles alone: the view direction of every point is a point of the disc away from the camera's own.
TEST(DiscDirections, FillTheDiscEvenly) {
  const ShotDirections shot{direction(35, 140), direction(48, 0)};
  constexpr int kPoints = 500;
  constexpr double kFovDeg = 25;
  const double radius = std::tan(kFovDeg * kDegree / 2);
  const auto directions = discDirections(shot, {kFovDeg, kPoints});
  ASSERT_EQ(directions.size(), static_cast<std::size_t>(kPoints));
  double inner = 0, farthest = 0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const HalfDiffAngles& angles : directions) {
    // A pair with these angles, turned about the normal until its light is the shot's.
    DirectionPair pair = directionsFromHalfDiff(angles);
    EXPECT_NEAR(pair.toLight.z(), shot.toLight.z(), 1e-9) << "the light is distant";
    const double turn =
        std::atan2(shot.toLight.y(), shot.toLight.x()) - std::atan2(pair.toLight.y(), pair.toLight.x());
    const Eigen::Vector3d toView = Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()) * pair.toView;
    // The camera's ray meets the plane there.
    const Eigen::Vector3d at = shot.toCamera - toView * (shot.toCamera.z() / toView.z());
    farthest = std::max(farthest, at.norm());
    mean += at.head<2>() / kPoints;
    inner += at.norm() < radius / std::sqrt(2.0);
  }
  EXPECT_LE(farthest, radius * (1 + 1e-9));
  EXPECT_GT(farthest, 0.97 * radius);
  EXPECT_NEAR(mean.norm(), 0, 0.01 * radius);
  EXPECT_NEAR(inner / kPoints, 0.5, 0.02) << "half of the points on half of the area";
}

TEST(DiscDirections, NothingIsSeenFromBelow) {
  EXPECT_TRUE(discDirections({direction(100, 0), direction(40, 0)}, {25, 100}).empty());
  EXPECT_TRUE(discDirections({direction(40, 0), direction(95, 0)}, {25, 100}).empty());
}

TEST(DiscDirections, TheRimStaysAboveTheHorizonForEveryCameraAbove) {
  for (const double theta : {0.0, 45.0, 80.0, 89.0})
    for (const HalfDiffAngles& angles :
         discDirections({direction(60, 180), direction(theta, 0)}, {60, 200})) {
      const DirectionPair pair = directionsFromHalfDiff(angles);
      EXPECT_GT(pair.toView.z(), 0);
      EXPECT_TRUE(std::isfinite(angles.phiDRad));
    }
}

}  // namespace
}  // namespace patina
