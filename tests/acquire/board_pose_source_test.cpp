#include "engine/acquire/board_pose_source.h"

#include <gtest/gtest.h>

#include <numbers>

#include "engine/acquire/two_shot_guide.h"

namespace patina {
namespace {

constexpr double kExact = 1e-6;  // corners without error

/// Corners of the board that the sample leaves in sight, through the lens.
BoardView seenBy(const Camera& camera, const PlacedBoard& markers, double heightMm, double holeMm) {
  BoardView view;
  view.imageWidth = camera.width;
  view.imageHeight = camera.height;
  for (int id = 0; id < markers.board.cornerCount(); ++id) {
    const Eigen::Vector3d at = markers.cornerMm(id);
    if (at.head<2>().norm() < holeMm) continue;
    const auto pixel = camera.pixelFromWorld(at - Eigen::Vector3d(0, 0, heightMm));
    if (pixel) view.corners.push_back({id, *pixel});
  }
  return view;
}

Camera cameraAt(const Eigen::Vector3d& toCamera) {
  Camera camera = lookingAtCentre(toCamera.normalized(), 200);
  camera.width = 640, camera.height = 480;
  camera.intrinsics << 900, 0, 320, 0, 900, 240, 0, 0, 1;
  camera.distortion << -0.05, 0.01, 0.0003, -0.0002, 0;
  return camera;
}

TEST(BoardPoseSource, FindsTheCameraFromMarkersRoundTheSample) {
  const PlacedBoard markers{boardRoundSample(20), {3, -2}, 25};
  constexpr double kHeightMm = 4;
  for (const Eigen::Vector3d& toCamera :
       {Eigen::Vector3d(0.1, 0, 1), Eigen::Vector3d(1, 0.4, 0.8), Eigen::Vector3d(-0.3, -1, 0.7)}) {
    const Camera truth = cameraAt(toCamera);
    Camera lens = truth;
    lens.cameraFromWorld.setIdentity();
    lens.translationMm.setZero();
    const auto found = poseFromMarkers(lens, markers, kHeightMm, seenBy(truth, markers, kHeightMm, 22));
    ASSERT_TRUE(found.ok()) << found.error().sentence();
    EXPECT_LT((found->camera.positionMm() - truth.positionMm()).norm(), kExact * 200);
    EXPECT_LT((found->camera.cameraFromWorld - truth.cameraFromWorld).norm(), kExact);
  }
}

TEST(BoardPoseSource, CornersThatContradictEachOtherGiveNoPose) {
  const PlacedBoard markers{boardRoundSample(20), {0, 0}, 0};
  const Camera camera = cameraAt({0.2, 0.1, 1});
  BoardView view = seenBy(camera, markers, 0, 22);
  for (BoardCorner& corner : view.corners)
    if (corner.pixel.x() > 330) corner.pixel.x() -= 40;  // one half of it taken a square off
  const auto found = poseFromMarkers(camera, markers, 0, view);
  ASSERT_FALSE(found.ok());
  EXPECT_EQ(found.error().code, ErrorCode::NotFound);
}

TEST(BoardPoseSource, RoomForTheSampleIsLeft) {
  for (const double radius : {5.0, 20.0, 60.0}) {
    const Board board = boardRoundSample(radius);
    EXPECT_TRUE(board.validate().empty());
    int inSight = 0;
    for (int id = 0; id < board.cornerCount(); ++id)
      inSight += board.cornerMm(id).norm() > 1.15 * radius ? 1 : 0;
    EXPECT_GE(inSight, 24) << radius;
  }
}

}  // namespace
}  // namespace patina
