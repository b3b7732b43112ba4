#pragma once

#include <memory>

#include "engine/diagnosis/fourier_refit.h"
#include "engine/fourier/corrections.h"

namespace patina {

/// The capture and corrections with which the fit itself runs as without effects: what a state of effects
/// does to one capture is undone in its photographs (time, sensor), put into its screen (pose, emission,
/// heights), or predicted by the numerical model at each site's refined parameters and taken off its
/// measurements (surface, lens, the shown pattern).
struct CorrectedCapture {
  FourierCapture capture;
  std::shared_ptr<const FourierCorrections> corrections;
  std::vector<float> horizonSine;  ///< of every site of the fit, where self-shadowing was added; else empty
  std::vector<std::array<float, 2>> stretch;  ///< beyond the material's, where anisotropy was added
};
/// Errors: Cancelled. Parallel; about 0.3 ms a site and core where sites have to be predicted.
Result<CorrectedCapture> correctCapture(const DiagnosisSession& session, std::size_t capture,
                                        const JobContext& job);

}  // namespace patina
