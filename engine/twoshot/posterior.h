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
  Eigen::MatrixXd observed;  ///< B, r x k, orthonormal rows
  Eigen::MatrixXd shrunk;    ///< W, r x r, lambda / (lambda + eta) on its diagonal
  double scale = 0;          ///< (calibration * fit)^2 / m
  double calibration = 1;    ///< left-out materials' error over the posterior's own prediction of it
  double exponent = 0;       ///< b: how the error grows with what the fit leaves of its rows
  double fit = 1;  ///< how much wider (above 1) or narrower for this sample, because its residual is larger
                   ///< or smaller than is typical
  double typicalResidual = 0;   ///< geometric mean of the left-out materials' residuals, natural-log units
  double smallestResidual = 0;  ///< their 5th percentile
  double largestResidual = 0;   ///< their 95th percentile
  double priorSd = 0;  ///< RMS over cells of what is known before any picture, calibrated like the rest

  /// What a sample with this residual is widened by: (residual / typical)^b, the residual not below the 5th
  /// percentile of those left out.
  double widening(double residual) const;
};

/// Covariance R / m with R = eta (F^T F + eta I)^-1, times (calibration * widening(residual))^2. From the
/// materials left out, with e_i and residual_i of `leaveOneOut`:
///
///   b: the slope of ln |L e_i| over ln residual_i by least squares, within [0, 1],
///   widening(r) = (r / typical)^b,  typical = exp(mean ln residual_i),
///   calibration^2 = mean_i (|L e_i| / widening(residual_i))^2 / (tr(L R L^T) / m),  L^T L = Q^T Q, all
///   cells.
///
/// So a sample that the basis follows as it follows its own materials is as uncertain as those were, and one
/// that it doesn't follow is more so. `residual` is the RMS that the fit left of the sample's own rows, noise
/// taken off. `directions` and `eigenvalues`: of the rows' F^T F.
Posterior makePosterior(const Basis& basis, const Eigen::MatrixXd& directions,
                        const Eigen::VectorXd& eigenvalues, double eta, const LeaveOneOut& left,
                        double residual);

}  // namespace patina
