#include "engine/calibration/screen_pose.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "tests/calibration/ray_cast_photo.h"

namespace patina {
namespace {

using test::boardPicture;
using test::FlatMirror;
using test::FlatPicture;
using test::lookAt;
using test::rayCast;
using testing::HasSubstr;

// The stated bounds of the mirror calibration.
constexpr double kAngleDeg = 0.2, kDistanceMm = 0.5;

/// A desk: a screen leaning over the sample, a camera opposite, a mirror on the sample plane with the marker
/// board beside it.
struct Desk {
  Camera camera;
  Screen screen;
  PlacedBoard onSample, onScreen;
  FlatPicture samplePicture, screenPicture;
  FlatMirror mirror;

  explicit Desk(double mirrorHeightMm) {
    Camera lens;
    lens.width = 1280, lens.height = 960;
    lens.intrinsics << 1500, 0, 645, 0, 1502, 474, 0, 0, 1;
    lens.distortion << -0.09, 0.03, 0.0003, -0.0004, 0;
    camera = lookAt(lens, {12, -250, 270}, {0, 8, 0}, 2);
    screen.widthMm = 344, screen.heightMm = 193.5, screen.widthPx = 1920, screen.heightPx = 1080;
    // Looks down at the sample from +y, leaning.
    const double lean = 43 * M_PI / 180, turn = 3 * M_PI / 180;
    const Eigen::Vector3d normal =
        Eigen::Vector3d(std::sin(turn), -std::cos(lean), -std::sin(lean)).normalized();
    const Eigen::Vector3d x = Eigen::Vector3d(-1, 0.02, 0.01).cross(normal).cross(normal).normalized();
    screen.worldFromScreen.col(0) = -x;
    screen.worldFromScreen.col(2) = normal;
    screen.worldFromScreen.col(1) = normal.cross(-x);
    if (screen.worldFromScreen(2, 1) < 0) {
      screen.worldFromScreen.col(0) *= -1;
      screen.worldFromScreen.col(1) *= -1;
    }
    screen.originMm = {6, 225, 215};
    Board shown = Board::forScreen(screen.widthMm, screen.heightMm);
    const int squarePx = 128;
    screenPicture = boardPicture(&shown, squarePx, 0);
    onScreen = boardOnScreen(shown, screen, squarePx,
                             {(1920 - 12 * squarePx) / 2.0, (1080 - 7 * squarePx) / 2.0 + 20});
    // The picture fills only the board's part of the screen; the rest is white by the pattern window.
    Image whole(1920, 1080, 1, 0.8f);
    for (int py = 0; py < screenPicture.picture.height(); ++py)
      for (int px = 0; px < screenPicture.picture.width(); ++px)
        whole.at(px + (1920 - 12 * squarePx) / 2, py + (1080 - 7 * squarePx) / 2 + 20) =
            screenPicture.picture.at(px, py);
    screenPicture = {whole, screen.widthMm, screen.heightMm, screen.worldFromScreen, screen.originMm, true};
    onSample.board = Board::forSamplePlane();
    samplePicture = boardPicture(&onSample.board, 48, 0.5);
    onSample.centreMm = {0, -48};
    onSample.turnDeg = 8;
    samplePicture.originMm = {0, -48, 0};
    samplePicture.rotation = Eigen::AngleAxisd(8 * M_PI / 180, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    mirror.centreMm = {0, 45}, mirror.sizeMm = {150, 110}, mirror.heightMm = mirrorHeightMm;
  }

  MirrorCalibrationInput input() const {
    MirrorCalibrationInput in;
    in.camera = camera;
    in.camera.cameraFromWorld = Eigen::Matrix3d::Identity();
    in.camera.translationMm = Eigen::Vector3d::Zero();
    in.screen = screen;
    in.screen.worldFromScreen = Eigen::Matrix3d::Identity();
    in.screen.originMm = Eigen::Vector3d::Zero();
    in.onSample = onSample, in.onScreen = onScreen;
    in.mirrorHeightMm = mirror.heightMm;
    return in;
  }
};

TEST(ScreenPose, IsFoundFromOnePhotographOfAMirror) {
  for (const double height : {0.0, 3.0}) {
    const Desk desk(height);
    test::RayCastOptions options;
    options.samplesPerSide = 3;
    const Image photo = rayCast(desk.camera, {desk.samplePicture, desk.screenPicture}, desk.mirror, options);
    const Result<ScreenPoseCalibration> found = calibrateScreenPose(desk.input(), photo);
    ASSERT_TRUE(found.ok()) << found.error().sentence();
    const PoseDifference screen = differenceOf(found->screen, desk.screen),
                         camera = differenceOf(found->camera, desk.camera);
    EXPECT_LT(screen.angleDeg, kAngleDeg);
    EXPECT_LT(screen.distanceMm, kDistanceMm);
    EXPECT_LT(camera.angleDeg, kAngleDeg);
    EXPECT_LT(camera.distanceMm, kDistanceMm);
    // And the stated uncertainty is of the error's size.
    EXPECT_LT(screen.angleDeg, 5 * found->screenAngleSdDeg);
    EXPECT_LT(screen.distanceMm, 5 * found->screenPositionSdMm);
    EXPECT_LT(found->rmsPx, 0.1);
    EXPECT_TRUE(found->warnings.empty()) << found->warnings.front();
  }
}

TEST(ScreenPose, SaysWhenTheMirrorIsNotWhereItIsSaidToBe) {
  const Desk desk(0);
  // Perfect corners of a screen that is reflected 4 mm higher than said, and also seen directly: both can't
  // be true.
  MirrorCalibrationInput input = desk.input();
  const auto viewOf = [&](const PlacedBoard& placed, auto&& world, bool mirrored) {
    BoardView view{desk.camera.width, desk.camera.height, {}, mirrored};
    for (int id = 0; id < placed.board.cornerCount(); ++id) {
      const auto pixel = desk.camera.pixelFromWorld(world(placed.cornerMm(id)));
      if (pixel) view.corners.push_back({id, *pixel});
    }
    return view;
  };
  const auto onScreen = [&](const Eigen::Vector3d& x) {
    return Eigen::Vector3d(desk.screen.worldFromScreen * x + desk.screen.originMm);
  };
  input.sampleView = viewOf(
      desk.onSample, [](const Eigen::Vector3d& x) { return x; }, false);
  input.mirroredView = viewOf(
      desk.onScreen,
      [&](const Eigen::Vector3d& x) {
        const Eigen::Vector3d w = onScreen(x);
        return Eigen::Vector3d(w.x(), w.y(), 8 - w.z());
      },
      true);
  input.directView = viewOf(desk.onScreen, onScreen, false);
  const Result<ScreenPoseCalibration> wrong = calibrateScreenPose(input);
  ASSERT_TRUE(wrong.ok()) << wrong.error().sentence();
  ASSERT_FALSE(wrong->warnings.empty());
  EXPECT_THAT(wrong->warnings.front(), HasSubstr("don't fit together"));
  input.mirrorHeightMm = 4;
  const Result<ScreenPoseCalibration> right = calibrateScreenPose(input);
  ASSERT_TRUE(right.ok());
  EXPECT_TRUE(right->warnings.empty());
  EXPECT_LT(right->rmsPx, 1e-6);
}

TEST(ScreenPose, SaysWhichBoardIsMissing) {
  const Desk desk(0);
  test::RayCastOptions options;
  options.samplesPerSide = 1;
  const Image noMirror = rayCast(desk.camera, {desk.samplePicture}, {}, options);
  const Result<ScreenPoseCalibration> result = calibrateScreenPose(desk.input(), noMirror);
  ASSERT_FALSE(result.ok());
  EXPECT_THAT(result.error().what, HasSubstr("the screen's board in the mirror is not seen"));
  const Image noBoard = rayCast(desk.camera, {desk.screenPicture}, desk.mirror, options);
  const Result<ScreenPoseCalibration> none = calibrateScreenPose(desk.input(), noBoard);
  ASSERT_FALSE(none.ok());
  EXPECT_THAT(none.error().what, HasSubstr("the board on the sample plane is not seen"));
}

}  // namespace
}  // namespace patina
