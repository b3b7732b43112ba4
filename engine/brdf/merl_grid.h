#pragma once

#include <cstddef>
#include <optional>

#include "engine/brdf/half_diff.h"

namespace patina {

/// The grid of the MERL database: 90 x 90 x 180 cells over thetaH (spaced by its square root), thetaD and
/// phiD, phiD running fastest. A value belongs to its cell's centre: thetaH = (i + 0.5)^2 / 90 degrees,
/// thetaD = j + 0.5 degrees, phiD = k + 0.5 degrees. Source: Matusik et al. 2003 and the database's reader.
struct MerlGrid {
  static constexpr int kThetaH = 90, kThetaD = 90, kPhiD = 180;
  static constexpr std::size_t kCells = std::size_t{kThetaH} * kThetaD * kPhiD;  // 1,458,000

  static constexpr std::size_t cell(int thetaH, int thetaD, int phiD) {
    return (static_cast<std::size_t>(thetaH) * kThetaD + thetaD) * kPhiD + phiD;
  }
  /// The centre of a cell, radians.
  static HalfDiffAngles centre(int thetaH, int thetaD, int phiD);
  static HalfDiffAngles centre(std::size_t cell);
  /// Grid coordinates, the centre of cell (i, j, k) being (i, j, k); not clamped, phiD folded by nobody.
  static Eigen::Vector3d coordinates(const HalfDiffAngles& angles);
};

}  // namespace patina
