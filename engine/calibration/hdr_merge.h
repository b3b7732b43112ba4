#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/calibration/camera_response.h"

namespace patina {

struct MergeOptions {
  double shot = 1e-4, read = 1e-3;  ///< noise of a pixel: variance = shot * value + read^2, in pixel units
  double saturation = 1;            ///< values at or above are clipped
  Eigen::Vector3d blackLevel = Eigen::Vector3d::Zero();  ///< subtracted first
  double darkSigmas = 3;  ///< radiance below so many standard deviations counts as dark
};

/// A bracket merged to radiance.
struct MergedRadiance {
  Image radiance;  ///< pixel units a second; where all exposures are clipped, the shortest one's lower bound
  Image relativeSd;                   ///< standard deviation over radiance; infinite where clipped
  std::size_t clipped = 0, dark = 0;  ///< samples
  std::vector<double> mismatch;       ///< of each photograph: its radiance over that of most others, minus 1
  std::vector<std::string> warnings;
};

/// Merges linear photographs of one still scene: each sample weighted by t^2 / variance, the variance at the
/// merged radiance so that noise doesn't choose its own weight; clipped samples left out, those beside the
/// clipping level by their noise too. Errors: Invalid (no photographs, sizes, exposures that aren't
/// positive), Cancelled. All cores.
Result<MergedRadiance> mergeExposures(const std::vector<ExposedPhoto>& photos,
                                      const MergeOptions& options = {}, const JobContext& job = {});

}  // namespace patina
