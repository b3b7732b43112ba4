#pragma once

#include <cstdint>

#include "engine/diagnosis/explanation.h"
#include "engine/image/image.h"

namespace patina {

/// How many standard deviations are the full range of a residual picture, to either side of grey.
constexpr float kResidualRangeSigmas = 6;

/// One photograph and its residuals for the eye, all of one size, cropped to the sample, display-encoded
/// R G B. Where the photograph is larger than asked for, pixels are averaged, and so is their noise: a
/// residual below the noise of a pixel shows where it is the same over many. Empty where there is nothing.
struct ResidualView {
  Image captured, predictedBefore, predictedAfter;  ///< with one exposure
  /// (photograph - prediction) in standard deviations of the noise, channel by channel: grey is as
  /// predicted, brighter is a photograph that is brighter than its prediction.
  Image before, after;
  Image expected;  ///< what `before` would look like for a perfect model: noise alone, made up
  double rmsBefore = -1, rmsAfter = -1;  ///< in standard deviations of the (averaged) noise; 1 is perfect
  bool empty() const { return captured.empty(); }
};

/// `longestSide` in pixels. `seed`: of the made-up noise. Pictures whose parts differ in size give an empty
/// view.
ResidualView residualView(const ResidualPicture& picture, int longestSide, std::uint64_t seed = 1);

/// Mean square residual in units of noise over the camera's picture, as colours: black at `low`, cream at
/// `high`, logarithmic between; grey off the sample (0). Cropped to the sample of `place` and averaged as
/// above. Empty for an empty one.
Image placePicture(const Image& place, int longestSide, double low, double high);

/// A map of one or three channels as colours (one channel: from `low` to `high`, which are set to the 2nd and
/// 98th percentile of its finite values; three: as they are, tone mapped). Empty for any other.
Image mapPicture(const Image& map, int longestSide, double* low, double* high);

}  // namespace patina
