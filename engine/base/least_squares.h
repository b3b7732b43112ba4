#pragma once

#include <Eigen/Core>
#include <functional>
#include <stop_token>

namespace patina {

struct LeastSquaresOptions {
  int iterations = 60;         ///< at most
  double relativeStep = 1e-9;  ///< converged where no unknown moves by more than this share of its scale
  std::stop_token stop{};      ///< looked at once an iteration
};

struct LeastSquaresSolution {
  Eigen::VectorXd x;
  double sumOfSquares = 0;
  Eigen::MatrixXd inverseNormal;  ///< (J^T J)^-1 at x: times the residual's variance, the covariance
  Eigen::Index residuals = 0;
  int iterations = 0;
  bool converged = false;
  bool determined = true;  ///< false: J^T J is singular; inverseNormal is empty

  /// Variance of a residual by the degrees of freedom; 0 where there are none.
  double variance() const {
    return residuals > x.size() ? sumOfSquares / static_cast<double>(residuals - x.size()) : 0;
  }
};

/// Fills the residuals at x; false where the model has none there (a point behind the camera): such a step is
/// refused.
using ResidualFunction = std::function<bool(const Eigen::VectorXd& x, Eigen::VectorXd& residuals)>;

/// Levenberg and Marquardt's method with central differences, for problems of up to some dozen unknowns that
/// are solved now and then. `scale`: a change of each unknown that matters little but shows, the step of the
/// differences times a thousand. Throws std::invalid_argument where x0 has no residuals: that is for the
/// caller to see to. Cost: 2 n + 1 evaluations an iteration.
LeastSquaresSolution minimiseSquares(const ResidualFunction& function, const Eigen::VectorXd& x0,
                                     const Eigen::VectorXd& scale, const LeastSquaresOptions& options = {});

}  // namespace patina
