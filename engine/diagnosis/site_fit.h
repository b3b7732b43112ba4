#pragma once

#include <Eigen/Cholesky>
#include <array>

#include "engine/base/job.h"
#include "engine/diagnosis/fourier_columns.h"

namespace patina {

/// Weak knowledge about a site's own parameters: keeps what the photographs can't see from running away.
struct OwnPrior {
  std::array<double, kOwnCount> mean{}, invSd{};
};
OwnPrior ownPrior(const DiagnosisCapture& capture, const DiagnosisSite& site);

/// Normal matrix of the own parameters with their priors, factored; and the step.
struct OwnSystem {
  Eigen::LLT<Eigen::MatrixXd> llt;
  Eigen::VectorXd rhs;
};
/// `gram`, `rhs`: of the own parameters' columns, in units of noise.
OwnSystem ownSystem(const OwnPrior& prior, const Eigen::MatrixXd& gram, const Eigen::VectorXd& rhs);
/// The same for a site whose parameters may stand at a bound (a lobe without kurtosis, an albedo of nothing):
/// what would be pushed through it is held there. Without that the others' steps count on a move that isn't
/// made, and every effect that such a move would help looks large.
OwnSystem boundedSystem(const DiagnosisCapture& capture, const DiagnosisSite& site,
                        const Eigen::MatrixXd& gram, const Eigen::VectorXd& rhs);

/// Moves the sites' own parameters towards their optimum under the model: `steps` Gauss-Newton steps,
/// parallel.
/// `mayDrop`: sites whose lobe is found to leave the screen become unusable.
void refineSites(DiagnosisCapture& capture, const FourierDiagnosisModel& model, int steps,
                 const JobContext& job, bool mayDrop = true);
/// Moves a site's own parameters by a step, each as far as makes sense at once.
void stepSite(DiagnosisSite& site, const Eigen::VectorXd& delta);

}  // namespace patina
