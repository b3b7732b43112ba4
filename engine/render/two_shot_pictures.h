#pragma once

#include <filesystem>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/twoshot/fit.h"

namespace patina {

/// Every photograph in a row of its own: captured, predicted, and their difference in colours from 0 to half
/// of the brightness shown as white; only itself where there is no prediction. Display-encoded R G B. Empty
/// where the fit has no comparisons.
Image comparisonPicture(const TwoShotFit& fit);

/// Writes the pictures that go with a fit into its folder: sphere.png (sphere_2.png, ... for further
/// materials) and comparison.png. What `writeTwoShotFit` is given as `writeMore`. Errors: WriteFailed;
/// Cancelled.
Status writeTwoShotPictures(const std::filesystem::path& folder, const TwoShotFit& fit,
                            const JobContext& job);

}  // namespace patina
