#include "engine/calibration/screen_pose.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "engine/base/least_squares.h"
#include "engine/base/text.h"

namespace patina {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr std::size_t kFewestCorners = 6;
/// Corners are found to 0.1 px; beyond this something besides noise is at work.
constexpr double kMisfitPx = 0.4;

constexpr double kSquarePixels =
    0.002;  // pixels are square; sizes in whole centimetres make them look otherwise

Eigen::Matrix3d turned(const Eigen::Vector3d& turn) {
  const double angle = turn.norm();
  return angle == 0 ? Eigen::Matrix3d::Identity() : Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix();
}

/// A plane's frame in the world.
struct Frame {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d originMm = Eigen::Vector3d::Zero();
};

Frame frameOf(const PlacedBoard& board) {
  return {Eigen::AngleAxisd(board.turnDeg * kDegree, Eigen::Vector3d::UnitZ()).toRotationMatrix(),
          {board.centreMm.x(), board.centreMm.y(), 0}};
}

Eigen::Vector3d reflected(const Eigen::Vector3d& point, double heightMm) {
  return {point.x(), point.y(), 2 * heightMm - point.z()};
}

/// World of a board's frame: the board's pose before the camera turned about.
Camera cameraIn(const Camera& lens, const BoardPose& pose, const PlacedBoard& placed) {
  const Frame board = frameOf(placed);
  Camera camera = lens;
  camera.cameraFromWorld = pose.cameraFromBoard * board.rotation.transpose();
  camera.translationMm = pose.translationMm - camera.cameraFromWorld * board.originMm;
  return camera;
}

/// The screen whose board, reflected at the mirror, stands where `pose` says (x turned about).
Frame unmirrored(const Camera& camera, const BoardPose& pose, double mirrorHeightMm) {
  const Eigen::Matrix3d worldFromCamera = camera.cameraFromWorld.transpose();
  const Eigen::Vector3d x = -(worldFromCamera * pose.cameraFromBoard.col(0)),
                        y = worldFromCamera * pose.cameraFromBoard.col(1);
  Frame board;
  board.rotation.col(0) = reflected(x, 0);
  board.rotation.col(1) = reflected(y, 0);
  board.rotation.col(2) = board.rotation.col(0).cross(board.rotation.col(1));
  board.originMm = reflected(worldFromCamera * (pose.translationMm - camera.translationMm), mirrorHeightMm);
  return board;
}

/// The screen's frame of the frame of a board on it.
Frame screenOf(const Frame& board, const PlacedBoard& placed) {
  const Frame onScreen = frameOf(placed);
  Frame screen;
  screen.rotation = board.rotation * onScreen.rotation.transpose();
  screen.originMm = board.originMm - screen.rotation * onScreen.originMm;
  return screen;
}

double worstSd(const Eigen::Matrix3d& covariance) {
  return std::sqrt(
      std::max(0.0, Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvalues()[2]));
}

Error invalid(const std::string& what, const std::string& where, const std::string& tryThis) {
  return {ErrorCode::Invalid, what, where, tryThis};
}

double turnBetween(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  return Eigen::AngleAxisd(a.transpose() * b).angle() / kDegree;
}

}  // namespace

Eigen::Vector3d PlacedBoard::cornerMm(int id) const {
  const Eigen::Vector2d own = board.cornerMm(id);
  const double c = std::cos(turnDeg * kDegree), s = std::sin(turnDeg * kDegree);
  return {centreMm.x() + c * own.x() - s * own.y(), centreMm.y() + s * own.x() + c * own.y(), 0};
}

PlacedBoard boardOnScreen(const Board& board, const Screen& screen, double squarePx,
                          const Eigen::Vector2d& topLeftPx) {
  PlacedBoard placed;
  placed.board = board;
  const double mmPerPxX = screen.widthMm / screen.widthPx, mmPerPxY = screen.heightMm / screen.heightPx;
  placed.board.squareMm = squarePx * mmPerPxX;
  placed.centreMm = {(topLeftPx.x() + 0.5 * board.squaresX * squarePx) * mmPerPxX - 0.5 * screen.widthMm,
                     0.5 * screen.heightMm - (topLeftPx.y() + 0.5 * board.squaresY * squarePx) * mmPerPxY};
  return placed;
}

Result<ScreenPoseCalibration> calibrateScreenPose(const MirrorCalibrationInput& input) {
  if (!(input.screen.widthMm > 0 && input.screen.heightMm > 0))
    return invalid("the screen's size is not known", "screen",
                   "its lit area in millimetres, measured with a ruler");
  for (const PlacedBoard* placed : {&input.onSample, &input.onScreen})
    if (const auto problems = placed->board.validate(); !problems.empty())
      return invalid(problems.front(), "board", "");
  if (!input.mirroredView && !input.directView)
    return invalid("the screen's board is seen neither in the mirror nor directly", "",
                   "a flat mirror on the sample plane in which the camera sees the screen");
  if (input.sampleView.mirrored) return invalid("the board on the sample plane is seen in a mirror", "", "");
  const auto enough = [](const BoardView& view) { return view.corners.size() >= kFewestCorners; };
  if (!enough(input.sampleView))
    return invalid("only " + counted(input.sampleView.corners.size(), "corner") +
                       " of the board on the sample plane are seen",
                   "", "the whole board in the picture, beside the mirror");

  const Result<BoardPose> samplePose = poseOfBoard(input.camera, input.onSample.board, input.sampleView);
  if (!samplePose) return samplePose.error();
  const Camera camera = cameraIn(input.camera, *samplePose, input.onSample);
  if (!(camera.positionMm().z() > 0))
    return invalid("the camera would be below the sample plane", "", "is the board lying face up?");

  // A start from the view with more corners.
  const BoardView* mirrored =
      input.mirroredView && enough(*input.mirroredView) ? &*input.mirroredView : nullptr;
  const BoardView* direct = input.directView && enough(*input.directView) ? &*input.directView : nullptr;
  if (!mirrored && !direct)
    return invalid("too few corners of the screen's board are seen", "", "more of the screen in the mirror");
  if ((mirrored && !mirrored->mirrored) || (direct && direct->mirrored))
    return invalid("the direct and the mirrored view of the screen are mixed up", "", "");
  const BoardView& first = mirrored ? *mirrored : *direct;
  const Result<BoardPose> screenPose = poseOfBoard(input.camera, input.onScreen.board, first);
  if (!screenPose) return screenPose.error();
  Frame board;
  if (mirrored) {
    board = unmirrored(camera, *screenPose, input.mirrorHeightMm);
  } else {
    const Eigen::Matrix3d worldFromCamera = camera.cameraFromWorld.transpose();
    board.rotation = worldFromCamera * screenPose->cameraFromBoard;
    board.originMm = worldFromCamera * (screenPose->translationMm - camera.translationMm);
  }
  const Frame start = screenOf(board, input.onScreen);

  // All corners together: turns and shifts of camera and screen from this start.
  const auto cameraAt = [&](const Eigen::VectorXd& x) {
    Camera moved = camera;
    moved.cameraFromWorld = turned(x.head<3>()) * camera.cameraFromWorld;
    moved.translationMm = turned(x.head<3>()) * camera.translationMm + x.segment<3>(3);
    return moved;
  };
  const auto screenAt = [&](const Eigen::VectorXd& x) {
    return Frame{turned(x.segment<3>(6)) * start.rotation, start.originMm + x.segment<3>(9)};
  };
  std::array<double, 3> sums{};
  const auto residualsAt = [&](const Eigen::VectorXd& x, Eigen::VectorXd& residuals) {
    const Camera seen = cameraAt(x);
    const Frame screen = screenAt(x);
    std::size_t count = input.sampleView.corners.size() + (mirrored ? mirrored->corners.size() : 0) +
                        (direct ? direct->corners.size() : 0);
    residuals.resize(static_cast<Eigen::Index>(2 * count));
    Eigen::Index at = 0;
    sums = {};
    const auto add = [&](const BoardView& view, int part, const auto& world) {
      for (const BoardCorner& corner : view.corners) {
        const auto pixel = seen.pixelFromWorld(world(corner.id));
        if (!pixel) return false;
        residuals.segment<2>(at) = *pixel - corner.pixel;
        sums[part] += residuals.segment<2>(at).squaredNorm();
        at += 2;
      }
      return true;
    };
    const auto onScreen = [&](int id) {
      return Eigen::Vector3d(screen.rotation * input.onScreen.cornerMm(id) + screen.originMm);
    };
    return add(input.sampleView, 0, [&](int id) { return input.onSample.cornerMm(id); }) &&
           (!mirrored ||
            add(*mirrored, 1, [&](int id) { return reflected(onScreen(id), input.mirrorHeightMm); })) &&
           (!direct || add(*direct, 2, onScreen));
  };
  Eigen::VectorXd scale(12);
  scale << 1e-2, 1e-2, 1e-2, 1, 1, 1, 1e-2, 1e-2, 1e-2, 1, 1, 1;
  Eigen::VectorXd residuals;
  if (!residualsAt(Eigen::VectorXd::Zero(12), residuals))
    return invalid("the screen that the mirror shows would not be before the camera", "",
                   "is the mirror flat on the sample plane?");
  const LeastSquaresSolution solution = minimiseSquares(residualsAt, Eigen::VectorXd::Zero(12), scale);
  residualsAt(solution.x, residuals);
  const auto rms = [](double sum, std::size_t count) {
    return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : 0.0;
  };
  ScreenPoseCalibration result;
  result.camera = cameraAt(solution.x);
  result.screen = input.screen;
  const Frame screen = screenAt(solution.x);
  result.screen.worldFromScreen = screen.rotation;
  result.screen.originMm = screen.originMm;
  result.sampleRmsPx = rms(sums[0], input.sampleView.corners.size());
  result.mirroredRmsPx = rms(sums[1], mirrored ? mirrored->corners.size() : 0);
  result.directRmsPx = rms(sums[2], direct ? direct->corners.size() : 0);
  result.rmsPx = rms(solution.sumOfSquares, static_cast<std::size_t>(solution.residuals / 2));
  if (!solution.determined)
    return invalid("the corners don't determine where camera and screen are", "",
                   "more of both boards in the picture");
  const Eigen::MatrixXd covariance = solution.variance() * solution.inverseNormal;
  result.cameraAngleSdDeg = worstSd(covariance.block<3, 3>(0, 0)) / kDegree;
  result.screenAngleSdDeg = worstSd(covariance.block<3, 3>(6, 6)) / kDegree;
  result.screenPositionSdMm = worstSd(covariance.block<3, 3>(9, 9));
  // Camera centre c = -R^T t: moved by a turn w and a shift s of this parametrisation, dc = -R^T s (the turn
  // carries t along).
  result.cameraPositionSdMm = worstSd(covariance.block<3, 3>(3, 3));

  const Eigen::Vector3d toSample = -screen.originMm;
  if (!(screen.originMm.z() > 0))
    return invalid("the screen would be below the sample plane", "",
                   "does the mirror lie on the sample plane, face up? Is the mirror's height right?");
  if (!(screen.rotation.col(2).dot(toSample) > 0))
    return invalid("the screen would face away from the sample", "",
                   "is the right board on the right screen?");
  char text[240];
  const double pitch =
      input.screen.widthPx > 0 && input.screen.heightPx > 0
          ? input.screen.widthMm / input.screen.widthPx / (input.screen.heightMm / input.screen.heightPx)
          : 1;
  if (std::abs(pitch - 1) > kSquarePixels) {
    std::snprintf(text, sizeof text,
                  "the screen's width and height make pixels that are %.1f %% wider than high: measure the "
                  "lit area with a "
                  "ruler, what the screen says of itself is rounded",
                  100 * (pitch - 1));
    result.warnings.push_back(text);
  }
  if (result.rmsPx > kMisfitPx) {
    std::snprintf(text, sizeof text,
                  "the views don't fit together (sample %.2f px, mirror %.2f px, direct %.2f px): is the "
                  "mirror flat and in "
                  "the sample plane, are the boards' sizes right, is the screen's size right?",
                  result.sampleRmsPx, result.mirroredRmsPx, result.directRmsPx);
    result.warnings.push_back(text);
  }
  if (result.screenAngleSdDeg > 0.2 || result.screenPositionSdMm > 0.5) {
    std::snprintf(
        text, sizeof text,
        "the screen is known to %.2f degrees and %.2f mm only: show a larger board, bring the camera closer, "
        "or focus",
        result.screenAngleSdDeg, result.screenPositionSdMm);
    result.warnings.push_back(text);
  }
  return result;
}

Result<ScreenPoseCalibration> calibrateScreenPose(MirrorCalibrationInput input, const Image& photo,
                                                  const BoardDetectionOptions& options) {
  const auto missing = [](const std::string& which, const BoardDetection& found) {
    return Error{ErrorCode::NotFound, which + " is not seen: " + found.whyNot, "",
                 "one photograph with the board beside the mirror, and the screen's board in the mirror"};
  };
  BoardDetectionOptions look = options;
  look.side = BoardSide::Direct;
  const BoardDetection onSample = detectBoard(photo, input.onSample.board, look);
  if (!onSample.found) return missing("the board on the sample plane", onSample);
  input.sampleView = onSample.view;
  const BoardDetection direct = detectBoard(photo, input.onScreen.board, look);
  look.side = BoardSide::Mirrored;
  const BoardDetection mirrored = detectBoard(photo, input.onScreen.board, look);
  input.directView.reset();
  input.mirroredView.reset();
  if (direct.found) input.directView = direct.view;
  if (mirrored.found) input.mirroredView = mirrored.view;
  if (!mirrored.found && !direct.found) return missing("the screen's board in the mirror", mirrored);
  return calibrateScreenPose(input);
}

PoseDifference differenceOf(const Screen& a, const Screen& b) {
  return {turnBetween(a.worldFromScreen, b.worldFromScreen), (a.originMm - b.originMm).norm()};
}

PoseDifference differenceOf(const Camera& a, const Camera& b) {
  return {turnBetween(a.cameraFromWorld, b.cameraFromWorld), (a.positionMm() - b.positionMm()).norm()};
}

}  // namespace patina
