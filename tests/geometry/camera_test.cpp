#include "engine/geometry/camera.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

namespace patina {
namespace {

// OpenCV is the definition of the lens model; both compute in double.
constexpr double kPixelTolerance = 1e-8;
// The stated accuracy of undistortion, 1e-10 of the focal length, at f = 1000 px, and rounding.
constexpr double kUndistortTolerancePx = 2e-7;

Camera testCamera(double k1, double k2, double p1, double p2, double k3) {
  Camera camera;
  camera.width = 1200;
  camera.height = 900;
  camera.intrinsics << 1000, 0, 610, 0, 990, 440, 0, 0, 1;
  camera.distortion << k1, k2, p1, p2, k3;
  camera.cameraFromWorld = (Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()) *
                            Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 0.5).normalized()))
                               .toRotationMatrix();
  camera.translationMm = {12, -7, 400};
  return camera;
}

Eigen::Vector2d projectedByOpenCv(const Camera& camera, const Eigen::Vector3d& point) {
  cv::Mat rotation(3, 3, CV_64F), intrinsics(3, 3, CV_64F);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      rotation.at<double>(row, column) = camera.cameraFromWorld(row, column);
      intrinsics.at<double>(row, column) = camera.intrinsics(row, column);
    }
  }
  cv::Mat rodrigues;
  cv::Rodrigues(rotation, rodrigues);
  const cv::Vec3d translation(camera.translationMm.x(), camera.translationMm.y(), camera.translationMm.z());
  const std::vector<double> lens(camera.distortion.begin(), camera.distortion.end());
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(std::vector<cv::Point3d>{{point.x(), point.y(), point.z()}}, rodrigues, translation,
                    intrinsics, lens, pixels);
  return {pixels[0].x, pixels[0].y};
}

const Camera kCameras[] = {testCamera(0, 0, 0, 0, 0), testCamera(-0.25, 0.09, 0.001, -0.0007, -0.01),
                           testCamera(0.2, -0.1, -0.002, 0.003, 0.05)};

TEST(Camera, ProjectsAsOpenCvDoes) {
  for (const Camera& camera : kCameras) {
    for (double x = -120; x <= 120; x += 40) {
      for (double y = -90; y <= 90; y += 45) {
        const Eigen::Vector3d point(x, y, 0.1 * x);
        const auto pixel = camera.pixelFromWorld(point);
        ASSERT_TRUE(pixel);
        EXPECT_LT((*pixel - projectedByOpenCv(camera, point)).norm(), kPixelTolerance);
      }
    }
  }
}

TEST(Camera, FindsTheSamplePlaneBack) {
  for (const Camera& camera : kCameras) {
    for (int x = 0; x < camera.width; x += 109) {
      for (int y = 0; y < camera.height; y += 97) {
        const auto point = camera.samplePlaneFromPixel(Eigen::Vector2d(x, y));
        ASSERT_TRUE(point) << x << ", " << y;
        EXPECT_EQ(point->z(), 0.0);
        EXPECT_LT((projectedByOpenCv(camera, *point) - Eigen::Vector2d(x, y)).norm(), kUndistortTolerancePx);
      }
    }
  }
}

TEST(Camera, RayGoesThroughTheCentreAndThePoint) {
  for (const Camera& camera : kCameras) {
    const Eigen::Vector3d point(30, -20, 5);
    const Eigen::Vector3d ray = camera.rayFromPixel(*camera.pixelFromWorld(point));
    EXPECT_NEAR(ray.norm(), 1.0, 1e-12);
    EXPECT_LT((ray - (point - camera.positionMm()).normalized()).norm(), 1e-9);
  }
}

TEST(Camera, SeesNothingBehindItself) {
  const Camera& camera = kCameras[1];
  const Eigen::Vector3d forward = camera.cameraFromWorld.row(2);
  EXPECT_FALSE(camera.pixelFromWorld(camera.positionMm() - 10 * forward));
  EXPECT_FALSE(camera.pixelFromWorld(camera.positionMm()));
  EXPECT_TRUE(camera.pixelFromWorld(camera.positionMm() + 10 * forward));
}

TEST(Camera, SeesNothingBeyondTheFoldOfItsLens) {
  // r (1 - 0.5 r^2) grows until r = sqrt(2/3) and falls beyond: a second point would land on the same pixel.
  Camera camera = testCamera(-0.5, 0, 0, 0, 0);
  camera.cameraFromWorld = Eigen::Vector3d(1, -1, -1).asDiagonal();
  camera.translationMm = {0, 0, 100};
  EXPECT_TRUE(camera.pixelFromWorld({80, 0, 0}));
  EXPECT_FALSE(camera.pixelFromWorld({83, 0, 0}));
  EXPECT_FALSE(camera.pixelFromWorld({140, 0, 0}));
  const double farthest = 1000 * std::sqrt(2.0 / 3.0) * (2.0 / 3.0);
  EXPECT_TRUE(camera.samplePlaneFromPixel({610 + 0.99 * farthest, 440}));
  EXPECT_FALSE(camera.samplePlaneFromPixel({610 + 1.01 * farthest, 440}));
  EXPECT_TRUE(camera.rayFromPixel({610 + 2 * farthest, 440}).allFinite());
}

TEST(Camera, MissesThePlaneWhenLookingAway) {
  Camera camera = testCamera(0, 0, 0, 0, 0);
  camera.cameraFromWorld = Eigen::Matrix3d::Identity();  // looks along +z
  camera.translationMm = {0, 0, -100};                   // from z = 100: away from the sample
  EXPECT_FALSE(camera.samplePlaneFromPixel({610, 440}));
  camera.cameraFromWorld = Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitX()).toRotationMatrix();
  EXPECT_FALSE(camera.samplePlaneFromPixel({610, 440})) << "along the plane";
}

}  // namespace
}  // namespace patina
