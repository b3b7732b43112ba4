#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "engine/base/job.h"
#include "engine/twoshot/basis.h"
#include "engine/twoshot/metric.h"
#include "engine/twoshot/observations.h"

namespace patina {

/// Weighted rows of one material, with the basis reduced to what they see.
///
/// `directions` V (k x r, orthonormal columns) spans the rows of Q~ that matter beside eta, `reduced` = Q~ V:
/// a ridge solution lies in that span, so that everything after it happens in r dimensions.
struct RidgeProblem {
  Eigen::MatrixXd directions;   ///< V, k x r
  Eigen::VectorXd eigenvalues;  ///< r, of Q~^T W Q~ with W the mean over channels, largest first
  Eigen::MatrixXd reduced;      ///< n x r
  Eigen::MatrixXd target;       ///< n x 3: mapped value minus mean
  Eigen::MatrixXd weight;       ///< n x 3: what a row counts, noise included
  Eigen::VectorXd rowWeight;    ///< n: the same without noise; kEtaRows a picture in all
  Eigen::MatrixXd noise;        ///< n x 3: variance of the target by sensor noise
  std::vector<int> fold;        ///< n
  std::size_t unreached = 0;    ///< rows whose direction the basis doesn't cover

  /// F (r x k) with F^T F = Q~^T W Q~, for `ErrorMetric`.
  RowFactor factor() const;
};

/// Maps the observations. Row r of channel c weighs
///
///   w = n s0^2 / (s0^2 + n v),   s0^2 = kPaperEta / m,
///
/// n the part of a picture's kEtaRows rows that it stands for, v the variance of its logarithm by noise, s0
/// what eta means in the prior's terms: how well the basis follows a material, for one of kEtaRows rows. A
/// row that stands for n of those is known to s0^2 / n by the model and to v by the sensor, and information
/// adds up. Without `noiseWeights`: w = n, every pixel alike, as the paper. `smallestEta`: the least that
/// will be solved for. Empty: cancelled.
std::optional<RidgeProblem> makeRidgeProblem(const Basis& basis, const Observations& observations,
                                             bool noiseWeights, double smallestEta, const JobContext& job);

/// Coefficients, k x 3: argmin sum w (target - Q~ c)^2 + eta |c|^2 for each channel. Source: two-shot paper,
/// equation 4; the weights are ours.
Eigen::MatrixXd solveRidge(const RidgeProblem& problem, const Eigen::Vector3d& eta);

/// Eta by cross-validation: the value out of 0.1, 0.18, 0.32, ... 1000 for which rows of a part of the
/// pictures that was left out are best predicted from the others (weighted squares, all channels, every part
/// in turn). Deterministic. The paper's eta where there is only one part.
double chooseEta(const RidgeProblem& problem);

}  // namespace patina
