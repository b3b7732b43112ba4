#include "engine/acquire/two_shot_guide.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace patina {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kPoints = 120;  ///< of the sample: the error metric is within a per cent of that with 300
/// Parts of a movement below these are left out of the sentence: nobody moves a stand by less.
constexpr double kSmallestDeg = 0.5, kSmallestMm = 3;

double degreesBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) / kDegree;
}

/// The movement along the sphere from one direction to another: degrees to the left and up, for somebody who
/// stands at `viewer` and looks at the sample.
struct Movement {
  double leftDeg = 0, upDeg = 0;
};
Movement movement(const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Eigen::Vector3d& viewer) {
  Movement move;
  const Eigen::Vector3d tangent = to - from * from.dot(to);
  if (tangent.norm() < 1e-12) return move;
  const Eigen::Vector3d step = tangent.normalized() * degreesBetween(from, to);
  Eigen::Vector3d right = (-viewer).cross(Eigen::Vector3d::UnitZ());
  // Straight above there is no right hand but the world's.
  right = right.norm() > 1e-6 ? right.normalized() : Eigen::Vector3d::UnitX();
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ() - from * from.z();
  up = up.norm() > 1e-6 ? up.normalized() : Eigen::Vector3d(from.cross(right));
  move.leftDeg = -step.dot(right);
  move.upDeg = step.dot(up);
  return move;
}

std::string amount(double value, const char* unit) {
  char text[48];
  value = std::abs(value);
  std::snprintf(text, sizeof text, value < 2 ? "%.1f %s" : "%.0f %s", value, unit);
  return text;
}

std::vector<Eigen::Vector3d> rim(const TwoShotSetup& setup) {
  std::vector<Eigen::Vector3d> points;
  constexpr int kRim = 24;
  for (int i = 0; i < kRim && setup.disc; ++i)
    points.emplace_back(setup.radiusMm * std::cos(2 * std::numbers::pi * i / kRim),
                        setup.radiusMm * std::sin(2 * std::numbers::pi * i / kRim), 0);
  for (const double x : {-0.5, 0.5})
    for (const double y : {-0.5, 0.5})
      if (!setup.disc) points.emplace_back(x * setup.widthMm, y * setup.heightMm, 0);
  return points;
}

}  // namespace

std::string moveSentence(double leftDeg, double upDeg, double closerMm, double smallestDeg,
                         double smallestMm) {
  std::vector<std::string> parts;
  if (std::abs(leftDeg) >= smallestDeg)
    parts.push_back(amount(leftDeg, "degrees") + (leftDeg > 0 ? " left" : " right"));
  if (std::abs(upDeg) >= smallestDeg)
    parts.push_back(amount(upDeg, "degrees") + (upDeg > 0 ? " up" : " down"));
  if (std::abs(closerMm) >= smallestMm)
    parts.push_back((std::abs(closerMm) < 9.5 ? amount(closerMm, "mm") : amount(closerMm / 10, "cm")) +
                    (closerMm > 0 ? " closer" : " back"));
  if (parts.empty()) return "Hold still: it is where it should be.";
  std::string sentence = "Move ";
  for (std::size_t i = 0; i < parts.size(); ++i)
    sentence += (i == 0 ? "" : i + 1 == parts.size() ? " and " : ", ") + parts[i];
  return sentence + ".";
}

Camera lookingAtCentre(const Eigen::Vector3d& toCamera, double distanceMm) {
  Camera camera;
  camera.width = camera.height = 1000;
  camera.intrinsics << 300, 0, 499.5, 0, 300, 499.5, 0, 0, 1;
  const Eigen::Vector3d forward = -toCamera.normalized();
  const bool above = std::hypot(forward.x(), forward.y()) < 1e-6;
  const Eigen::Vector3d right =
      forward.cross(above ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ()).normalized();
  camera.cameraFromWorld << right.transpose(), forward.cross(right).transpose(), forward.transpose();
  camera.translationMm = -camera.cameraFromWorld * (toCamera.normalized() * distanceMm);
  return camera;
}

TwoShotGuide::TwoShotGuide(const TwoShotSetup& setup) : setup_(setup) {
  if (!setup_.basis) return;
  metric_.emplace(setup_.basis, setup_.region, setup_.eta);
  for (const PlannedShot& shot : setup_.shots)
    planned_.push_back(
        rows(lookingAtCentre(shot.directions.toCamera, setup_.distanceMm), shot.directions.toLight));
  plannedError_ = error(std::vector<Placed>(setup_.shots.size()));
}

RowFactor TwoShotGuide::rows(const Camera& camera, const Eigen::Vector3d& toLight) const {
  TwoShotCapture sample;
  sample.disc = setup_.disc;
  sample.radiusMm = setup_.radiusMm;
  sample.widthMm = setup_.widthMm;
  sample.heightMm = setup_.heightMm;
  TwoShotPhoto photo;
  photo.camera = camera;
  photo.toLight = toLight;
  const SeenPicture seen = seenPicture(sample, photo, kPoints);
  const BasisRows rows = setup_.basis->rows(seen.directions);
  return reduceRows(rows.components, std::sqrt(kEtaRows / kPoints), kSearchTolerance);
}

double TwoShotGuide::error(const std::vector<Placed>& placed) const {
  if (!metric_) return -1;
  std::vector<RowFactor> made;
  made.reserve(placed.size());
  std::vector<const RowFactor*> all;
  for (std::size_t i = 0; i < placed.size(); ++i) {
    if (i < setup_.holdout.size() && setup_.holdout[i]) continue;  // a fit doesn't read it
    if (!placed[i].camera && !placed[i].toLight) {
      all.push_back(&planned_[i]);
      continue;
    }
    const ShotDirections& plan = setup_.shots[i].directions;
    made.push_back(rows(placed[i].camera.value_or(lookingAtCentre(plan.toCamera, setup_.distanceMm)),
                        placed[i].toLight.value_or(plan.toLight)));
    all.push_back(&made.back());
  }
  return metric_->training(stack(all));
}

bool TwoShotGuide::sampleInPicture(const Camera& camera) const {
  return std::ranges::all_of(rim(setup_), [&](const Eigen::Vector3d& point) {
    const auto pixel = camera.pixelFromWorld(point);
    return pixel && pixel->x() >= 0 && pixel->y() >= 0 && pixel->x() <= camera.width - 1 &&
           pixel->y() <= camera.height - 1;
  });
}

CameraGuide TwoShotGuide::camera(std::size_t shot, const std::vector<Placed>& placed,
                                 const Camera& now) const {
  const auto start = std::chrono::steady_clock::now();
  CameraGuide guide;
  const Eigen::Vector3d position = now.positionMm(), wanted = setup_.shots[shot].directions.toCamera;
  guide.toCamera = position.normalized();
  guide.offDeg = degreesBetween(guide.toCamera, wanted);
  const Movement move = movement(guide.toCamera, wanted, guide.toCamera);
  guide.leftDeg = move.leftDeg;
  guide.upDeg = move.upDeg;
  guide.closerMm = position.norm() - setup_.distanceMm;
  guide.aimOffDeg = degreesBetween(now.cameraFromWorld.row(2).transpose(), -guide.toCamera);
  guide.sampleInPicture = sampleInPicture(now);
  guide.within = guide.offDeg <= setup_.toleranceDeg && std::abs(guide.closerMm) <= setup_.toleranceMm &&
                 guide.sampleInPicture && guide.toCamera.z() > 0;
  guide.plannedError = plannedError_;
  if (guide.toCamera.z() > 0) {
    std::vector<Placed> places = placed;
    places[shot].camera = now;
    guide.errorNow = error(places);
    if (plannedError_ > 0) guide.costPercent = 100 * (guide.errorNow / plannedError_ - 1);
  }
  if (!guide.sampleInPicture)
    guide.sentence = "The sample isn't wholly in the picture: turn the camera towards it.";
  else if (guide.within)
    guide.sentence = "Hold still: the camera is where it should be.";
  else
    guide.sentence = moveSentence(guide.leftDeg, guide.upDeg, guide.closerMm, kSmallestDeg, kSmallestMm);
  guide.milliseconds =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return guide;
}

LightGuide TwoShotGuide::light(std::size_t shot, const std::vector<Placed>& placed,
                               const Eigen::Vector3d& toLight) const {
  LightGuide guide;
  guide.toLight = toLight.normalized();
  const Eigen::Vector3d wanted = setup_.shots[shot].directions.toLight;
  const Eigen::Vector3d viewer = placed[shot].camera
                                     ? Eigen::Vector3d(placed[shot].camera->positionMm().normalized())
                                     : setup_.shots[shot].directions.toCamera;
  guide.offDeg = degreesBetween(guide.toLight, wanted);
  const Movement move = movement(guide.toLight, wanted, viewer);
  guide.leftDeg = move.leftDeg;
  guide.upDeg = move.upDeg;
  guide.within = guide.offDeg <= setup_.toleranceDeg && guide.toLight.z() > 0;
  if (guide.toLight.z() > 0) {
    std::vector<Placed> places = placed;
    places[shot].toLight = guide.toLight;
    guide.errorNow = error(places);
    if (plannedError_ > 0) guide.costPercent = 100 * (guide.errorNow / plannedError_ - 1);
  }
  guide.sentence = guide.within
                       ? "Leave the light: it is where it should be."
                       : "Light: " + moveSentence(guide.leftDeg, guide.upDeg, 0, kSmallestDeg, kSmallestMm);
  return guide;
}

}  // namespace patina
