#include "engine/brdf/half_diff.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/brdf/brdf.h"
#include "engine/brdf/merl_grid.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;

Eigen::Vector3d rotatedAboutZ(const Eigen::Vector3d& v, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * v.x() - s * v.y(), s * v.x() + c * v.y(), v.z()};
}

Eigen::Vector3d rotatedAboutY(const Eigen::Vector3d& v, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * v.x() + s * v.z(), v.y(), -s * v.x() + c * v.z()};
}

}  // namespace

HalfDiffAngles halfDiffFromDirections(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) {
  const Eigen::Vector3d sum = toLight + toView;
  const double length = sum.norm();
  HalfDiffAngles angles;
  // Opposite directions: no half-vector. 1e-12 is far below what a direction in double precision can tell.
  if (length < 1e-12) {
    angles.thetaDRad = kPi / 2;
    return angles;
  }
  const Eigen::Vector3d half = sum / length;
  const double sinH = std::hypot(half.x(), half.y());
  angles.thetaHRad = std::atan2(sinH, half.z());
  const double phiH = sinH > 1e-12 ? std::atan2(half.y(), half.x()) : 0.0;
  const Eigen::Vector3d diff = rotatedAboutY(rotatedAboutZ(toLight, -phiH), -angles.thetaHRad);
  // |light - view| / |light + view| is tan(thetaD): exact where acos(diff.z) loses half of its digits.
  angles.thetaDRad = std::atan2((toLight - toView).norm(), length);
  angles.phiDRad = std::hypot(diff.x(), diff.y()) > 1e-12 ? std::atan2(diff.y(), diff.x()) : 0.0;
  return angles;
}

DirectionPair directionsFromHalfDiff(const HalfDiffAngles& angles, double phiHRad) {
  const double sinD = std::sin(angles.thetaDRad), cosD = std::cos(angles.thetaDRad);
  const Eigen::Vector3d diff(sinD * std::cos(angles.phiDRad), sinD * std::sin(angles.phiDRad), cosD);
  const Eigen::Vector3d mirrored(-diff.x(), -diff.y(), diff.z());
  return {rotatedAboutZ(rotatedAboutY(diff, angles.thetaHRad), phiHRad),
          rotatedAboutZ(rotatedAboutY(mirrored, angles.thetaHRad), phiHRad)};
}

double foldedPhiD(double phiDRad) {
  double phi = std::fmod(phiDRad, kPi);
  if (phi < 0) phi += kPi;
  return std::min(phi, kPi - phi);
}

void Brdf::evaluateMany(std::span<const HalfDiffAngles> angles, std::span<Eigen::Array3f> out) const {
  for (std::size_t i = 0; i < angles.size(); ++i) {
    const DirectionPair pair = directionsFromHalfDiff(angles[i]);
    out[i] = evaluate(pair.toLight, pair.toView).cast<float>();
  }
}

HalfDiffAngles MerlGrid::centre(int thetaH, int thetaD, int phiD) {
  constexpr double kDegree = kPi / 180;
  return {(thetaH + 0.5) * (thetaH + 0.5) / kThetaH * kDegree, (thetaD + 0.5) * kDegree,
          (phiD + 0.5) * kDegree};
}

HalfDiffAngles MerlGrid::centre(std::size_t cell) {
  return centre(static_cast<int>(cell / (kThetaD * kPhiD)), static_cast<int>(cell / kPhiD % kThetaD),
                static_cast<int>(cell % kPhiD));
}

Eigen::Vector3d MerlGrid::coordinates(const HalfDiffAngles& angles) {
  constexpr double kDegrees = 180 / kPi;
  return {std::sqrt(angles.thetaHRad * kDegrees * kThetaH) - 0.5, angles.thetaDRad * kDegrees - 0.5,
          angles.phiDRad * kDegrees - 0.5};
}

}  // namespace patina
