#include "devices/simulated/sheet_form.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kWaves = 5;
constexpr int kRaySteps = 12;  ///< each gains a factor of the surface's slope; 0.2 leaves 1e-8 of the height

}  // namespace

SheetForm::SheetForm(const SimulatedEffects& effects, const SimulatedSheet& sheet)
    : flat_(!effects.has("sample-height") && !effects.has("sample-tilt")) {
  liftMm_ = effects.sampleTilt.liftMm;
  // Turned about x by a, a point at y rises by y tan(a); about y, one at x sinks.
  slope_ = {-std::tan(effects.sampleTilt.aboutYDeg * kPi / 180),
            std::tan(effects.sampleTilt.aboutXDeg * kPi / 180)};
  const double half = 0.5 * std::max(sheet.widthMm, sheet.heightMm);
  curvaturePerMm_ = effects.sampleHeight.bendMm / (half * half);
  const double angle = effects.sampleHeight.bendAngleDeg * kPi / 180;
  bendAlong_ = {std::cos(angle), std::sin(angle)};
  if (effects.sampleHeight.wavesMm > 0) {
    std::mt19937_64 bits(sheet.seed * 0x9E3779B97F4A7C15ull + 77);
    const auto uniform = [&] { return static_cast<double>(bits() >> 11) * 0x1.0p-53; };
    for (int i = 0; i < kWaves; ++i) {
      const double direction = 2 * kPi * (i + uniform()) / kWaves;
      const double length = effects.sampleHeight.waveLengthMm * (1 + uniform());
      waves_.push_back({Eigen::Vector2d(std::cos(direction), std::sin(direction)) * (2 * kPi / length),
                        2 * kPi * uniform(), effects.sampleHeight.wavesMm * std::sqrt(2.0 / kWaves)});
    }
  }
}

double SheetForm::heightMm(double xMm, double yMm) const {
  const Eigen::Vector2d at(xMm, yMm);
  const double along = at.dot(bendAlong_);
  double height = liftMm_ + slope_.dot(at) + curvaturePerMm_ * along * along;
  for (const Wave& wave : waves_) height += wave.amplitudeMm * std::sin(wave.perMm.dot(at) + wave.phase);
  return height;
}

Eigen::Vector2d SheetForm::gradient(double xMm, double yMm) const {
  const Eigen::Vector2d at(xMm, yMm);
  Eigen::Vector2d g = slope_ + 2 * curvaturePerMm_ * at.dot(bendAlong_) * bendAlong_;
  for (const Wave& wave : waves_)
    g += wave.amplitudeMm * std::cos(wave.perMm.dot(at) + wave.phase) * wave.perMm;
  return g;
}

std::optional<Eigen::Vector3d> SheetForm::seenAt(const Camera& camera, const Eigen::Vector2d& pixel) const {
  std::optional<Eigen::Vector3d> point = camera.samplePlaneFromPixel(pixel);
  if (flat_ || !point) return point;
  const Eigen::Vector3d eye = camera.positionMm(), ray = *point - eye;
  for (int step = 0; step < kRaySteps; ++step) {
    const double z = heightMm(point->x(), point->y());
    *point = eye + ray * ((z - eye.z()) / ray.z());
  }
  return point;
}

Eigen::Vector3d SheetForm::turned(const Eigen::Vector3d& normal, double xMm, double yMm) const {
  if (flat_) return normal;
  const Eigen::Vector2d g = gradient(xMm, yMm) - normal.head<2>() / normal.z();  // slopes of both add up
  return Eigen::Vector3d(-g.x(), -g.y(), 1).normalized();
}

Screen trueScreen(const Screen& declared, const SimulatedEffects& effects) {
  if (!effects.has("screen-pose")) return declared;
  const SimulatedEffects::ScreenPose& pose = effects.screenPose;
  const auto turn = [](double degrees, const Eigen::Vector3d& axis) {
    return Eigen::AngleAxisd(degrees * kPi / 180, axis).toRotationMatrix();
  };
  Screen screen = declared;
  screen.originMm +=
      declared.worldFromScreen * Eigen::Vector3d(pose.shiftXMm, pose.shiftYMm, pose.alongNormalMm);
  screen.worldFromScreen = declared.worldFromScreen * turn(pose.tiltXDeg, Eigen::Vector3d::UnitX()) *
                           turn(pose.tiltYDeg, Eigen::Vector3d::UnitY()) *
                           turn(pose.turnDeg, Eigen::Vector3d::UnitZ());
  return screen;
}

}  // namespace patina
