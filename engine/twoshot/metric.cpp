#include "engine/twoshot/metric.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/base/dense.h"

namespace patina {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

RowFactor reduceRows(const MatrixXd& rows, double rowScale, double tolerance) {
  const Index n = rows.rows(), k = rows.cols();
  RowFactor reduced;
  reduced.factor.resize(0, k);
  if (n == 0) return reduced;
  // Cholesky with pivots of the rows' products, K = Q~ Q~^T, until what is left of K (its trace: the squares
  // of what no chosen row explains) no longer counts beside eta.
  const MatrixXd products = gramOfRows(rows) * (rowScale * rowScale);
  VectorXd left = products.diagonal();
  const double enough = std::max(tolerance * kPaperEta, 1e-13 * left.sum());
  const Index most = std::min(n, k);
  MatrixXd lower(n, most);
  Index rank = 0;
  while (rank < most && left.cwiseMax(0).sum() > enough) {
    Index pivot = 0;
    const double largest = left.maxCoeff(&pivot);
    if (!(largest > 0)) break;
    auto column = lower.col(rank);
    column = products.col(pivot);
    column.noalias() -= lower.leftCols(rank) * lower.row(pivot).head(rank).transpose();
    column /= std::sqrt(largest);
    left.array() -= column.array().square();
    left(pivot) = 0;
    ++rank;
  }
  // Q~ projected onto L's columns: F = U^-T L^T Q~ with L^T L = U^T U, so that F^T F = Q~^T P Q~.
  const MatrixXd kept = lower.leftCols(rank);
  const Eigen::LLT<MatrixXd> square(gramOfColumns(kept));
  reduced.factor = product(kept, true, rows, false) * rowScale;
  square.matrixL().solveInPlace(reduced.factor);
  return reduced;
}

RowFactor stack(const std::vector<const RowFactor*>& factors) {
  Index rows = 0, columns = 0;
  for (const RowFactor* factor : factors) {
    rows += factor->factor.rows();
    columns = std::max(columns, factor->factor.cols());
  }
  RowFactor stacked;
  stacked.factor.resize(rows, columns);
  Index at = 0;
  for (const RowFactor* factor : factors) {
    stacked.factor.middleRows(at, factor->factor.rows()) = factor->factor;
    at += factor->factor.rows();
  }
  return stacked;
}

namespace {

// L X for the region's root L, which is diagonal over the whole grid.
MatrixXd weigh(const Basis& basis, BasisRegion region, const MatrixXd& x) {
  if (region == BasisRegion::All) return basis.singularValues().asDiagonal() * x;
  return product(basis.gramRoot(region), false, x, false);
}

// F F^T + eta I, factorised.
Eigen::LLT<MatrixXd> dualSystem(const MatrixXd& factor, double eta) {
  MatrixXd system = gramOfRows(factor);
  system.diagonal().array() += eta;
  return Eigen::LLT<MatrixXd>(system);
}

double quantile(std::vector<double> values, double at) {
  if (values.empty()) return 0;
  const double place = at * static_cast<double>(values.size() - 1);
  const auto low = static_cast<std::size_t>(place);
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(low), values.end());
  const double first = values[low];
  if (low + 1 >= values.size()) return first;
  const double second =
      *std::min_element(values.begin() + static_cast<std::ptrdiff_t>(low) + 1, values.end());
  return first + (place - static_cast<double>(low)) * (second - first);
}

}  // namespace

ErrorMetric::ErrorMetric(BasisPtr basis, BasisRegion region, double eta)
    : basis_(std::move(basis)), region_(region), eta_(eta) {
  weighted_ = weigh(*basis_, region_, basis_->columnCoefficients());
}

double ErrorMetric::training(const RowFactor& rows) const {
  const auto cells = static_cast<double>(basis_->cellCount(region_));
  const MatrixXd& f = rows.factor;
  MatrixXd error = weighted_;
  if (f.rows() > 0) {
    MatrixXd inside = product(f, false, basis_->columnCoefficients(), false);  // F C, r x m
    dualSystem(f, eta_).solveInPlace(inside);
    multiply(weigh(*basis_, region_, f.transpose()), false, inside, false, error, -1, 1);
  }
  return error.colwise().norm().mean() / std::sqrt(cells);
}

ExpectedError ErrorMetric::expect(const RowFactor& rows, const VectorXd& rowSum) const {
  const double rootCells = std::sqrt(static_cast<double>(basis_->cellCount(region_)));
  const MatrixXd& f = rows.factor;
  const MatrixXd& c = basis_->columnCoefficients();
  const Index m = c.cols(), r = f.rows();
  ExpectedError expected;

  const MatrixXd root = weigh(*basis_, region_, MatrixXd::Identity(c.rows(), c.rows()));
  const Eigen::LLT<MatrixXd> system = dualSystem(f, eta_);
  const MatrixXd image = product(f, false, c, false);    // F C, r x m
  const MatrixXd rootF = product(root, false, f, true);  // L F^T, k x r
  const MatrixXd error = weighted_ - product(rootF, false, system.solve(image), false);
  expected.column.resize(m);
  for (Index i = 0; i < m; ++i) expected.column[i] = error.col(i).norm() / rootCells;
  expected.training = error.colwise().norm().mean() / rootCells;
  expected.prior = root.norm() / rootCells / std::sqrt(static_cast<double>(m));
  // tr(L R L^T) with R = I - F^T (F F^T + eta I)^-1 F.
  const double trace = root.squaredNorm() -
                       (r > 0 ? rootF.cwiseProduct(system.solve(rootF.transpose()).transpose()).sum() : 0);
  expected.posterior = std::sqrt(std::max(trace, 0.0) / static_cast<double>(m)) / rootCells;
  if (rowSum.size() == c.rows()) {
    // (SQ)+_eta S O = (G + eta I)^-1 Q~^T 1 = R (Q~^T 1) / eta
    const VectorXd fitted = rowSum - f.transpose() * system.solve(f * rowSum);
    expected.noise = (root * fitted).norm() / eta_ / rootCells;
  }

  // Leaving a material out: the others' coefficients have mean mu and, times m - 3, the covariance
  // P = C C^T - C_j C_j^T - (m - 3) mu mu^T, where C C^T = I and the columns sum to zero. The reconstruction
  // is mu + P F^T (F P F^T + eta' I)^-1 F (c - mu), eta' = eta (m - 3) / m: a row's standard deviation is
  // what stays.
  if (m >= 9 && m % 3 == 0) {
    const auto others = static_cast<double>(m - 3);
    const double eta = eta_ * others / static_cast<double>(m);
    MatrixXd base = gramOfRows(f);
    base.diagonal().array() += eta;
    for (Index j = 0; j < m; j += 3) {
      MatrixXd change(c.rows(), 4);
      change.leftCols(3) = c.middleCols(j, 3);
      change.col(3) = -c.middleCols(j, 3).rowwise().sum() / others;
      const Eigen::Vector4d scale(1, 1, 1, others);
      const MatrixXd seen = f * change;  // r x 4
      const MatrixXd reduced = base - seen * scale.asDiagonal() * seen.transpose();
      const Eigen::LLT<MatrixXd> without(reduced);
      const MatrixXd start = change.leftCols(3).colwise() - change.col(3);
      const MatrixXd z = without.solve(f * start);
      const MatrixXd estimate = f.transpose() * z - change * (scale.asDiagonal() * (seen.transpose() * z));
      const MatrixXd missed = root * (start - estimate);
      expected.unseenMaterial.push_back(missed.colwise().norm().mean() / rootCells);
    }
    double sum = 0;
    for (const double error : expected.unseenMaterial) sum += error;
    expected.unseen = sum / static_cast<double>(expected.unseenMaterial.size());
    expected.unseenMedian = quantile(expected.unseenMaterial, 0.5);
    expected.unseenWorstTenth = quantile(expected.unseenMaterial, 0.9);
  }
  return expected;
}

double conditionNumber(const MatrixXd& rows) {
  if (rows.size() == 0) return std::numeric_limits<double>::infinity();
  const VectorXd values = singularValues(rows);
  const double largest = values(0), smallest = values(values.size() - 1);
  // Below the rounding of the decomposition a singular value says nothing.
  const double rounding = largest * 1e-15 * static_cast<double>(std::max(rows.rows(), rows.cols()));
  return smallest > rounding ? largest / smallest : std::numeric_limits<double>::infinity();
}

RowFactor rowsOfShot(const Basis& basis, const ShotDirections& shot, const NearFieldDisc& disc,
                     double tolerance) {
  const std::vector<HalfDiffAngles> directions = discDirections(shot, disc);
  const BasisRows rows = basis.rows(directions);
  const bool point = disc.fovDeg <= 0;
  // By the disc's own count, not by the rows that are left: a half-hidden disc tells less.
  return reduceRows(rows.components, point ? 1.0 : std::sqrt(kEtaRows / disc.points), tolerance);
}

}  // namespace patina
