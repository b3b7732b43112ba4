#pragma once

#include <vector>

#include "engine/base/job.h"
#include "engine/diagnosis/fourier_columns.h"

namespace patina {

/// Sites whose residual is beyond three times the median's get less weight, so that a few that are far from
/// any linear regime don't decide for all. To be called between rounds, never between things that are
/// compared.
void setRobustWeights(DiagnosisCapture& capture, const FourierDiagnosisModel& model, const JobContext& job);

/// Lowers the assumed noise where it can't be so large: the difference of neighbouring sites' residuals in
/// one photograph holds noise, and hardly anything of an effect that acts on whole photographs (whose scatter
/// is taken for noise when it is estimated from the photographs). One factor for all weights. Returns the
/// ratio of true to assumed variance, at most 1.
double correctNoise(DiagnosisCapture& capture, const FourierDiagnosisModel& model, const JobContext& job);

/// What a state leaves: sums of squares in units of scatter or noise, and relative RMS over the tested sites.
struct ModelError {
  double chi2 = 0, count = 0, heldChi2 = 0, heldCount = 0;  ///< by component, inflated scatter included
  double noiseChi2 = 0, noiseCount = 0;                     ///< fitted photographs, noise alone as the unit
  double rms = 0, heldRms = 0, floor = 0, heldFloor = 0;
  std::vector<double> heldPatch;  ///< held-out chi2 by groups of neighbouring sites, for its own uncertainty
  std::vector<double> rowChi2, rowCount, rowNoise;  ///< by row; noise: relative to the photograph's signal
};
ModelError modelError(const DiagnosisCapture& capture, const FourierDiagnosisModel& model,
                      const JobContext& job);

}  // namespace patina
