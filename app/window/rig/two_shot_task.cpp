#include "app/window/rig/two_shot_task.h"

#include "app/window/settings.h"
#include "engine/calibration/calibration_file.h"

namespace patina {

namespace {
const QString kRadius = QStringLiteral("rig/two_shot_radius_mm"),
              kHeight = QStringLiteral("rig/two_shot_height_mm"),
              kDistance = QStringLiteral("rig/two_shot_distance_mm"),
              kMarkers = QStringLiteral("rig/two_shot_markers");
}  // namespace

TwoShotTask::TwoShotTask(RigController& rig, QObject* parent) : QObject(parent), rig_(rig) {
  const Settings& settings = rig_.settings();
  const auto number = [&](const QString& key, double otherwise, double least) {
    bool good = false;
    const double value = settings.text(key).toDouble(&good);
    return good && value >= least ? value : otherwise;
  };
  radiusMm_ = number(kRadius, radiusMm_, 1);
  heightMm_ = number(kHeight, 0, -50);
  distanceMm_ = number(kDistance, distanceMm_, 20);
  markers_.board = boardRoundSample(radiusMm_);
  if (const QString known = settings.text(kMarkers); !known.isEmpty())
    if (const auto board = parseBoard(known.toStdString(), "settings")) markers_.board = *board;
  reflectance_.source = "entered";
}

TwoShotTask::~TwoShotTask() = default;

void TwoShotTask::setSample(double radiusMm, double heightMm, double distanceMm) {
  radiusMm_ = radiusMm;
  heightMm_ = heightMm;
  distanceMm_ = distanceMm;
  rig_.settings().set(kRadius, radiusMm);
  rig_.settings().set(kHeight, heightMm);
  rig_.settings().set(kDistance, distanceMm);
  Q_EMIT changed();
}

void TwoShotTask::setMarkers(const Board& board) {
  markers_.board = board;
  rig_.settings().set(kMarkers, QString::fromStdString(boardText(board)));
  Q_EMIT changed();
}

void TwoShotTask::setShots(std::vector<PlannedShot> shots, BasisPtr basis) {
  shots_ = std::move(shots);
  basis_ = std::move(basis);
  Q_EMIT changed();
}

Result<Camera> TwoShotTask::lens() const {
  const auto record = readCalibration(rig_.file("camera"), "camera");
  if (!record) return record.error();
  return std::get<StoredCamera>(record->content).camera;
}

TwoShotSetup TwoShotTask::setup() const {
  TwoShotSetup setup;
  setup.radiusMm = radiusMm_;
  setup.distanceMm = distanceMm_;
  setup.shots = shots_;
  setup.basis = basis_;
  setup.whiteReflectance = reflectance_.rgb;
  if (const auto record = readCalibration(rig_.file("camera-response"), "camera-response"); record) {
    const auto& stored = std::get<StoredResponse>(record->content);
    setup.conversion.response.assign(stored.curves.begin(), stored.curves.end());
  }
  return setup;
}

}  // namespace patina
