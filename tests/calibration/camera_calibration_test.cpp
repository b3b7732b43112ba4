#include "engine/calibration/camera_calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <random>

#include "engine/image/photo_file.h"
#include "tests/calibration/ray_cast_photo.h"
#include "tests/test_data.h"

namespace patina {
namespace {

using test::boardPicture;
using test::FlatPicture;
using test::lookAt;
using test::rayCast;
using testing::HasSubstr;

// The stated bound for the real photographs: what a careful calibration of them reaches.
constexpr double kRealRmsPx = 0.20;
// The stated bound for simulated views: of the focal length; the principal point likewise, over the picture's
// width.
constexpr double kIntrinsicsTolerance = 0.001;

std::vector<CalibrationView> realViews(const Board& board) {
  std::vector<CalibrationView> views;
  for (int i = 1; i <= 14; ++i) {
    if (i == 10) continue;  // there is none
    const std::string name = std::string("left") + (i < 10 ? "0" : "") + std::to_string(i) + ".jpg";
    const Result<PhotoFile> photo = readPhotoFile(test::sharedData() / "calibration/chessboard" / name);
    EXPECT_TRUE(photo.ok()) << photo.error().sentence();
    const BoardDetection found = detectBoard(photo->image, board);
    EXPECT_TRUE(found.found) << name << ": " << found.whyNot;
    if (found.found) views.push_back({name, found.view, true});
  }
  return views;
}

TEST(CameraCalibration, FitsTheRealChessboards) {
  PATINA_NEEDS_SHARED("calibration/chessboard/left01.jpg");
  const Board board{BoardKind::Checkerboard, 10, 7, 25};
  const std::vector<CalibrationView> views = realViews(board);
  ASSERT_EQ(views.size(), 13u);
  const Result<CameraCalibration> result = calibrateCamera(board, views);
  ASSERT_TRUE(result.ok()) << result.error().sentence();
  EXPECT_LE(result->rmsPx, kRealRmsPx);
  // OpenCV's own calibration (fx = fy there, and coarser corners: its mean error is 0.39 px) within what both
  // are uncertain by.
  EXPECT_NEAR(result->camera.intrinsics(0, 0), 535.9, 5);
  EXPECT_NEAR(result->camera.intrinsics(1, 1), 535.9, 5);
  EXPECT_NEAR(result->camera.intrinsics(0, 2), 342.3, 4);
  EXPECT_NEAR(result->camera.intrinsics(1, 2), 235.6, 4);
  EXPECT_NEAR(result->camera.distortion[0], -0.266, 0.03);
  EXPECT_THAT(result->coverage.advice.front(), HasSubstr("top left"));  // where these views have no corner
}

Camera truth() {
  Camera camera;
  camera.width = 720, camera.height = 540;
  camera.intrinsics << 830, 0, 368, 0, 832, 262, 0, 0, 1;
  camera.distortion << -0.14, 0.06, 0.0006, -0.0005, -0.01;
  return camera;
}

std::vector<CalibrationView> simulatedViews(const Board& board, const FlatPicture& picture) {
  const Eigen::Vector3d positions[] = {{0, 0, 270},      {150, 0, 230},   {-150, 20, 230},  {20, 140, 220},
                                       {-10, -150, 220}, {120, 120, 220}, {-110, 110, 230}, {-120, -110, 210},
                                       {130, -100, 215}, {60, 30, 200},   {-70, 20, 300},   {0, 90, 310}};
  const Eigen::Vector3d targets[] = {{0, 0, 0},    {15, 10, 0},   {-20, 0, 0}, {0, 15, 0},
                                     {10, -15, 0}, {-20, -10, 0}, {20, -8, 0}, {-15, 12, 0},
                                     {18, 10, 0},  {0, 0, 0},     {35, 25, 0}, {-40, -20, 0}};
  std::vector<CalibrationView> views;
  for (int i = 0; i < 12; ++i) {
    const Camera camera = lookAt(truth(), positions[i], targets[i], 15.0 * i);
    test::RayCastOptions options;
    options.seed = 10 + i;
    options.samplesPerSide = 3;
    const BoardDetection found = detectBoard(rayCast(camera, {picture}, {}, options), board);
    EXPECT_TRUE(found.found) << i << ": " << found.whyNot;
    views.push_back({"view " + std::to_string(i), found.view, true});
  }
  return views;
}

TEST(CameraCalibration, RecoversASimulatedLens) {
  Board board = Board::forCamera();
  board.squareMm = 16;
  const FlatPicture picture = boardPicture(&board, 80);
  std::vector<CalibrationView> views = simulatedViews(board, picture);
  const Result<CameraCalibration> result = calibrateCamera(board, views);
  ASSERT_TRUE(result.ok()) << result.error().sentence();
  const Camera expected = truth();
  for (const int axis : {0, 1}) {
    EXPECT_NEAR(result->camera.intrinsics(axis, axis) / expected.intrinsics(axis, axis), 1,
                kIntrinsicsTolerance);
    EXPECT_NEAR(result->camera.intrinsics(axis, 2), expected.intrinsics(axis, 2), kIntrinsicsTolerance * 720);
  }
  // What matters of the distortion is where it puts rays.
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(20, 20), {700, 30}, {360, 270}, {40, 500}, {690, 520}}) {
    const Eigen::Vector3d ray = expected.rayFromPixel(pixel);
    EXPECT_LT((*result->camera.pixelFromWorld(ray * 100) - pixel).norm(), 0.35) << pixel.transpose();
  }
  // The uncertainties cover the errors, and aren't so wide that they cover anything.
  const auto off = [&](double found, double wanted, int index) {
    EXPECT_LT(std::abs(found - wanted), 5 * result->sd[index]) << index;
    EXPECT_GT(result->sd[index], 0) << index;
  };
  off(result->camera.intrinsics(0, 0), 830, 0);
  off(result->camera.intrinsics(1, 1), 832, 1);
  off(result->camera.intrinsics(0, 2), 368, 2);
  off(result->camera.intrinsics(1, 2), 262, 3);
  EXPECT_LT(result->sd[0], 1.0);
  EXPECT_LT(result->rmsPx, 0.06);
  EXPECT_NEAR(result->views[0].tiltDeg, 0, 1);
  EXPECT_NEAR(result->views[1].tiltDeg, std::atan2(135, 230) * 180 / M_PI, 3);

  // What the views reach, and what is asked for next.
  const CalibrationCoverage one = coverageOf(board, {views[0]}), all = coverageOf(board, views);
  EXPECT_LT(one.greatestTiltDeg, 3);
  EXPECT_THAT(one.advice.front(), HasSubstr("tilt the board"));
  EXPECT_THAT(one.advice.back(), HasSubstr("9 further views"));
  EXPECT_GT(all.imageShare, one.imageShare);
  EXPECT_GT(all.greatestTiltDeg, 25);
  EXPECT_LT(all.advice.size(), one.advice.size());
  std::size_t corners = 0, seen = 0;
  for (const CalibrationView& view : views) seen += view.view.corners.size();
  for (const int cell : all.corners) corners += static_cast<std::size_t>(cell);
  EXPECT_EQ(corners, seen);
  EXPECT_FALSE(calibrateCamera(board, {views[0], views[0], views[0]}).ok())
      << "parallel views tell no focal length";
  EXPECT_FALSE(calibrateCamera(board, {views[0], views[1]}).ok());
  JobContext stopped;
  std::stop_source source;
  source.request_stop();
  stopped.stop = source.get_token();
  EXPECT_EQ(calibrateCamera(board, views, {}, stopped).error().code, ErrorCode::Cancelled);

  // A view that was shaken while its corners were found is flagged, and taking it out helps.
  std::vector<CalibrationView> shaken = views;
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0, 0.6);
  for (BoardCorner& corner : shaken[3].view.corners)
    corner.pixel += Eigen::Vector2d(normal(random), normal(random));
  const Result<CameraCalibration> worse = calibrateCamera(board, shaken);
  ASSERT_TRUE(worse.ok());
  for (int i = 0; i < 12; ++i) EXPECT_EQ(worse->views[i].outlier, i == 3) << i;
  EXPECT_THAT(worse->views[3].remark, HasSubstr("take it out"));
  shaken[3].use = false;
  const Result<CameraCalibration> without = calibrateCamera(board, shaken);
  ASSERT_TRUE(without.ok());
  EXPECT_LT(without->rmsPx, 0.5 * worse->rmsPx);
  EXPECT_FALSE(without->views[3].used);
  EXPECT_GT(without->views[3].rmsPx, 0.5);
}

}  // namespace
}  // namespace patina
