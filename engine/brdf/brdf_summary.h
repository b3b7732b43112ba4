#pragma once

#include <Eigen/Core>
#include <array>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/brdf/brdf.h"

namespace patina {

/// Logarithms of BRDFs are compared after weighting with the larger cosine w of light and view: ln(f w +
/// eps), eps = 0.001 in 1/sr, so that black cells and grazing directions don't decide alone. Source: the
/// mapping of the two-shot paper, section 3.
inline constexpr double kLogEpsilon = 0.001;
/// Directions that count in a comparison: both cosines above this (within 81.4 degrees of the normal).
inline constexpr double kLeastComparedCosine = 0.15;

/// Directions by what happens there. Grazing: light or view more than 70 degrees from the normal. Highlight:
/// thetaH below 15 degrees and not grazing. Diffuse: the rest.
enum class BrdfRegion { Highlight, Diffuse, Grazing };
inline constexpr int kBrdfRegions = 3;

/// How far two BRDFs are apart.
struct BrdfComparison {
  struct Part {
    double logRms = 0;   ///< natural-log units; NaN where there are no directions
    double logBias = 0;  ///< mean of second minus first
    std::size_t directions = 0;
  };
  Part all;
  std::array<Part, 3> channel;            ///< R, G, B
  std::array<Part, kBrdfRegions> region;  ///< by BrdfRegion
  double comparedShare = 0;               ///< of the directions, where both are known
  double largest = 0;                     ///< |difference|, natural-log units
  int largestChannel = 0;
  HalfDiffAngles largestAt;
  Eigen::Array3d firstThere = Eigen::Array3d::Zero(), secondThere = Eigen::Array3d::Zero();  ///< 1/sr
};

/// Compares two BRDFs over directions that are spread uniformly over the MERL grid (thetaH by its square
/// root, thetaD, phiD over the whole turn, so that light and view are swapped too), both cosines above
/// kLeastComparedCosine; anisotropic ones at 8 azimuths of the half-vector. Deterministic. Cost: 583,200
/// evaluations of each, on `job.threads`. Progress: "compare". Errors: Cancelled; Invalid where no direction
/// is known to both.
Result<BrdfComparison> compareBrdfs(const Brdf& first, const Brdf& second, const JobContext& job = {});

/// What one BRDF is like.
struct BrdfSummary {
  struct Albedo {
    double lightDeg = 0;
    Eigen::Array3d value = Eigen::Array3d::Zero();  ///< integral of f cos(view) over the views that are known
    double knownShare = 0;                          ///< of the hemisphere of views, cosine-weighted
  };
  std::array<Albedo, 3> albedo;  ///< light at 0, 45 and 75 degrees
  double knownShare = 0;         ///< of the directions above the surface, uniform over the MERL grid
  /// RMS of ln f(light, view) - ln f(view, light), and of the spread over azimuths of the half-vector, in
  /// natural-log units over the directions of a comparison. NaN where nothing is known.
  double reciprocityLogRms = 0, azimuthLogRms = 0;
  Eigen::Array3d least = Eigen::Array3d::Zero(), largest = Eigen::Array3d::Zero();  ///< 1/sr, same directions
};

/// Summarises. Albedos by a midpoint rule over half-vectors, 400 x 512 for each light. Progress: "measure".
/// Errors: Cancelled.
Result<BrdfSummary> summariseBrdf(const Brdf& brdf, const JobContext& job = {});

}  // namespace patina
