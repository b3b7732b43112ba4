#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/brdf/half_diff.h"

namespace patina {

/// A near-field picture of a flat disc under a distant light: the camera looks at the disc's centre from a
/// distance of one, the disc's radius is tan(fov / 2). Source: two-shot paper, section 5.2 and Fig. 4.
struct NearFieldDisc {
  double fovDeg = 25;  ///< angle that the disc subtends from the zenith; 0: a point sample
  int points = 300;    ///< directions a picture, in a sunflower layout over the disc; 1 where fovDeg is 0
};

/// One picture: directions at the disc's centre, in the sample's frame (z the normal).
struct ShotDirections {
  Eigen::Vector3d toLight = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d toCamera = Eigen::Vector3d::UnitZ();
  HalfDiffAngles centre() const { return halfDiffFromDirections(toLight, toCamera); }
};

/// The picture whose centre has these coordinates, the camera's azimuth being 0.
ShotDirections shotFromHalfDiff(const HalfDiffAngles& centre);

/// Half-angle coordinates of every point of the disc, each with its own view direction: `disc.points`
/// entries; points that the camera or the light doesn't reach are left out.
std::vector<HalfDiffAngles> discDirections(const ShotDirections& shot, const NearFieldDisc& disc);

}  // namespace patina
