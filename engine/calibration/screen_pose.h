#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/result.h"
#include "engine/calibration/camera_calibration.h"
#include "engine/screen/screen.h"

namespace patina {

/// A board in a plane of its own: on the sample plane (world frame) or on the screen (screen frame).
struct PlacedBoard {
  Board board;
  Eigen::Vector2d centreMm = Eigen::Vector2d::Zero();  ///< its middle, in the plane's frame
  double turnDeg = 0;                                  ///< counter-clockwise as drawn
  /// Corner in the plane's frame, mm (z = 0).
  Eigen::Vector3d cornerMm(int id) const;
};

/// The board as it is shown on a screen in whole pixels: square and place in pixels of the screen, from its
/// top left corner.
PlacedBoard boardOnScreen(const Board& board, const Screen& screen, double squarePx,
                          const Eigen::Vector2d& topLeftPx);

/// The mirror calibration of the frequency-domain paper, appendix A, with boards in place of the white
/// square: one photograph shows a board on the sample plane, beside a flat mirror, and in the mirror the
/// board that the screen shows. Directly seen corners of the screen's board may be added.
struct MirrorCalibrationInput {
  Camera camera;         ///< the lens; its pose is not read
  Screen screen;         ///< sizes only: millimetres and pixels; its pose is not read
  PlacedBoard onSample;  ///< the marker board; its place in the world
  PlacedBoard onScreen;
  double mirrorHeightMm = 0;  ///< of the reflecting surface over the sample plane: a front-surface mirror's
                              ///< thickness; or below it
  BoardView sampleView;       ///< direct
  std::optional<BoardView> mirroredView;  ///< the screen's board in the mirror
  std::optional<BoardView> directView;    ///< the screen's board seen past the sample
};

struct ScreenPoseCalibration {
  Camera camera;                                               ///< with its pose in the world
  Screen screen;                                               ///< with its pose
  double sampleRmsPx = 0, mirroredRmsPx = 0, directRmsPx = 0;  ///< 0 where there was no such view
  double rmsPx = 0;                                            ///< all corners together
  double screenAngleSdDeg = 0, screenPositionSdMm = 0;         ///< along their worst directions
  double cameraAngleSdDeg = 0, cameraPositionSdMm = 0;
  std::vector<std::string> warnings;  ///< where views disagree more than their corners' errors explain, ...
};

/// Camera position E and screen pose T, t from one photograph. The marker board gives the camera, the
/// mirrored board the virtual screen, reflected by the mirror's plane z = mirrorHeightMm; then all corners
/// together by least squares over the twelve numbers. Errors: Invalid (too few corners, neither mirrored nor
/// direct view, a screen that would lie below the sample plane or face away from it). Cost: below 50 ms.
Result<ScreenPoseCalibration> calibrateScreenPose(const MirrorCalibrationInput& input);

/// The same from the photograph: finds the boards first. `input`'s views are not read. Errors also: NotFound
/// where a board isn't seen (why, in words).
Result<ScreenPoseCalibration> calibrateScreenPose(MirrorCalibrationInput input, const Image& photo,
                                                  const BoardDetectionOptions& options = {});

/// How two poses of a screen differ.
struct PoseDifference {
  double angleDeg = 0, distanceMm = 0;
};
PoseDifference differenceOf(const Screen& a, const Screen& b);
PoseDifference differenceOf(const Camera& a, const Camera& b);

}  // namespace patina
