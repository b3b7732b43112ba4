#include "engine/acquire/board_pose_source.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/calibration/board_detection.h"

namespace patina {

namespace {

class BoardPoseSource : public PoseSource {
 public:
  BoardPoseSource(const Camera& lens, const PlacedBoard& markers, double heightMm)
      : lens_(lens), markers_(markers), heightMm_(heightMm) {}
  Result<PoseEstimate> poseIn(const Image& linear) override {
    BoardDetectionOptions options;
    options.timeLimit = std::chrono::milliseconds(2000);
    const BoardDetection found = detectBoard(linear, markers_.board, options);
    if (!found.found)
      return Error{ErrorCode::NotFound, "the markers round the sample are not seen: " + found.whyNot, "",
                   "light them evenly, and take what hides them away"};
    return poseFromMarkers(lens_, markers_, heightMm_, found.view);
  }

 private:
  Camera lens_;
  PlacedBoard markers_;
  double heightMm_;
};

}  // namespace

std::unique_ptr<PoseSource> boardPoseSource(const Camera& lens, const PlacedBoard& markers,
                                            double sampleHeightMm) {
  return std::make_unique<BoardPoseSource>(lens, markers, sampleHeightMm);
}

Result<PoseEstimate> poseFromMarkers(const Camera& lens, const PlacedBoard& markers, double sampleHeightMm,
                                     const BoardView& view) {
  const Result<BoardPose> pose = poseOfBoard(lens, markers.board, view);
  if (!pose) return pose.error();
  // Corners that were taken for others, where the sample splits the board: no pose explains them together.
  constexpr double kMostPx = 2;
  if (pose->rmsPx > kMostPx)
    return Error{ErrorCode::NotFound,
                 "the markers round the sample contradict each other: some are misread, or the board is not "
                 "flat, or another one than was said",
                 "", "come nearer, light them evenly, and check the side of their squares"};
  PoseEstimate estimate;
  // World to board: the board's turn and place undone, and the sample's surface is higher than the print.
  const Eigen::Matrix3d boardFromWorld =
      Eigen::AngleAxisd(-markers.turnDeg * std::numbers::pi / 180, Eigen::Vector3d::UnitZ())
          .toRotationMatrix();
  const Eigen::Vector3d origin(markers.centreMm.x(), markers.centreMm.y(), -sampleHeightMm);
  estimate.camera = lens;
  estimate.camera.cameraFromWorld = pose->cameraFromBoard * boardFromWorld;
  estimate.camera.translationMm = pose->translationMm - estimate.camera.cameraFromWorld * origin;
  estimate.residualPx = pose->rmsPx;
  estimate.tiltUncertaintyDeg = pose->angleSdDeg;
  estimate.distanceUncertaintyMm = pose->positionSdMm;
  return estimate;
}

Board boardRoundSample(double radiusMm) {
  Board board;
  // Coarse markers: seen at a slant they are what is lost first.
  board.dictionary = "4x4_250";
  board.markerShare = 0.6;
  board.firstMarker = 32;
  board.squaresX = board.squaresY = 9;
  constexpr double kHiddenSquares = 5;  // across, of nine
  constexpr double kLeastMm = 8;
  board.squareMm = std::max(kLeastMm, std::ceil(2 * radiusMm / kHiddenSquares));
  return board;
}

}  // namespace patina
