#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/twoshot/basis.h"
#include "engine/twoshot/near_field.h"

namespace patina {

/// Tikhonov's weight that the paper uses, for `kEtaRows` rows a picture.
inline constexpr double kPaperEta = 40;
/// Rows a picture for which eta holds; N rows count as sqrt(kEtaRows / N) each, so that the camera's
/// resolution doesn't change the answer. Point samples count as one row each.
inline constexpr double kEtaRows = 300;

/// The rows of one or more pictures, reduced to what the normal equations see: F (r x k) with F^T F equal to
/// Q~^T Q~ (weights included) but for what counts less than the tolerance beside eta.
struct RowFactor {
  Eigen::MatrixXd factor;  ///< r x k
  Eigen::Index rank() const { return factor.rows(); }
};

/// What of the rows may be dropped: the trace of Q~ Q~^T that is left, in units of eta = 40. The expected
/// error changes by less than that relative to itself; measured far less.
inline constexpr double kSearchTolerance = 1e-2, kExactTolerance = 1e-4;

/// Reduces n x k rows, each multiplied by `rowScale`. Cost: n^2 k for the rows' products and 2 n k r for the
/// factor, in operations.
RowFactor reduceRows(const Eigen::MatrixXd& rows, double rowScale, double tolerance = kExactTolerance);
RowFactor stack(const std::vector<const RowFactor*>& factors);

/// What a set of directions is expected to do. Errors are RMS over the region's cells, natural-log units.
struct ExpectedError {
  double prior = 0;      ///< RMS spread of the basis' columns: what is left where nothing was measured
  double posterior = 0;  ///< RMS of the posterior's standard deviation, before any calibration
  double training =
      0;             ///< equation 15 with beta = 0: mean over the basis' own columns, each divided by sqrt(p)
  double noise = 0;  ///< its second term for beta = 1: |Q (SQ)+ S O| / sqrt(p)
  std::vector<double> column;  ///< m: the columns' own
  double unseen = 0;           ///< mean over materials, each reconstructed by the basis without it
  double unseenMedian = 0, unseenWorstTenth = 0;  ///< over materials; the 90th percentile
  std::vector<double> unseenMaterial;             ///< m / 3; empty where not asked for
};

/// Equation 15 in coefficient space. Exactly the paper's direct form: with G = F^T F and R = eta (G + eta
/// I)^-1, the error of column i is |L R c_i|. Here by the dual form, R = I - F^T (F F^T + eta I)^-1 F, whose
/// cost is about k m (r + k) + r^2 m operations.
class ErrorMetric {
 public:
  ErrorMetric(BasisPtr basis, BasisRegion region, double eta = kPaperEta);
  /// `training` alone: what a search calls. Threading: any number of calls at a time.
  double training(const RowFactor& rows) const;
  /// Everything. `rowSum`: F^T-space image of a vector of ones (sum of the scaled rows), k; empty: no noise
  /// term.
  ExpectedError expect(const RowFactor& rows, const Eigen::VectorXd& rowSum = {}) const;
  const Basis& basis() const { return *basis_; }
  BasisRegion region() const { return region_; }
  double eta() const { return eta_; }

 private:
  BasisPtr basis_;
  BasisRegion region_;
  double eta_;
  Eigen::MatrixXd weighted_;  ///< L C, k x m
};

/// Equation 6: the ratio of the largest to the smallest singular value of the rows (min(n, k) of them);
/// infinite where the smallest is 0 to rounding.
double conditionNumber(const Eigen::MatrixXd& rows);

/// The rows of pictures as the metric counts them: point samples 1 each, a disc's sqrt(kEtaRows / n).
RowFactor rowsOfShot(const Basis& basis, const ShotDirections& shot, const NearFieldDisc& disc,
                     double tolerance = kExactTolerance);

}  // namespace patina
