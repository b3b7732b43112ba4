#include "engine/twoshot/basis_subset.h"

#include <gtest/gtest.h>

#include "tests/twoshot/direct_basis.h"

namespace patina {
namespace {

using Eigen::MatrixXd;
using test::DirectBasis;

constexpr int kCells = 600, kColumns = 36;

class LeftOut : public testing::Test {
 protected:
  LeftOut() : columns_(DirectBasis::madeUpColumns(kCells, kColumns, 3)) {
    whole_ = std::make_shared<DirectBasis>(columns_);
    MatrixXd others(kCells, kColumns - 6);
    others << columns_.leftCols(6), columns_.middleCols(9, 12), columns_.rightCols(kColumns - 24);
    rebuilt_ = std::make_shared<DirectBasis>(others);
    subset_ = basisWithout(whole_, {2, 7});
  }
  MatrixXd columns_;
  std::shared_ptr<DirectBasis> whole_, rebuilt_;
  BasisPtr subset_;
};

TEST_F(LeftOut, HasTheSingularValuesOfTheRebuiltBasis) {
  ASSERT_EQ(subset_->columnCount(), kColumns - 6);
  ASSERT_EQ(subset_->componentCount(), rebuilt_->componentCount());
  EXPECT_LT((subset_->singularValues() - rebuilt_->singularValues()).norm(),
            1e-9 * rebuilt_->singularValues().norm());
  const MatrixXd c = subset_->columnCoefficients();
  EXPECT_LT((c * c.transpose() - MatrixXd::Identity(c.rows(), c.rows())).norm(), 1e-9);
}

TEST_F(LeftOut, ExpectsTheSameErrorAsTheRebuiltBasis) {
  std::vector<int> cells;
  for (int i = 0; i < 40; ++i) cells.push_back(7 * i + 20);
  const RowFactor direct = reduceRows(rebuilt_->rowsAt(cells), 1, 1e-13);
  // The subset's rows are the whole basis' rows, turned; made here from a lone row at a time through
  // `errorsOfLeftOut`'s own road below, and directly for the metric.
  const ErrorMetric metric(rebuilt_, BasisRegion::All);
  const ExpectedError expected = metric.expect(direct);
  const RowFactor whole = reduceRows(whole_->rowsAt(cells), 1, 1e-13);
  const std::vector<double> trained = errorsOfLeftOut(whole_, {2, 7}, whole, {0, 5}, BasisRegion::All);
  EXPECT_NEAR(trained[0], (expected.column[0] + expected.column[1] + expected.column[2]) / 3, 1e-8);
  EXPECT_NEAR(trained[1], (expected.column[12] + expected.column[13] + expected.column[14]) / 3, 1e-8);
}

TEST_F(LeftOut, UnseenMaterialsAreReconstructedAsTheRebuiltBasisDoes) {
  std::vector<int> cells;
  for (int i = 0; i < 25; ++i) cells.push_back(11 * i + 3);
  const MatrixXd tilde = rebuilt_->rowsAt(cells);
  MatrixXd others(kCells, kColumns - 6);
  others << columns_.leftCols(6), columns_.middleCols(9, 12), columns_.rightCols(kColumns - 24);
  const Eigen::VectorXd mean = others.rowwise().mean();
  double error = 0;
  for (int c = 0; c < 3; ++c) {
    const Eigen::VectorXd y = columns_.col(21 + c) - mean;
    const Eigen::VectorXd a =
        (tilde.transpose() * tilde + kPaperEta * MatrixXd::Identity(tilde.cols(), tilde.cols()))
            .llt()
            .solve(tilde.transpose() * y(cells));
    error += (rebuilt_->q() * a - y).norm() / std::sqrt(kCells) / 3;
  }
  const RowFactor whole = reduceRows(whole_->rowsAt(cells), 1, 1e-13);
  EXPECT_NEAR(errorsOfLeftOut(whole_, {2, 7}, whole, {7}, BasisRegion::All)[0], error, 1e-7 * error);
}

TEST_F(LeftOut, RefusesWhatIsNotThere) {
  EXPECT_THROW(basisWithout(whole_, {12}), std::invalid_argument);
  EXPECT_THROW(basisWithout(whole_, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10}), std::invalid_argument);
}

}  // namespace
}  // namespace patina
