#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "engine/calibration/calibration_file.h"
#include "tests/calibration/ray_cast_photo.h"

namespace patina {
namespace {

using test::boardPicture;
using test::FlatPicture;
using test::lookAt;
using test::rayCast;
using testing::HasSubstr;

Camera lens() {
  Camera camera;
  camera.width = 640, camera.height = 480;
  camera.intrinsics << 760, 0, 322, 0, 761, 238, 0, 0, 1;
  return camera;
}

TEST(Recheck, ALensHoldsUntilItIsZoomed) {
  Board board;
  const FlatPicture picture = boardPicture(&board, 80);
  CalibrationRecord stored;
  stored.content = StoredCamera{lens(), IntrinsicVector::Zero(), board, 12};
  stored.residual = 0.05;
  const Camera camera = lookAt(lens(), {90, -80, 230}, {0, 0, 0}, 10);
  const Result<Recheck> same = recheckCamera(stored, rayCast(camera, {picture}, {}));
  ASSERT_TRUE(same.ok()) << same.error().sentence();
  EXPECT_TRUE(same->good) << same->sentence;
  Camera zoomed = camera;
  zoomed.intrinsics(0, 0) *= 1.06, zoomed.intrinsics(1, 1) *= 1.06;
  const Result<Recheck> other = recheckCamera(stored, rayCast(zoomed, {picture}, {}));
  ASSERT_TRUE(other.ok());
  EXPECT_FALSE(other->good) << other->sentence;
  EXPECT_THAT(other->sentence, HasSubstr("calibrate the camera again"));
  EXPECT_FALSE(recheckCamera(stored, Image(640, 480, 3, 0.4f)).ok()) << "no board in it";
  CalibrationRecord wrong;
  wrong.content = StoredEmission{};
  EXPECT_FALSE(recheckCamera(wrong, Image(640, 480, 3)).ok());
}

TEST(Recheck, ACameraThatMovedIsNoticed) {
  StoredScreenPose pose;
  pose.onSample.board = Board::forSamplePlane();
  const FlatPicture picture = boardPicture(&pose.onSample.board, 80);
  pose.camera = lookAt(lens(), {10, -150, 160}, {0, 0, 0}, 0);
  pose.screen.widthMm = 300, pose.screen.heightMm = 200;
  pose.onScreen.board = Board::forScreen(300, 200);
  CalibrationRecord stored;
  stored.content = pose;
  const Result<Recheck> same = recheckScreenPose(stored, rayCast(pose.camera, {picture}, {}));
  ASSERT_TRUE(same.ok()) << same.error().sentence();
  EXPECT_TRUE(same->good) << same->sentence;
  EXPECT_THAT(same->sentence, HasSubstr("on trust"));
  const Camera moved = lookAt(lens(), {14, -150, 160}, {0, 0, 0}, 0);
  const Result<Recheck> other = recheckScreenPose(stored, rayCast(moved, {picture}, {}));
  ASSERT_TRUE(other.ok());
  EXPECT_FALSE(other->good) << other->sentence;
  EXPECT_THAT(other->sentence, HasSubstr("repeat the mirror calibration"));
}

TEST(Recheck, ALampThatFadedIsNoticed) {
  const Image then(100, 80, 3, 0.6f), now(100, 80, 3, 0.58f);
  const CertifiedReflectance reflectance;
  WhiteTileOptions options;
  options.saturation = 1;
  const Result<WhiteTileCalibration> tile = calibrateWhiteTile(then, reflectance, options);
  ASSERT_TRUE(tile.ok()) << tile.error().sentence();
  CalibrationRecord stored;
  stored.content = StoredWhiteTile{reflectance, tile->mean, tile->relativeSd, tile->region, ""};
  EXPECT_TRUE(recheckWhiteTile(stored, then, options)->good);
  const Result<Recheck> faded = recheckWhiteTile(stored, now, options);
  ASSERT_TRUE(faded.ok());
  EXPECT_FALSE(faded->good);
  EXPECT_THAT(faded->sentence, HasSubstr("3.33 % darker"));
}

TEST(Recheck, ACurveThatNoLongerHoldsIsNoticed) {
  StoredResponse response;
  for (ResponseCurve& curve : response.curves)
    for (int i = 0; i <= 64; ++i) {
      curve.input.push_back(i / 64.0);
      curve.output.push_back(std::pow(i / 64.0, 2.2));
    }
  CalibrationRecord stored;
  stored.content = response;
  const auto photos = [](double gamma) {
    std::vector<ExposedPhoto> two;
    for (const double exposure : {1.0, 2.0}) {
      ExposedPhoto photo{"", Image(60, 60, 3), exposure};
      for (int y = 0; y < 60; ++y)
        for (int x = 0; x < 60; ++x)
          for (int c = 0; c < 3; ++c)
            photo.image.at(x, y, c) =
                static_cast<float>(std::pow((0.1 + 0.3 * x / 60) * exposure, 1 / gamma));
      two.push_back(photo);
    }
    return two;
  };
  EXPECT_TRUE(recheckResponse(stored, photos(2.2))->good);
  const Result<Recheck> other = recheckResponse(stored, photos(2.0));
  ASSERT_TRUE(other.ok());
  EXPECT_FALSE(other->good);
  EXPECT_FALSE(recheckResponse(stored, {photos(2.2)[0]}).ok());
}

}  // namespace
}  // namespace patina
