#include "devices/simulated/two_shot_rig.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <chrono>
#include <cmath>
#include <numbers>
#include <thread>

#include "devices/simulated/bundle_folder.h"
#include "engine/capture/two_shot_capture.h"
#include "tests/base/temp_folder.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using test::TempFolder;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;

/// A BRDF that any test can predict: a constant, plus a term in the angle between the light and the mirrored
/// view; unknown beyond `knownDeg` of the view.
class SmoothBrdf : public Brdf {
 public:
  SmoothBrdf(const Eigen::Array3d& base, double lobe, double knownDeg = 90)
      : Brdf({"smooth", "test", "", ""}),
        base_(base),
        lobe_(lobe),
        knownCosine_(std::cos(knownDeg * kPi / 180)) {}
  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    if (toLight.z() <= 0 || toView.z() < knownCosine_) return Eigen::Array3d::Constant(std::nan(""));
    const double mirrored = std::max(0.0, toLight.dot(Eigen::Vector3d(-toView.x(), -toView.y(), toView.z())));
    return base_ + lobe_ * std::pow(mirrored, 8);
  }

 private:
  Eigen::Array3d base_;
  double lobe_, knownCosine_;
};

Eigen::Vector3d direction(double thetaDeg, double azimuthDeg) {
  const double t = thetaDeg * kPi / 180, a = azimuthDeg * kPi / 180;
  return {std::sin(t) * std::cos(a), std::sin(t) * std::sin(a), std::cos(t)};
}

TwoShotScene scene() {
  TwoShotScene made;
  made.name = "smooth";
  made.brdfs = {std::make_shared<SmoothBrdf>(Eigen::Array3d(0.1, 0.2, 0.05), 0.6)};
  made.pixels = 48;
  made.rollDeg = 11;
  made.distortion << -0.05, 0.01, 0.0003, -0.0002, 0;
  made.samplesPerPixelSide = 2;
  made.poses = {{{direction(50, 175), direction(40, 0)}, {1.0}, false},
                {{direction(30, 100), direction(62, 30)}, {0.5}, false},
                {{direction(20, 10), direction(45, 200)}, {1.0}, true}};
  return made;
}

TEST(TwoShotRig, CamerasSeeTheWholeSampleFromTheirPlaces) {
  TwoShotScene wide = scene();
  wide.poses.push_back({{direction(40, 0), Eigen::Vector3d::UnitZ()}, {1.0}, false});  // straight above
  for (const bool rectangle : {false, true}) {
    if (rectangle) wide.widthMm = 140, wide.heightMm = 90;
    double reach = 0;
    for (const TwoShotPose& pose : wide.poses) {
      const Camera camera = twoShotCamera(wide, pose.directions);
      EXPECT_NEAR((camera.positionMm() - wide.distanceMm * pose.directions.toCamera).norm(), 0, 1e-9);
      EXPECT_NEAR(camera.cameraFromWorld.determinant(), 1, 1e-12);
      const auto centre = camera.pixelFromWorld(Eigen::Vector3d::Zero());
      ASSERT_TRUE(centre);
      EXPECT_NEAR((*centre - Eigen::Vector2d::Constant(23.5)).norm(), 0, 1e-9);
      for (int i = 0; i < 360; ++i) {
        const double a = i * kPi / 180, r = wide.radiusMm();
        const Eigen::Vector3d point = rectangle ? Eigen::Vector3d((i & 1 ? 70 : -70), (i & 2 ? 45 : -45), 0)
                                                : Eigen::Vector3d(r * std::cos(a), r * std::sin(a), 0);
        const auto at = camera.pixelFromWorld(point);
        ASSERT_TRUE(at);
        reach = std::max(reach, (*at - *centre).cwiseAbs().maxCoeff());
      }
    }
    EXPECT_LE(reach, 23.5);
    EXPECT_GT(reach, 20) << "the picture is not wasted";
  }
}

// Pixel = f_r cos(theta_i) E exposure, with the pixel's own view direction.
TEST(TwoShotRig, PixelsFollowTheCaptureFormat) {
  TwoShotScene made = scene();
  made.samplesPerPixelSide = 1;
  for (const TwoShotPose& pose : made.poses) {
    const auto image = exposeTwoShot(made, pose.directions, false, {});
    ASSERT_TRUE(image.ok());
    const Camera camera = twoShotCamera(made, pose.directions);
    int inside = 0;
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 48; ++x) {
        const auto point = camera.samplePlaneFromPixel({x, y});
        if (!point || point->head<2>().norm() > made.radiusMm()) {
          EXPECT_EQ(image->at(x, y, 1), 0.0f);
          continue;
        }
        ++inside;
        const Eigen::Vector3d toView = (camera.positionMm() - *point).normalized();
        const Eigen::Array3d expected = made.brdfs[0]->evaluate(pose.directions.toLight, toView) *
                                        pose.directions.toLight.z() * made.irradiance.array();
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(image->at(x, y, c), expected[c], 1e-6 * expected[c]);
      }
    EXPECT_GT(inside, 400);
  }
}

TEST(TwoShotRig, MoreRaysConverge) {
  TwoShotScene made = scene();
  made.samplesPerPixelSide = 4;
  const auto coarse = exposeTwoShot(made, made.poses[0].directions, false, {});
  made.samplesPerPixelSide = 12;
  const auto fine = exposeTwoShot(made, made.poses[0].directions, false, {});
  ASSERT_TRUE(coarse.ok() && fine.ok());
  const Camera camera = twoShotCamera(made, made.poses[0].directions);
  double worst = 0;
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 48; ++x) {
      const auto point = camera.samplePlaneFromPixel({x, y});
      // At the rim a pixel is a share of sample, and the share has a few per cent of sampling error.
      if (!point || point->head<2>().norm() > 0.9 * made.radiusMm()) continue;
      worst = std::max<double>(worst, std::abs(coarse->at(x, y, 1) / fine->at(x, y, 1) - 1));
    }
  EXPECT_LT(worst, 1e-3);
}

TEST(TwoShotRig, TheTileIsTheSampleInTheSameLight) {
  TwoShotScene made = scene();
  made.vignetting = 0.3;
  const auto tile = exposeTwoShot(made, made.poses[1].directions, true, {});
  const auto sample = exposeTwoShot(made, made.poses[1].directions, false, {});
  made.vignetting = 0;
  const auto even = exposeTwoShot(made, made.poses[1].directions, false, {});
  ASSERT_TRUE(tile.ok() && sample.ok() && even.ok());
  const double cosine = made.poses[1].directions.toLight.z();
  EXPECT_NEAR(tile->at(24, 24, 2), 0.987 / kPi * 1.9 * cosine, 1e-3);
  int darker = 0;
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 48; ++x) {
      if (sample->at(x, y, 0) == 0) continue;
      ASSERT_GT(tile->at(x, y, 0), 0) << "no pixel of the sample is without its white";
      // What the lens loses is lost in both, so the ratio doesn't know of it.
      const double ratio = sample->at(x, y, 0) / tile->at(x, y, 0);
      EXPECT_NEAR(ratio * 0.991 / kPi * 2.7 * cosine, even->at(x, y, 0), 2e-6);
      darker += sample->at(x, y, 0) < 0.9 * even->at(x, y, 0);
    }
  EXPECT_GT(darker, 50);
}

TEST(TwoShotRig, LabelsChooseTheMaterial) {
  TwoShotScene made = scene();
  made.widthMm = 120;
  made.heightMm = 80;
  made.samplesPerPixelSide = 1;
  made.distortion.setZero();
  made.brdfs = {std::make_shared<SmoothBrdf>(Eigen::Array3d(0.1, 0.1, 0.1), 0),
                std::make_shared<SmoothBrdf>(Eigen::Array3d(0.3, 0.3, 0.3), 0)};
  made.labels = Image(4, 2, 1);
  made.labels.at(3, 0) = 1;  // +x, +y
  const ShotDirections& directions = made.poses[0].directions;
  const auto image = exposeTwoShot(made, directions, false, {});
  ASSERT_TRUE(image.ok());
  const auto at = [&](double x, double y) {
    const auto pixel = twoShotCamera(made, directions).pixelFromWorld({x, y, 0});
    return image->at(static_cast<int>(std::lround(pixel->x())), static_cast<int>(std::lround(pixel->y())),
                     0) /
           (directions.toLight.z() * 2.7);
  };
  EXPECT_NEAR(at(45, 20), 0.3, 1e-6);
  EXPECT_NEAR(at(45, -20), 0.1, 1e-6);
  EXPECT_NEAR(at(10, 20), 0.1, 1e-6);
  EXPECT_NEAR(at(-45, 20), 0.1, 1e-6);
}

TEST(TwoShotRig, BundleReadsBack) {
  const TempFolder folder;
  TwoShotScene made = scene();
  made.poses[1].exposuresS = {1.0, 0.25, 0.0625};
  made.halfFloats = false;
  made.fullScale = 0.4;  // the long exposures clip
  JobContext job;
  job.seed = 4;
  const auto report = simulateTwoShot(made, folder / "deep" / "bundle", job);
  ASSERT_TRUE(report.ok()) << report.error().sentence();
  EXPECT_EQ(report->photos, 5u + 3u);
  EXPECT_GT(report->clippedSamples, 100u);
  EXPECT_EQ(report->unknownRays, 0u);
  EXPECT_EQ(captureKind(folder / "deep/bundle").value(), "two-shot");
  const auto capture = readTwoShotCapture(folder / "deep" / "bundle");
  ASSERT_TRUE(capture.ok()) << capture.error().sentence();
  EXPECT_TRUE(capture->ignoredKeys.empty());
  EXPECT_TRUE(capture->disc);
  EXPECT_DOUBLE_EQ(capture->radiusMm, made.radiusMm());
  EXPECT_EQ(capture->saturation, 0.4);
  EXPECT_EQ(capture->madeBy, kMadeBySimulatedRig);
  EXPECT_EQ(capture->whiteReflectance, made.whiteReflectance);
  ASSERT_EQ(capture->shots.size(), 5u);
  ASSERT_EQ(capture->whiteShots.size(), 3u);
  EXPECT_EQ(capture->shots[3].exposureS, 0.0625);
  EXPECT_TRUE(capture->shots[4].holdout);
  EXPECT_FALSE(capture->shots[3].holdout);
  EXPECT_NEAR((capture->shots[1].toLight - made.poses[1].directions.toLight).norm(), 0, 1e-12);
  const auto clean = exposeTwoShot(made, made.poses[1].directions, false, job);
  double squares = 0, pixels = 0;
  for (const TwoShotPhoto& shot : {capture->shots[1], capture->shots[3]}) {
    const auto photo = readPhoto(*capture, shot);
    ASSERT_TRUE(photo.ok());
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 48; ++x) {
        const double truth = clean->at(x, y, 0) * shot.exposureS;
        EXPECT_LE(photo->at(x, y, 0), 0.4f);
        if (truth > 0.39) continue;
        const double variance = 0.4 * 2e-5 * truth + std::pow(2e-4 * 0.4, 2);
        squares += std::pow(photo->at(x, y, 0) - truth, 2) / variance;
        ++pixels;
      }
  }
  EXPECT_GT(pixels, 2500);
  EXPECT_NEAR(squares / pixels, 1, 0.1);  // 3 % of statistical error
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 1);
}

TEST(TwoShotRig, IrradianceCanBeDeclaredInstead) {
  const TempFolder folder;
  TwoShotScene made = scene();
  made.declareIrradiance = true;
  ASSERT_TRUE(simulateTwoShot(made, folder / "bundle", {}).ok());
  const auto capture = readTwoShotCapture(folder / "bundle");
  ASSERT_TRUE(capture.ok()) << capture.error().sentence();
  EXPECT_TRUE(capture->whiteShots.empty());
  ASSERT_TRUE(capture->shots[0].normalIrradiance);
  EXPECT_EQ(*capture->shots[0].normalIrradiance, made.irradiance);
}

TEST(TwoShotRig, SameSeedSameBytesOnAnyThreadCount) {
  const TempFolder folder;
  JobContext job;
  job.seed = 12;
  job.threads = 1;
  ASSERT_TRUE(simulateTwoShot(scene(), folder / "one", job).ok());
  job.threads = 3;
  ASSERT_TRUE(simulateTwoShot(scene(), folder / "three", job).ok());
  job.seed = 13;
  ASSERT_TRUE(simulateTwoShot(scene(), folder / "other", job).ok());
  for (const std::string& name : test::everythingIn(folder / "one")) {
    EXPECT_EQ(test::readText(folder / "one" / name), test::readText(folder / "three" / name)) << name;
    if (name.ends_with(".exr")) {
      EXPECT_NE(test::readText(folder / "one" / name), test::readText(folder / "other" / name)) << name;
    }
  }
}

TEST(TwoShotRig, UnknownDirectionsAreLeftOutAndCounted) {
  TwoShotScene made = scene();
  made.brdfs = {std::make_shared<SmoothBrdf>(Eigen::Array3d(0.1, 0.1, 0.1), 0.6, 40)};
  std::size_t unknown = 0;
  const auto image = exposeTwoShot(made, made.poses[0].directions, false, {}, &unknown);
  ASSERT_TRUE(image.ok());
  EXPECT_GT(unknown, 500u);
  for (float sample : image->samples()) ASSERT_TRUE(std::isfinite(sample));
}

TEST(TwoShotRig, RefusesWhatMakesNoSense) {
  const TempFolder folder;
  TwoShotScene made = scene();
  made.brdfs.clear();
  made.irradiance.x() = -1;
  made.poses[0].directions.toLight.z() *= -1;
  made.poses[1].exposuresS.clear();
  const auto report = simulateTwoShot(made, folder / "bundle", {});
  ASSERT_FALSE(report.ok());
  EXPECT_EQ(report.error().code, ErrorCode::Invalid);
  for (const char* problem : {"no BRDF", "irradiance", "pose 0", "pose 1"})
    EXPECT_THAT(report.error().what, HasSubstr(problem));
  made = scene();
  made.labels = Image(2, 2, 1, 1.0f);
  EXPECT_EQ(made.validate().size(), 1u);
  made = scene();
  for (TwoShotPose& pose : made.poses) pose.holdout = true;
  EXPECT_EQ(made.validate().size(), 1u);
  EXPECT_TRUE(test::everythingIn(folder.path()).empty());
}

TEST(TwoShotRig, LeavesStrangersFoldersAlone) {
  const TempFolder folder;
  ASSERT_TRUE(simulateTwoShot(scene(), folder / "bundle", {}).ok());
  ASSERT_TRUE(simulateTwoShot(scene(), folder / "bundle", {}).ok()) << "its own work may be replaced";
  test::writeText(folder / "bundle" / "notes.txt", "mine");
  const auto refused = simulateTwoShot(scene(), folder / "bundle", {});
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, ErrorCode::Refused);
  EXPECT_EQ(test::readText(folder / "bundle" / "notes.txt"), "mine");
}

TEST(TwoShotRig, StopsWithinATenthOfASecond) {
  const TempFolder folder;
  TwoShotScene made = scene();
  made.pixels = 2000;
  made.samplesPerPixelSide = 8;
  std::stop_source source;
  JobContext job;
  job.stop = source.get_token();
  std::chrono::steady_clock::time_point asked;
  std::jthread stopper([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(150));
    asked = std::chrono::steady_clock::now();
    source.request_stop();
  });
  const auto report = simulateTwoShot(made, folder / "bundle", job);
  const auto stopped = std::chrono::steady_clock::now();
  ASSERT_FALSE(report.ok());
  EXPECT_EQ(report.error().code, ErrorCode::Cancelled);
  // A tenth of a second by the rule, twice that where the machine is busy with something else.
  EXPECT_LT(std::chrono::duration<double>(stopped - asked).count(), 0.2);
  EXPECT_TRUE(test::everythingIn(folder.path()).empty());
}

}  // namespace
}  // namespace patina
