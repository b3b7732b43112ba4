#include "engine/twoshot/metric.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/twoshot/direct_basis.h"

namespace patina {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using test::DirectBasis;

// Double precision over sums of a few thousand terms; the specification's own figure.
constexpr double kDirectTolerance = 1e-9;
constexpr int kCells = 700, kColumns = 30;

class EquationFifteen : public testing::Test {
 protected:
  EquationFifteen() : columns_(DirectBasis::madeUpColumns(kCells, kColumns, 7)) {
    basis_ = std::make_shared<DirectBasis>(columns_);
  }
  // Tolerances at which nothing that double precision can see is dropped.
  RowFactor exactly(const MatrixXd& rows) const { return reduceRows(rows, 1, 1e-13); }

  MatrixXd columns_;
  std::shared_ptr<DirectBasis> basis_;
  std::vector<int> few_{3, 77, 205, 402, 650}, many_ = [] {
    std::vector<int> cells;
    for (int i = 0; i < 80; ++i) cells.push_back(100 + i);
    for (int i = 0; i < 40; ++i) cells.push_back(500 + 3 * i);
    return cells;
  }();
};

// Equation 15 word by word: p x p nowhere, but Q+ and the selection as they stand.
struct Direct {
  double reconstruction, noise;
  std::vector<double> column;
};
Direct directForm(const DirectBasis& basis, const std::vector<int>& cells, double eta) {
  const MatrixXd& q = basis.q();
  const auto k = q.cols();
  MatrixXd selection = MatrixXd::Zero(static_cast<Eigen::Index>(cells.size()), q.rows());
  for (std::size_t i = 0; i < cells.size(); ++i) selection(static_cast<Eigen::Index>(i), cells[i]) = 1;
  const MatrixXd sq = selection * q;
  const MatrixXd inverse =
      (sq.transpose() * sq + eta * MatrixXd::Identity(k, k)).fullPivLu().solve(sq.transpose());
  const MatrixXd pseudo = (q.transpose() * q).fullPivLu().solve(q.transpose());
  Direct direct{};
  for (Eigen::Index i = 0; i < basis.centred().cols(); ++i) {
    const VectorXd y = basis.centred().col(i);
    const double error = (q * (pseudo * y - inverse * (selection * y))).norm();
    direct.column.push_back(error / std::sqrt(q.rows()));
    direct.reconstruction += direct.column.back() / basis.centred().cols();
  }
  direct.noise = (q * (inverse * (selection * VectorXd::Ones(q.rows())))).norm() / std::sqrt(q.rows());
  return direct;
}

TEST_F(EquationFifteen, EqualsTheDirectForm) {
  for (const std::vector<int>& cells : {few_, many_}) {
    for (const double eta : {0.5, 40.0, 900.0}) {
      const Direct direct = directForm(*basis_, cells, eta);
      const MatrixXd rows = basis_->rowsAt(cells);
      const ErrorMetric metric(basis_, BasisRegion::All, eta);
      const ExpectedError expected = metric.expect(exactly(rows), rows.colwise().sum().transpose());
      EXPECT_NEAR(metric.training(exactly(rows)), direct.reconstruction,
                  kDirectTolerance * direct.reconstruction);
      EXPECT_NEAR(expected.training, direct.reconstruction, kDirectTolerance * direct.reconstruction);
      EXPECT_NEAR(expected.noise, direct.noise, kDirectTolerance * direct.noise);
      ASSERT_EQ(expected.column.size(), direct.column.size());
      for (std::size_t i = 0; i < direct.column.size(); ++i) {
        EXPECT_NEAR(expected.column[i], direct.column[i], kDirectTolerance * direct.column[i]);
      }
    }
  }
}

TEST_F(EquationFifteen, WithoutRowsTheBasisSpreadIsLeft) {
  const ErrorMetric metric(basis_, BasisRegion::All);
  const ExpectedError expected = metric.expect(RowFactor{MatrixXd(0, basis_->componentCount())});
  EXPECT_NEAR(expected.training, basis_->centred().colwise().norm().mean() / std::sqrt(kCells), 1e-12);
  EXPECT_NEAR(expected.prior, basis_->centred().norm() / std::sqrt(1.0 * kCells * kColumns), 1e-12);
  EXPECT_NEAR(expected.posterior, expected.prior, 1e-12);
}

TEST_F(EquationFifteen, FallsWithEveryRow) {
  const ErrorMetric metric(basis_, BasisRegion::All);
  double last = metric.training(RowFactor{MatrixXd(0, basis_->componentCount())});
  for (std::size_t n = 1; n <= few_.size(); ++n) {
    const double now = metric.training(exactly(basis_->rowsAt({few_.begin(), few_.begin() + n})));
    EXPECT_LT(now, last);
    last = now;
  }
}

TEST_F(EquationFifteen, SameRowsTwiceCountAsOnceAtHalfTheWeightEach) {
  const ErrorMetric metric(basis_, BasisRegion::All);
  std::vector<int> twice = few_;
  twice.insert(twice.end(), few_.begin(), few_.end());
  EXPECT_NEAR(metric.training(reduceRows(basis_->rowsAt(twice), std::sqrt(0.5), 1e-13)),
              metric.training(exactly(basis_->rowsAt(few_))), kDirectTolerance);
}

TEST_F(EquationFifteen, StackingEqualsReducingAtOnce) {
  const ErrorMetric metric(basis_, BasisRegion::All);
  const RowFactor first = exactly(basis_->rowsAt(few_)), second = exactly(basis_->rowsAt(many_));
  std::vector<int> both = few_;
  both.insert(both.end(), many_.begin(), many_.end());
  EXPECT_NEAR(metric.training(stack({&first, &second})), metric.training(exactly(basis_->rowsAt(both))),
              kDirectTolerance);
}

// What is dropped may change the error by less than the tolerance says, relative to itself.
TEST_F(EquationFifteen, DroppedRowsCountLessThanTheTolerance) {
  const ErrorMetric metric(basis_, BasisRegion::All);
  const MatrixXd rows = basis_->rowsAt(many_);
  const double exact = metric.training(exactly(rows));
  for (const double tolerance : {kSearchTolerance, kExactTolerance}) {
    const RowFactor reduced = reduceRows(rows, 1, tolerance);
    EXPECT_LT(reduced.rank(), 120);
    EXPECT_NEAR(metric.training(reduced), exact, tolerance * exact);
  }
}

// Rebuilds the basis without a material, from its columns, and reconstructs the material with it.
TEST_F(EquationFifteen, LeavingAMaterialOutEqualsRebuildingTheBasis) {
  const MatrixXd rows = basis_->rowsAt(many_);
  const ErrorMetric metric(basis_, BasisRegion::All);
  const ExpectedError expected = metric.expect(exactly(rows));
  ASSERT_EQ(expected.unseenMaterial.size(), kColumns / 3u);
  for (const int material : {0, 4, 9}) {
    MatrixXd others(kCells, kColumns - 3);
    others << columns_.leftCols(3 * material), columns_.rightCols(kColumns - 3 * material - 3);
    const VectorXd mean = others.rowwise().mean();
    const DirectBasis without(others);
    const MatrixXd tilde = without.rowsAt(many_);
    // eta = m s^2: fewer columns, the same standard deviation of a row.
    const double eta = kPaperEta * (kColumns - 3) / kColumns;
    double error = 0;
    for (int c = 0; c < 3; ++c) {
      const VectorXd y = columns_.col(3 * material + c) - mean;
      VectorXd observed(static_cast<Eigen::Index>(many_.size()));
      for (std::size_t i = 0; i < many_.size(); ++i) observed[static_cast<Eigen::Index>(i)] = y[many_[i]];
      const VectorXd a = (tilde.transpose() * tilde + eta * MatrixXd::Identity(tilde.cols(), tilde.cols()))
                             .llt()
                             .solve(tilde.transpose() * observed);
      error += (without.q() * a - y).norm() / std::sqrt(kCells) / 3;
    }
    // What lies outside of the other columns' span is in the true error; in coefficient space too.
    EXPECT_NEAR(expected.unseenMaterial[material], error, 1e-7 * error);
  }
  EXPECT_GT(expected.unseen, expected.training);
}

TEST_F(EquationFifteen, PosteriorIsTheErrorOfBrdfsDrawnFromThePrior) {
  const MatrixXd rows = basis_->rowsAt(many_);
  const ErrorMetric metric(basis_, BasisRegion::All);
  const ExpectedError expected = metric.expect(exactly(rows));
  // c ~ N(0, I / m), rows with noise of variance eta / m; the mean square error over many draws.
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  const auto k = basis_->componentCount();
  const double m = kColumns;
  const MatrixXd system = rows.transpose() * rows + kPaperEta * MatrixXd::Identity(k, k);
  const Eigen::LLT<MatrixXd> solve(system);
  double sum = 0;
  constexpr int kDraws = 3000;
  for (int draw = 0; draw < kDraws; ++draw) {
    VectorXd c(k), noise(rows.rows());
    for (auto& value : c) value = normal(random) / std::sqrt(m);
    for (auto& value : noise) value = normal(random) * std::sqrt(kPaperEta / m);
    const VectorXd estimate = solve.solve(rows.transpose() * (rows * c + noise));
    sum += (basis_->q() * (estimate - c)).squaredNorm() / kCells;
  }
  // 3000 draws of a sum dominated by a few components: about 2 % of spread.
  EXPECT_NEAR(std::sqrt(sum / kDraws), expected.posterior, 0.06 * expected.posterior);
}

TEST(ConditionNumber, IsTheRatioOfSingularValues) {
  MatrixXd rows(2, 3);
  rows << 3, 0, 0, 0, 0.5, 0;
  EXPECT_NEAR(conditionNumber(rows), 6, 1e-12);
  rows.row(1) = rows.row(0);
  EXPECT_TRUE(std::isinf(conditionNumber(rows)));
}

}  // namespace
}  // namespace patina
