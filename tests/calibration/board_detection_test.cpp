#include "engine/calibration/board_detection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
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

// Simulated photographs at 0.6 px blur, 8 bits and 0.4 % noise: what the window's gradients leave.
constexpr double kCornerTolerancePx = 0.08, kCornerRmsPx = 0.03;
// Of real photographs of a screen that are blurred by 1.8 to 3.7 px.
constexpr double kPlanarPx = 0.5;
// A picture without a board must not keep an operator waiting; the time limit is 500 ms, and the attempt that
// runs when it passes may finish. Twice that, for machines that do something else as well.
constexpr auto kPatience = std::chrono::milliseconds(2000);

Camera webcam() {
  Camera camera;
  camera.width = 800, camera.height = 600;
  camera.intrinsics << 900, 0, 405, 0, 905, 292, 0, 0, 1;
  camera.distortion << -0.12, 0.05, 0.0005, -0.0004, 0;
  return camera;
}

/// Largest and RMS distance of the corners from where they truly are.
std::pair<double, double> errorsOf(const BoardView& view, const Board& board, const Camera& camera) {
  double worst = 0, sum = 0;
  for (const BoardCorner& corner : view.corners) {
    const Eigen::Vector2d mm = board.cornerMm(corner.id);
    const double error = (*camera.pixelFromWorld({mm.x(), mm.y(), 0}) - corner.pixel).norm();
    worst = std::max(worst, error), sum += error * error;
  }
  return {worst, std::sqrt(sum / std::max<std::size_t>(1, view.corners.size()))};
}

TEST(BoardDetection, FindsACheckerboardFromAllSides) {
  Board board{BoardKind::Checkerboard, 10, 7, 20};
  const FlatPicture picture = boardPicture(&board, 80);
  for (const Eigen::Vector3d& position : {Eigen::Vector3d(0, 0, 330), {200, -50, 260}, {30, -240, 200}}) {
    for (const double roll : {0.0, 95.0}) {
      const Camera camera = lookAt(webcam(), position, {0, 0, 0}, roll);
      const BoardDetection found = detectBoard(rayCast(camera, {picture}, {}, {}), board);
      ASSERT_TRUE(found.found) << found.whyNot << " from " << position.transpose();
      EXPECT_EQ(found.view.corners.size(), 54u);
      const auto [worst, rms] = errorsOf(found.view, board, camera);
      EXPECT_LT(worst, kCornerTolerancePx) << position.transpose() << " rolled " << roll;
      EXPECT_LT(rms, kCornerRmsPx);
    }
  }
}

TEST(BoardDetection, ReadsMarkersOfABoardThatIsPartlyOutside) {
  Board board;
  const FlatPicture picture = boardPicture(&board, 80);
  const Camera camera = lookAt(webcam(), {90, 40, 170}, {60, 30, 0}, 20);
  const BoardDetection found = detectBoard(rayCast(camera, {picture}, {}, {}), board);
  ASSERT_TRUE(found.found) << found.whyNot;
  EXPECT_GE(found.view.corners.size(), 12u);
  EXPECT_LT(found.view.corners.size(), 48u);
  EXPECT_GE(found.markers.size(), 4u);
  const auto [worst, rms] = errorsOf(found.view, board, camera);
  EXPECT_LT(worst, kCornerTolerancePx);
  EXPECT_LT(rms, kCornerRmsPx);
}

TEST(BoardDetection, WorksOnLinearPicturesOfAnyScale) {
  Board board;
  const FlatPicture picture = boardPicture(&board, 80);
  const Camera camera = lookAt(webcam(), {100, -60, 280}, {0, 0, 0}, -10);
  test::RayCastOptions options;
  options.encoded = false;
  Image photo = rayCast(camera, {picture}, {}, options);
  for (float& v : photo.samples()) v *= 137.0f;
  const BoardDetection found = detectBoard(photo, board);
  ASSERT_TRUE(found.found) << found.whyNot;
  EXPECT_EQ(found.view.corners.size(), 48u);
  EXPECT_LT(errorsOf(found.view, board, camera).second, kCornerRmsPx);
  // The blur that was put in, widened by the pixel (1/12).
  EXPECT_NEAR(found.sharpnessPx, 0.65, 0.2);
}

TEST(BoardDetection, TellsAMirroredBoardFromADirectOne) {
  Board board;
  FlatPicture picture = boardPicture(&board, 80);
  const Camera camera = lookAt(webcam(), {80, -60, 300}, {0, 0, 0}, 5);
  Image photo = rayCast(camera, {picture}, {}, {});
  Image flipped = photo;
  for (int y = 0; y < photo.height(); ++y)
    for (int x = 0; x < photo.width(); ++x)
      for (int c = 0; c < 3; ++c) flipped.at(photo.width() - 1 - x, y, c) = photo.at(x, y, c);
  const BoardDetection direct = detectBoard(flipped, board);
  EXPECT_FALSE(direct.found);
  EXPECT_THAT(direct.whyNot, HasSubstr("mirror"));
  BoardDetectionOptions options;
  options.side = BoardSide::Mirrored;
  BoardDetection mirrored = detectBoard(flipped, board, options);
  ASSERT_TRUE(mirrored.found) << mirrored.whyNot;
  EXPECT_TRUE(mirrored.view.mirrored);
  for (BoardCorner& corner : mirrored.view.corners) corner.pixel.x() = photo.width() - 1 - corner.pixel.x();
  EXPECT_LT(errorsOf(mirrored.view, board, camera).second, kCornerRmsPx);
  options.side = BoardSide::Either;
  EXPECT_TRUE(detectBoard(flipped, board, options).view.mirrored);
  EXPECT_FALSE(detectBoard(photo, board, options).view.mirrored);
}

TEST(BoardDetection, SaysWhyThereIsNoneAndSoon) {
  const Board checkers{BoardKind::Checkerboard, 10, 7, 20}, charuco;
  Image noise(1920, 1080, 3), grey(1920, 1080, 3, 0.4f), black(1920, 1080, 3);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0, 1);
  for (float& v : noise.samples()) v = uniform(random);
  for (const Image* picture : {&noise, &grey, &black}) {
    for (const Board& board : {checkers, charuco}) {
      const BoardDetection found = detectBoard(*picture, board);
      EXPECT_FALSE(found.found);
      EXPECT_FALSE(found.whyNot.empty());
      EXPECT_LT(found.took, kPatience);
    }
  }
  EXPECT_THAT(detectBoard(black, charuco).whyNot, HasSubstr("black"));

  Board other{BoardKind::Checkerboard, 8, 6, 20};
  const Camera camera = lookAt(webcam(), {60, 30, 300}, {0, 0, 0}, 0);
  const Image photo = rayCast(camera, {boardPicture(&other, 80)}, {}, {});
  EXPECT_THAT(detectBoard(photo, checkers).whyNot, HasSubstr("7 x 5"));
  EXPECT_THAT(detectBoard(photo, charuco).whyNot, HasSubstr("markers"));
}

TEST(BoardDetection, FindsTheBoardOfThePhotographsOfAScreen) {
  PATINA_NEEDS_SHARED("calibration/mirror/board.png");
  Board board;
  board.squaresX = 7, board.squaresY = 5, board.squareMm = 30, board.markerShare = 0.5;
  const auto detected = [&](const char* name, BoardSide side) {
    const Result<PhotoFile> photo = readPhotoFile(test::sharedData() / "calibration/mirror" / name);
    EXPECT_TRUE(photo.ok());
    BoardDetectionOptions options;
    options.side = side;
    return detectBoard(photo->image, board, options);
  };
  const BoardDetection drawing = detected("board.png", BoardSide::Direct);
  ASSERT_TRUE(drawing.found) << drawing.whyNot;
  EXPECT_EQ(drawing.view.corners.size(), 24u);
  EXPECT_EQ(drawing.markers.size(), 17u);
  for (const char* name : {"01.png", "05.png", "pose_1.png", "pose_5.png"}) {
    const bool mirror = std::string(name).starts_with("pose");
    EXPECT_FALSE(detected(name, mirror ? BoardSide::Direct : BoardSide::Mirrored).found) << name;
    const BoardDetection found = detected(name, mirror ? BoardSide::Mirrored : BoardSide::Direct);
    ASSERT_TRUE(found.found) << name << ": " << found.whyNot;
    EXPECT_EQ(found.view.mirrored, mirror);
    EXPECT_GE(found.view.corners.size(), 8u);
    EXPECT_GE(found.markers.size(), 4u);
    // The lens isn't known, but a flat board stays a flat board: one homography takes the drawing's corners
    // (whose squares are rounded to whole pixels of the screen) to the photograph's, turned about where it is
    // mirrored. A wrong assignment of ids would leave a hundred pixels; what is left is lens distortion and
    // blur.
    std::vector<cv::Point2d> from, to, mapped;
    for (const BoardCorner& corner : found.view.corners) {
      const Eigen::Vector2d drawn = drawing.view.corners[static_cast<std::size_t>(corner.id)].pixel;
      from.emplace_back(drawn.x(), drawn.y());
      to.emplace_back(corner.pixel.x(), corner.pixel.y());
    }
    const cv::Mat homography = cv::findHomography(from, to);
    cv::perspectiveTransform(from, mapped, homography);
    double sum = 0;
    for (std::size_t i = 0; i < to.size(); ++i) sum += (to[i] - mapped[i]).dot(to[i] - mapped[i]);
    EXPECT_LT(std::sqrt(sum / to.size()), kPlanarPx) << name;
    EXPECT_EQ(cv::determinant(homography(cv::Rect(0, 0, 2, 2))) < 0, mirror) << name;
  }
}

}  // namespace
}  // namespace patina
