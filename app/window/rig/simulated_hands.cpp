#include "app/window/rig/simulated_hands.h"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <numbers>

#include "devices/simulated/live_rig.h"
#include "engine/acquire/two_shot_guide.h"

namespace patina {

namespace {

constexpr double kInk = 0.04, kPaper = 0.82;  ///< albedos of a print
constexpr double kBoardShare = 0.6;           ///< of the picture's width that a held board fills
constexpr double kNear = 0.62;                ///< of the way to the table at which it is held
constexpr double kLampFill = 36;              ///< of the sensor that paper under the lamp fills in a second

/// The board as a print of its own, white around it by half a square; `holeMm`: radius that is cut out.
LivePrint printOf(const Board& board, double holeMm = 0) {
  constexpr int kPixelsASquare = 64;
  Board drawn = board;
  LivePrint print;
  Result<Image> picture = drawBoardPixels(drawn, kPixelsASquare, kPixelsASquare / 2);
  if (!picture) return print;
  print.albedo = std::move(*picture);
  print.widthMm = board.widthMm() + board.squareMm;
  print.heightMm = board.heightMm() + board.squareMm;
  const int width = print.albedo.width(), height = print.albedo.height();
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      float& v = print.albedo.at(x, y);
      v = static_cast<float>(kInk + (kPaper - kInk) * v);
      const double dx = (x + 0.5) / width - 0.5, dy = (y + 0.5) / height - 0.5;
      if (std::hypot(dx * print.widthMm, dy * print.heightMm) < holeMm)
        v = std::numeric_limits<float>::quiet_NaN();
    }
  return print;
}

/// Lies on the table where it belongs.
LivePrint printOn(const PlacedBoard& placed, double holeMm = 0) {
  LivePrint print = printOf(placed.board, holeMm);
  print.worldFromPrint.linear() =
      Eigen::AngleAxisd(placed.turnDeg * std::numbers::pi / 180, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  print.worldFromPrint.translation() = Eigen::Vector3d(placed.centreMm.x(), placed.centreMm.y(), 0);
  return print;
}

LiveLamp lampAlong(const LiveRig& rig, const Eigen::Vector3d& toLight) {
  LiveLamp lamp;
  lamp.toLight = toLight.normalized();
  lamp.irradiance =
      Eigen::Array3d::Constant(kLampFill * std::numbers::pi * rig.description().radianceOfFullScaleSecond);
  return lamp;
}

}  // namespace

double SimulatedHands::squareThatFits(const Board& board) const {
  const Camera camera = rig_->camera();
  const double distance = kNear * camera.positionMm().norm();
  const double across = kBoardShare * camera.width / camera.intrinsics(0, 0) * distance;
  const double down = 0.75 * camera.height / camera.intrinsics(1, 1) * distance;
  return std::min(across / board.squaresX, down / board.squaresY);
}

void SimulatedHands::holdBoard(const Board& board, int view) {
  struct Stand {
    double x, y, nearer, tiltDeg, towardsDeg, turnDeg;
  };
  // Over the whole picture, tilted to all sides, nearer and farther.
  static constexpr Stand kStands[] = {
      {0.00, 0.00, 1.00, 4, 0, 0},       {-0.42, -0.38, 1.10, 30, 0, 2},    {0.42, -0.38, 1.05, 40, 90, -3},
      {0.42, 0.38, 1.10, 42, 180, 4},    {-0.42, 0.38, 1.05, 42, 270, -2},  {0.00, -0.44, 1.20, 46, 45, 5},
      {0.00, 0.44, 1.20, 46, 225, -5},   {-0.46, 0.00, 1.15, 46, 135, 8},   {0.46, 0.00, 1.15, 46, 315, -8},
      {-0.20, 0.15, 0.95, 48, 20, 12},   {0.22, -0.12, 0.95, 48, 200, -12}, {0.12, 0.20, 0.90, 46, 110, 3},
      {-0.15, -0.20, 0.90, 46, 290, -3}, {0.40, 0.42, 1.30, 30, 60, 90},    {-0.40, -0.42, 1.30, 30, 240, 90},
      {0.40, -0.42, 1.30, 25, 330, -15}, {-0.40, 0.42, 1.30, 25, 150, 7},
  };
  constexpr double kDegree = std::numbers::pi / 180;
  const Stand& stand = kStands[static_cast<std::size_t>(view) % std::size(kStands)];
  const Camera camera = rig_->camera();
  LivePrint print = printOf(board);
  const double focal = camera.intrinsics(0, 0);
  const Eigen::Matrix3d facing = Eigen::Vector3d(1, -1, -1).asDiagonal();
  // Tilted about an axis in the picture so that the side `towardsDeg` comes nearer (0 right, 90 up).
  const double towards = stand.towardsDeg * kDegree;
  const Eigen::Vector3d axis(std::sin(towards), std::cos(towards), 0);
  const Eigen::Matrix3d cameraFromBoard =
      Eigen::AngleAxisd(stand.tiltDeg * kDegree, axis).toRotationMatrix() * facing *
      Eigen::AngleAxisd(stand.turnDeg * kDegree, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  print.worldFromPrint.linear() = camera.cameraFromWorld.transpose() * cameraFromBoard;
  // As far from the picture's middle as the stand says, or as all of the board stays in the picture; and no
  // nearer than that.
  double distance = std::min(focal * board.widthMm() / (kBoardShare * camera.width) * stand.nearer,
                             0.8 * camera.positionMm().norm());
  const auto place = [&](double share) {
    const Eigen::Vector2d pixel(camera.intrinsics(0, 2) + share * stand.x * camera.width,
                                camera.intrinsics(1, 2) + share * stand.y * camera.height);
    const Eigen::Vector3d along = camera.cameraFromWorld * camera.rayFromPixel(pixel);
    print.worldFromPrint.translation() =
        camera.cameraFromWorld.transpose() * (along * (distance / along.z()) - camera.translationMm);
    for (const double x : {-0.5, 0.5})
      for (const double y : {-0.5, 0.5}) {
        const auto at = camera.pixelFromWorld(print.worldFromPrint *
                                              Eigen::Vector3d(x * print.widthMm, y * print.heightMm, 0));
        if (!at || at->x() < 1 || at->y() < 1 || at->x() > camera.width - 2 || at->y() > camera.height - 2)
          return false;
      }
    return true;
  };
  constexpr int kTries = 12;
  bool inside = false;
  for (int farther = 0; farther < kTries && !inside; ++farther, distance *= 1.06)
    for (double share = 1; share >= 0 && !inside; share -= 0.05) inside = place(share);
  rig_->put(OnTable::Nothing);
  // Light from behind the camera.
  rig_->light(lampAlong(*rig_, camera.cameraFromWorld.transpose() * Eigen::Vector3d(0.1, -0.2, -1)));
  rig_->show({print});
}

void SimulatedHands::layMirror(const PlacedBoard& markers) {
  rig_->put(OnTable::Mirror);
  rig_->light(lampAlong(*rig_, Eigen::Vector3d(0.2, -0.3, 1)));
  rig_->show({printOn(markers)});
}

void SimulatedHands::layPaper() {
  rig_->put(OnTable::WhitePaper);
  rig_->light(std::nullopt);
  rig_->show({});
}

void SimulatedHands::laySample() {
  rig_->put(OnTable::Sheet);
  rig_->light(std::nullopt);
  rig_->show({});
}

void SimulatedHands::coverLens(bool covered) {
  if (!covered) return rig_->show({});
  const Camera camera = rig_->camera();
  LivePrint cap;
  cap.albedo = Image(1, 1, 1, 0.0f);
  cap.widthMm = cap.heightMm = 1000;
  cap.worldFromPrint.linear() =
      camera.cameraFromWorld.transpose() * Eigen::Matrix3d(Eigen::Vector3d(1, -1, -1).asDiagonal());
  cap.worldFromPrint.translation() =
      camera.cameraFromWorld.transpose() * (Eigen::Vector3d(0, 0, 10) - camera.translationMm);
  rig_->show({cap});
}

void SimulatedHands::layMarkers(const PlacedBoard& markers, double holeRadiusMm) {
  rig_->show({printOn(markers, holeRadiusMm)});
}

void SimulatedHands::placeSample(bool tile) {
  rig_->put(tile ? OnTable::WhiteTile : OnTable::Sheet);
}

void SimulatedHands::moveCamera(const Eigen::Vector3d& toCamera, double distanceMm) {
  const Camera lens = rig_->camera();
  Camera stand = lookingAtCentre(toCamera, distanceMm);
  stand.width = lens.width;
  stand.height = lens.height;
  stand.intrinsics = lens.intrinsics;
  stand.distortion = lens.distortion;
  rig_->moveCamera(stand);
}

void SimulatedHands::moveLamp(const Eigen::Vector3d& toLight, double fullScalesASecond) {
  LiveLamp lamp;
  lamp.toLight = toLight.normalized();
  lamp.irradiance =
      Eigen::Array3d(1.0, 0.95, 0.88) * (fullScalesASecond * rig_->description().radianceOfFullScaleSecond);
  rig_->light(lamp);
}

}  // namespace patina
