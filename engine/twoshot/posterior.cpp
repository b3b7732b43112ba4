#include "engine/twoshot/posterior.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "engine/base/dense.h"

namespace patina {
namespace {

/// Directions that the rows shrink by less than this share are left as the prior has them: the posterior's
/// variance changes by less than that.
constexpr double kSmallestShrink = 0.01;

/// Calibration, exponent and the residuals' range from the materials left out; `predicted`: variance, mean
/// over cells.
void calibrate(const LeaveOneOut& left, double predicted, Posterior* posterior) {
  std::vector<double> sorted;
  double meanX = 0, meanY = 0;
  for (std::size_t i = 0; i < left.rms.size(); ++i) {
    if (!(left.residual[i] > 0) || !(left.rms[i] > 0)) continue;
    sorted.push_back(left.residual[i]);
    meanX += std::log(left.residual[i]), meanY += std::log(left.rms[i]);
  }
  if (sorted.size() < 3 || !(predicted > 0)) return;
  const auto count = static_cast<double>(sorted.size());
  meanX /= count, meanY /= count;
  double xx = 0, xy = 0;
  for (std::size_t i = 0; i < left.rms.size(); ++i) {
    if (!(left.residual[i] > 0) || !(left.rms[i] > 0)) continue;
    const double x = std::log(left.residual[i]) - meanX;
    xx += x * x, xy += x * (std::log(left.rms[i]) - meanY);
  }
  std::sort(sorted.begin(), sorted.end());
  posterior->exponent = xx > 0 ? std::clamp(xy / xx, 0.0, 1.0) : 0;
  posterior->typicalResidual = std::exp(meanX);
  posterior->smallestResidual = sorted[sorted.size() * 5 / 100];
  posterior->largestResidual = sorted[sorted.size() * 95 / 100];
  double squares = 0;
  for (std::size_t i = 0; i < left.rms.size(); ++i) {
    if (!(left.residual[i] > 0) || !(left.rms[i] > 0)) continue;
    const double scaled = left.rms[i] / posterior->widening(left.residual[i]);
    squares += scaled * scaled / count;
  }
  posterior->calibration = std::sqrt(squares / predicted);
}

}  // namespace

double Posterior::widening(double residual) const {
  if (!(typicalResidual > 0)) return 1;
  return std::pow(std::max(residual, smallestResidual) / typicalResidual, exponent);
}

LeaveOneOut leaveOneOut(const Basis& basis, const RowFactor& rows, double rowWeight, double eta,
                        BasisRegion region, const std::vector<int>& only, const JobContext& job) {
  const Eigen::MatrixXd& columns = basis.columnCoefficients();
  const Eigen::Index m = columns.cols(), materials = m / 3;
  const double others = static_cast<double>(m - 3);
  // A row's standard deviation, sqrt(eta / m), is what stays.
  const double otherEta = eta * others / static_cast<double>(m);
  const Eigen::MatrixXd seen = product(rows.factor, false, columns, false);  // F C, r x m
  const Eigen::MatrixXd kernel = gramOfRows(rows.factor);
  LeaveOneOut out;
  out.error.resize(columns.rows(), m);
  out.residual.assign(m, 0.0), out.rms.assign(m, 0.0);
  const auto wanted = only.empty() ? materials : static_cast<Eigen::Index>(only.size());
  tbb::parallel_for(Eigen::Index{0}, wanted, [&](Eigen::Index w) {
    if (job.cancelled()) return;
    const Eigen::Index j = only.empty() ? w : only[w];
    const Eigen::MatrixXd own = columns.middleCols(3 * j, 3), ownSeen = seen.middleCols(3 * j, 3);
    const Eigen::VectorXd mean = -own.rowwise().sum() / others, meanSeen = -ownSeen.rowwise().sum() / others;
    Eigen::MatrixXd system =
        kernel - ownSeen * ownSeen.transpose() - others * meanSeen * meanSeen.transpose();
    system.diagonal().array() += otherEta;
    const Eigen::MatrixXd dual = system.llt().solve(ownSeen.colwise() - meanSeen);  // r x 3
    const Eigen::MatrixXd back = rows.factor.transpose() * dual;                    // k x 3
    const Eigen::MatrixXd found =
        back - own * (own.transpose() * back) - others * mean * (mean.transpose() * back);
    out.error.middleCols(3 * j, 3) = (own.colwise() - mean) - found;
    for (Eigen::Index c = 0; c < 3; ++c) {
      // (K + eta)^-1 eta times the rows is what a ridge leaves of its rows.
      out.residual[3 * j + c] = otherEta * dual.col(c).norm() / std::sqrt(rowWeight);
    }
  });
  if (job.cancelled()) return {};
  const Eigen::MatrixXd weighted = product(basis.gramRoot(region), false, out.error, false);
  const double cells = static_cast<double>(basis.cellCount(region));
  for (Eigen::Index i = 0; i < m; ++i) out.rms[i] = weighted.col(i).norm() / std::sqrt(cells);
  return out;
}

Posterior makePosterior(const Basis& basis, const Eigen::MatrixXd& directions,
                        const Eigen::VectorXd& eigenvalues, double eta, const LeaveOneOut& left,
                        double residual) {
  Posterior posterior;
  Eigen::Index rank = 0;
  while (rank < eigenvalues.size() && eigenvalues[rank] > kSmallestShrink * eta) ++rank;
  posterior.observed = directions.leftCols(rank).transpose();
  const Eigen::VectorXd shrink =
      (eigenvalues.head(rank).array() / (eigenvalues.head(rank).array() + eta)).matrix();
  posterior.shrunk = shrink.asDiagonal();
  const Eigen::MatrixXd& gram = basis.gram(BasisRegion::All);
  const double m = basis.columnCount(), cells = static_cast<double>(basis.cellCount(BasisRegion::All));
  const double prior = gram.trace() / (m * cells);
  const Eigen::MatrixXd half = product(gram, false, directions.leftCols(rank), false);
  double predicted = prior;
  for (Eigen::Index i = 0; i < rank; ++i)
    predicted -= shrink[i] * half.col(i).dot(directions.col(i)) / (m * cells);
  calibrate(left, predicted, &posterior);
  posterior.fit = posterior.widening(residual);
  const double factor = posterior.calibration * posterior.fit;
  posterior.scale = factor * factor / m;
  posterior.priorSd = factor * std::sqrt(prior);
  return posterior;
}

}  // namespace patina
