#pragma once

#include <memory>
#include <vector>

#include "engine/base/job.h"
#include "engine/flash/fit.h"

namespace patina {

/// The texels that effects are tried on, with everything that all photographs say about them. Held-out
/// photographs are in it to be compared with; `fitted` says which may be fitted.
struct FlashTrial {
  FlashData data;
  FlashSample sample;
  FlashPalette palette;
  std::vector<char> fitted, heldOut;    ///< by photograph
  std::vector<std::vector<int>> folds;  ///< of fitted photographs, for cross-validation
  FlashGrid grid;                       ///< of the level that the sample is drawn from
};
Result<FlashTrial> readTrial(const FlashCapture& capture, int size, int texels, const JobContext& job);

/// Sums of squares over photographs and blocks of the sample, decoded values, both sides clipped as the
/// camera clips.
struct FlashErrors {
  Eigen::MatrixXd squares, values;  ///< photographs x blocks; 0 where not evaluated
  double rms() const;
};
/// Errors of a state on the photographs that `which` marks. freePower: a photograph's own power is measured
/// on one half of the blocks and judged on the other, because nothing else can tell it.
FlashErrors errorsOf(const FlashTrial& trial, const JointState& state, const std::vector<char>& which,
                     bool freePower);

/// A model with some effects, tried.
struct FlashTry {
  std::vector<FlashEffect> effects;
  JointState state;  ///< on all fitted photographs
  FlashErrors left;  ///< each fitted photograph predicted from the others, up to its own power
  FlashErrors held;  ///< declared held-out photographs; power as the others
  double chi2 = 0;   ///< of fitted photographs, mean square in units of the sensor's noise
};
/// Refits with `effects` from `start` and predicts each photograph from the others. A hand-held flash's power
/// in one photograph can't be known from others, whatever the model: every model is judged up to one factor a
/// photograph, so that none wins by having it.
FlashTry tryEffects(const FlashTrial& trial, const JointState& start, const std::vector<FlashEffect>& effects,
                    const JobContext& job);

/// By how much one model predicts better than another.
struct FlashGain {
  double share = 0;   ///< of the mean square prediction error that is gone
  double sigmas = 0;  ///< over its scatter from photograph to photograph and block to block
};
FlashGain gainOf(const FlashErrors& before, const FlashErrors& after);

/// Mean square of the fitted photographs' residual in units of the sensor's noise.
double chi2Of(const FlashTrial& trial, const JointState& state);

}  // namespace patina
