#pragma once

#include <vector>

#include "engine/acquire/camera_device.h"
#include "engine/acquire/frame_image.h"
#include "engine/image/image.h"

namespace patina {

/// The exposure nearest to `wantedS` that is a whole number of refresh periods (one at least) and lies in the
/// control's range; the range's own end where none does. refreshHz 0: `wantedS` itself, in range.
double wholeRefreshes(double wantedS, double refreshHz, double leastS, double mostS);

/// The exposure that brings the `percentile` (0..1) of the samples on `mask` to `fill` of full scale, from a
/// photograph (share of full scale) taken with `takenS`. Where more than that percentile is clipped, a fourth
/// of `takenS`. All-black: `mostS`. `mask`: one channel, pixels that count; empty: all.
double exposureFor(const Image& photo, const Image& mask, double takenS, double fill, double percentile,
                   double leastS, double mostS);

/// A photograph of a bracket: share of full scale, black level off.
struct BracketPhoto {
  Image photo;
  double exposureS = 1;
};
/// One photograph of high range in full scale per second: the mean of what isn't clipped, weighted by the
/// light that each collected (its exposure: the weights of least variance under shot noise). `clipsAt`: share
/// of full scale. A pixel clipped in all takes the shortest one's value, and is counted in `clipped` (may be
/// null). Errors: Invalid (none, or sizes that differ). Source: Robertson et al., "Dynamic range improvement
/// through multiple exposures" (1999), weights for Poisson noise.
Result<Image> mergeBracket(const std::vector<BracketPhoto>& bracket, double clipsAt = 0.98,
                           Image* clipped = nullptr);

/// Exposures of a bracket: `steps` of them, each `ratio` times the one before, the longest first.
std::vector<double> bracketExposures(double longestS, double ratio, int steps, double leastS);

}  // namespace patina
