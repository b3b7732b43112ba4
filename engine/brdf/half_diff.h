#pragma once

#include <Eigen/Core>

namespace patina {

/// A pair of directions in Rusinkiewicz's half-angle coordinates, radians. `thetaH` is the half-vector's
/// angle to the normal, (`thetaD`, `phiD`) the light's direction in the frame of the half-vector. An
/// isotropic reciprocal BRDF depends on these three, with period pi in `phiD`. Source: Rusinkiewicz 1998; the
/// order of the MERL database.
struct HalfDiffAngles {
  double thetaHRad = 0;  ///< [0, pi/2]
  double thetaDRad = 0;  ///< [0, pi/2]
  double phiDRad = 0;    ///< (-pi, pi]
};

/// Unit vectors in the sample's frame, z the normal.
struct DirectionPair {
  Eigen::Vector3d toLight = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d toView = Eigen::Vector3d::UnitZ();
};

/// Half-angle coordinates of two unit directions (z the normal). Where the half-vector is the normal its
/// azimuth is taken as 0, and where light and view coincide phiD is 0. Never NaN for unit input; directions
/// that are exactly opposite have no half-vector and give thetaH = 0, thetaD = pi/2.
HalfDiffAngles halfDiffFromDirections(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView);

/// The directions with those coordinates, the half-vector's azimuth being `phiHRad`. Either may lie below the
/// surface: the caller looks at z.
DirectionPair directionsFromHalfDiff(const HalfDiffAngles& angles, double phiHRad = 0);

/// `phiDRad` folded into [0, pi/2], as reciprocity (period pi) and mirror symmetry (even) allow for every
/// isotropic reciprocal BRDF without handedness.
double foldedPhiD(double phiDRad);

}  // namespace patina
