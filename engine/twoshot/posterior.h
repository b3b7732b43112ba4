#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/base/job.h"
#include "engine/twoshot/basis.h"
#include "engine/twoshot/metric.h"

namespace patina {

/// What becomes of each column of the basis when its material is taken out of the basis and then measured
/// without noise by the same rows. Shapes: m columns.
struct LeaveOneOut {
  Eigen::MatrixXd error;         ///< k x m: coefficients of truth minus reconstruction
  std::vector<double> residual;  ///< m: RMS of what the fit leaves of the rows, natural-log units
  std::vector<double> rms;       ///< m: RMS of the error over the region's cells, natural-log units
};

/// Leaves every material out in turn, in closed form: without material j the prior's covariance (times m) is
/// P = I - C_j C_j^T - (m - 3) mu mu^T, mu = -sum(C_j) / (m - 3) the mean of those that stay, a rank-4
/// change; the reconstruction is mu + P F^T (F P F^T + eta (m - 3) / m I)^-1 F (c - mu). `rowWeight`: sum of
/// the rows' weights. `only`: indices of the materials wanted, all where empty; the others' entries stay 0.
/// Cost: one solve of r x r a material. Threads: all. Empty where cancelled.
LeaveOneOut leaveOneOut(const Basis& basis, const RowFactor& rows, double rowWeight, double eta,
                        BasisRegion region, const std::vector<int>& only, const JobContext& job);

/// The posterior of the coefficients, covariance = (I - B^T W B) * scale, as `Basis::posteriorSd` takes it.
struct Posterior {
  Eigen::MatrixXd observed;    ///< B, r x k, orthonormal rows
  Eigen::MatrixXd shrunk;      ///< W, r x r, lambda / (lambda + eta) on its diagonal
  double scale = 0;            ///< calibration^2 / m
  double calibration = 1;      ///< unseen materials' error over the posterior's own prediction of it
  double outside = 1;          ///< how much wider because the sample's residual is larger than theirs; >= 1
  double typicalResidual = 0;  ///< RMS of the left-out materials' residuals, natural-log units
  double largestResidual = 0;  ///< their 95th percentile
  double priorSd = 0;  ///< RMS over cells of what is known before any picture, calibrated like the rest
};

/// Covariance R / m with R = eta (F^T F + eta I)^-1, times (calibration * outside)^2, where
///
///   calibration^2 = mean_i |L e_i|^2 / (tr(L R L^T) / m),   L^T L = Q^T Q over all cells,
///   outside = max(1, residual / RMS_i(residual_i)),
///
/// e_i and residual_i from `leaveOneOut`; `residual` is the RMS that the fit left of the sample's own rows,
/// noise taken off. `directions` and `eigenvalues`: of the rows' F^T F.
Posterior makePosterior(const Basis& basis, const Eigen::MatrixXd& directions,
                        const Eigen::VectorXd& eigenvalues, double eta, const LeaveOneOut& left,
                        double residual);

}  // namespace patina
