#include "engine/base/least_squares.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <stdexcept>

namespace patina {

LeastSquaresSolution minimiseSquares(const ResidualFunction& function, const Eigen::VectorXd& x0,
                                     const Eigen::VectorXd& scale, const LeastSquaresOptions& options) {
  LeastSquaresSolution solution;
  solution.x = x0;
  const Eigen::Index n = x0.size();
  Eigen::VectorXd residuals, ahead, behind;
  if (!function(x0, residuals) || !residuals.allFinite())
    throw std::invalid_argument("least squares: no residuals at the start");
  solution.sumOfSquares = residuals.squaredNorm();
  solution.residuals = residuals.size();

  Eigen::MatrixXd jacobian(residuals.size(), n), normal;
  const auto differentiate = [&] {
    for (Eigen::Index k = 0; k < n; ++k) {
      const double step = 1e-3 * scale[k];
      Eigen::VectorXd x = solution.x;
      x[k] += step;
      const bool hasAhead = function(x, ahead);
      x[k] = solution.x[k] - step;
      const bool hasBehind = function(x, behind);
      // At the edge of where the model has residuals one side must do.
      if (hasAhead && hasBehind) {
        jacobian.col(k) = (ahead - behind) / (2 * step);
      } else if (hasAhead) {
        jacobian.col(k) = (ahead - residuals) / step;
      } else if (hasBehind) {
        jacobian.col(k) = (residuals - behind) / step;
      } else {
        jacobian.col(k).setZero();
      }
    }
    normal = jacobian.transpose() * jacobian;
  };

  double damping = 1e-4;
  differentiate();
  for (; solution.iterations < options.iterations && !solution.converged; ++solution.iterations) {
    if (options.stop.stop_requested()) break;
    const Eigen::VectorXd gradient = jacobian.transpose() * residuals;
    bool moved = false;
    for (int attempt = 0; attempt < 12 && !moved; ++attempt) {
      Eigen::MatrixXd damped = normal;
      for (Eigen::Index k = 0; k < n; ++k)
        damped(k, k) += damping * std::max(normal(k, k), 1e-12 / (scale[k] * scale[k]));
      const Eigen::VectorXd step = -damped.ldlt().solve(gradient);
      Eigen::VectorXd trial;
      const Eigen::VectorXd x = solution.x + step;
      if (step.allFinite() && function(x, trial) && trial.squaredNorm() <= solution.sumOfSquares) {
        moved = true;
        const double before = solution.sumOfSquares;
        solution.x = x;
        solution.sumOfSquares = trial.squaredNorm();
        residuals = std::move(trial);
        damping = std::max(damping * 0.1, 1e-12);
        solution.converged = (step.array().abs() / scale.array()).maxCoeff() < options.relativeStep ||
                             before - solution.sumOfSquares <= 1e-14 * before;
      } else {
        damping = std::min(damping * 10, 1e12);
      }
    }
    if (!moved) solution.converged = true;  // no step, however short, leads down: rounding decides
    if (moved) differentiate();
  }
  // Scaled, so that singular means singular and not a choice of units.
  const Eigen::MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> spectrum(scaled);
  const Eigen::VectorXd& values = spectrum.eigenvalues();
  solution.determined = spectrum.info() == Eigen::Success && values[0] > 1e-14 * values[n - 1];
  if (solution.determined)
    solution.inverseNormal = scale.asDiagonal() * spectrum.eigenvectors() *
                             values.cwiseInverse().asDiagonal() * spectrum.eigenvectors().transpose() *
                             scale.asDiagonal();
  return solution;
}

}  // namespace patina
