#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/calibration/board_detection.h"
#include "engine/geometry/camera.h"

namespace patina {

/// fx, fy, cx, cy, k1, k2, p1, p2, k3: the order of all nine-vectors here.
inline constexpr int kIntrinsicCount = 9;
using IntrinsicVector = Eigen::Matrix<double, kIntrinsicCount, 1>;
using IntrinsicMatrix = Eigen::Matrix<double, kIntrinsicCount, kIntrinsicCount>;

/// One photograph of the board.
struct CalibrationView {
  std::string name;  ///< for messages: the file
  BoardView view;
  bool use = true;  ///< false: taken out by the operator; its error is told all the same
};

struct CameraCalibrationOptions {
  int radialTerms = 3;          ///< 0 to 3 of k1, k2, k3; fewer for few views or a lens without distortion
  bool tangential = true;       ///< p1, p2
  bool oneFocalLength = false;  ///< fx = fy: for pixels known to be square
  double outlierFactor = 2.5;   ///< a view is flagged where its RMS is so many times the other views' median
};

/// How one photograph fits.
struct CalibratedView {
  std::string name;
  bool used = true;
  double rmsPx = 0, worstPx = 0;         ///< distance of a corner from its prediction
  std::vector<Eigen::Vector2d> errorPx;  ///< seen minus predicted, in the order of the view's corners
  Eigen::Matrix3d cameraFromBoard = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translationMm = Eigen::Vector3d::Zero();
  double distanceMm = 0, tiltDeg = 0;  ///< of the board: angle between its normal and the direction to it
  double tiltTowardsDeg = 0;           ///< which side of the board is nearer: 0 right, 90 top of the picture
  bool outlier = false;
  std::string remark;  ///< in words, where there is something to say
};

/// What the views reach, so that one can see what is missing.
struct CalibrationCoverage {
  static constexpr int kColumns = 8, kRows = 6;
  std::array<int, kColumns * kRows> corners{};  ///< in each cell of the picture, row 0 at the top
  double imageShare = 0;                        ///< of these cells that hold a corner
  double edgeShare = 0;  ///< the same of the cells along the rim, where distortion is decided
  /// Views by tilt: flat (below 15 degrees), then right, top, left, bottom nearer.
  std::array<int, 5> tilts{};
  double greatestTiltDeg = 0;
  double nearestMm = 0, farthestMm = 0;
  std::vector<std::string> advice;  ///< which views to add, most needed first; empty: enough
};

struct CameraCalibration {
  Camera camera;                                 ///< size and lens; its pose is the identity
  IntrinsicVector sd = IntrinsicVector::Zero();  ///< standard deviations, 0 for what was held fixed
  IntrinsicMatrix covariance = IntrinsicMatrix::Zero();
  double rmsPx = 0;       ///< sqrt(mean squared distance) over all corners of used views
  double cornerSdPx = 0;  ///< of one coordinate, degrees of freedom counted
  /// Largest standard deviation of where the lens puts a ray, pixels, over the cells of `coverage` that hold
  /// corners: what the uncertainties mean together. Where there were no corners it is larger.
  double predictionSdPx = 0;
  std::vector<CalibratedView> views;  ///< of all that were given
  CalibrationCoverage coverage;
  std::vector<std::string> warnings;
};

/// Intrinsics from views of a flat board, by Zhang's closed form (2000) and then least squares over lens and
/// poses together (OpenCV's lens model, capture format version 1). Uncertainties are from the Jacobian at the
/// solution, scaled by the residual; board errors and focus are not in them. Errors: Invalid (fewer than 3
/// usable views, different picture sizes, mirrored views, views that don't determine the lens: all
/// parallel), Cancelled. Cost: about 50 ms for 15 views of 54 corners.
Result<CameraCalibration> calibrateCamera(const Board& board, const std::vector<CalibrationView>& views,
                                          const CameraCalibrationOptions& options = {},
                                          const JobContext& job = {});

/// The same without lens: what the views reach so far, for the live picture, with a lens guessed from the
/// views (or `camera`, where there is one). Cost: below 1 ms a view.
CalibrationCoverage coverageOf(const Board& board, const std::vector<CalibrationView>& views,
                               const Camera* camera = nullptr);

/// Where a board stands before a known camera.
struct BoardPose {
  Eigen::Matrix3d cameraFromBoard = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translationMm = Eigen::Vector3d::Zero();
  double rmsPx = 0;
  double angleSdDeg = 0, positionSdMm = 0;  ///< along the worst direction, for corners as wrong as rmsPx says
};

/// Pose of the board by least squares, from the plane's closed form (both of its solutions are tried). Of a
/// mirrored view: the pose of the *virtual* board with x turned about, see screen_pose.h. Errors: Invalid
/// (fewer than 4 corners, or all on a line; another picture size than the camera's).
Result<BoardPose> poseOfBoard(const Camera& camera, const Board& board, const BoardView& view);

/// The camera (lens) with the pose of the board as its world: what places it over a sample plane on which the
/// board lies.
Camera cameraOverBoard(const Camera& camera, const BoardPose& pose);

}  // namespace patina
