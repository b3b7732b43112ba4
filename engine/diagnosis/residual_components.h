#pragma once

#include <Eigen/Core>

#include "engine/diagnosis/fourier_columns.h"

namespace patina {

/// Residuals of single photographs, turned into what they are made of. The four photographs of a frequency
/// (rows 4 f .. 4 f + 3) become, orthonormally: (I0 - I2) / sqrt 2 and (I1 - I3) / sqrt 2, of which Z is
/// made; half their sum, which high frequencies hold at the window's share whatever the surface does; and
/// (I0 - I1 + I2 - I3) / 2, the response to |sin| against |cos|. The window's row stays itself.
///
/// Why: where a model misses a surface, its error sits in the first two, and time, sensor and room show in
/// the third. Each component carries its own scatter (`DiagnosisCapture::inflation`), so that what one
/// component cannot be trusted with isn't held against the others.
enum PhaseComponent { kOddSine, kOddCosine, kEvenSum, kEvenDifference };

/// Turns the rows of `m` in place; rows are channel-major (channel * rowCount + row).
void turnToComponents(const DiagnosisCapture& capture, Eigen::Ref<Eigen::MatrixXd> m);

/// Where a photograph lands: component rows (within a channel) and coefficients.
struct ComponentShare {
  int count = 0;
  std::size_t row[3] = {};
  double share[3] = {};
};
ComponentShare componentsOf(const DiagnosisCapture& capture, std::size_t row);

/// Square roots of a site's weights by component (channel-major), inflated scatter and the site's robust
/// factor included; 0 for rows of the other split and what was dropped.
Eigen::VectorXd rootWeights(const DiagnosisCapture& capture, const DiagnosisSite& site, bool holdout);
/// Photograph minus prediction, by component, radiance.
Eigen::VectorXd residualOf(const DiagnosisCapture& capture, const DiagnosisSite& site, const SiteColumns& at);

/// Sets `capture.inflation`: mean square of each component's residual over the sites, in units of noise,
/// where that is clearly more than noise; 1 elsewhere. To be called between rounds, never between things that
/// are compared. Parallel.
void inflateScatter(DiagnosisCapture& capture, const FourierDiagnosisModel& model, const JobContext& job);

}  // namespace patina
