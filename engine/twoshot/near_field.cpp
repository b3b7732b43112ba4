#include "engine/twoshot/near_field.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace patina {

ShotDirections shotFromHalfDiff(const HalfDiffAngles& centre) {
  const DirectionPair pair = directionsFromHalfDiff(centre);
  const double azimuth = std::atan2(pair.toView.y(), pair.toView.x());
  const Eigen::AngleAxisd turn(-azimuth, Eigen::Vector3d::UnitZ());
  return {turn * pair.toLight, turn * pair.toView};
}

std::vector<HalfDiffAngles> discDirections(const ShotDirections& shot, const NearFieldDisc& disc) {
  std::vector<HalfDiffAngles> directions;
  if (shot.toLight.z() <= 0) return directions;
  const double radius = std::tan(disc.fovDeg * std::numbers::pi / 360);
  const int points = radius > 0 ? disc.points : 1;
  // Vogel's spiral: equal areas, no preferred direction.
  const double goldenAngle = std::numbers::pi * (3 - std::sqrt(5.0));
  directions.reserve(points);
  for (int i = 0; i < points; ++i) {
    const double r = radius * std::sqrt((i + 0.5) / points), angle = i * goldenAngle;
    const Eigen::Vector3d toView =
        (shot.toCamera - Eigen::Vector3d(r * std::cos(angle), r * std::sin(angle), 0)).normalized();
    if (toView.z() > 0) directions.push_back(halfDiffFromDirections(shot.toLight, toView));
  }
  return directions;
}

}  // namespace patina
