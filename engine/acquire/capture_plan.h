#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "engine/acquire/pattern_image.h"
#include "engine/capture/capture.h"

namespace patina {

/// The paper's frequencies: 1, 2, 3, 4, 6, 10, 20, 40 along both axes and both diagonals. Source: section 8.
std::vector<Eigen::Vector2i> paperFrequencies();
/// Nine between and beside them, to measure the error of prediction.
std::vector<Eigen::Vector2i> heldOutFrequencies();

struct CapturePlanOptions {
  std::vector<Eigen::Vector2i> fitted = paperFrequencies();
  std::vector<Eigen::Vector2i> heldOut = heldOutFrequencies();  ///< empty: none are taken
  /// Also the window again at the end, held out: what the screen's drift was.
  bool windowAgain = true;
};

/// One photograph to take.
struct PlannedPhoto {
  PatternSpec pattern;
  bool holdout = false;
  PhotoRole role() const;
};

/// The photographs of a Fourier capture in the order in which they are taken: window, black, then frequency
/// by frequency with its four phases in turn; fitted ones from low to high, the held-out ones among them.
struct CapturePlan {
  std::vector<PlannedPhoto> photos;
  std::uint64_t hash() const;  ///< a resumed capture must have the same plan
};
CapturePlan makeCapturePlan(const CapturePlanOptions& options = {});

/// Frequencies too fine for a screen of that many pixels: below four pixels a wave the pattern is no sine.
std::vector<Eigen::Vector2i> tooFine(const std::vector<Eigen::Vector2i>& frequencies, const Screen& screen);

}  // namespace patina
