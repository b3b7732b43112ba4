#include "engine/base/least_squares.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

namespace patina {
namespace {

TEST(LeastSquares, FindsAKnownCurveAndHowSureItIs) {
  // y = a exp(-b t), 200 points, noise 0.01: many times over, errors in units of the stated deviation are
  // normal.
  std::mt19937 random(12);
  std::normal_distribution<double> normal(0, 0.01);
  double pulls = 0;
  constexpr int kTrials = 200;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<double> y;
    for (int i = 0; i < 200; ++i) y.push_back(1.3 * std::exp(-0.7 * i / 50.0) + normal(random));
    const auto residuals = [&](const Eigen::VectorXd& x, Eigen::VectorXd& r) {
      r.resize(200);
      for (int i = 0; i < 200; ++i) r[i] = x[0] * std::exp(-x[1] * i / 50.0) - y[i];
      return true;
    };
    const LeastSquaresSolution found =
        minimiseSquares(residuals, Eigen::Vector2d(0.5, 2), Eigen::Vector2d(1, 1));
    ASSERT_TRUE(found.converged);
    ASSERT_TRUE(found.determined);
    EXPECT_NEAR(found.variance(), 1e-4, 5e-5);
    for (int k = 0; k < 2; ++k) {
      const double error = found.x[k] - (k == 0 ? 1.3 : 0.7);
      pulls += error * error / (found.variance() * found.inverseNormal(k, k)) / (2 * kTrials);
    }
  }
  EXPECT_NEAR(pulls, 1, 0.3);  // 400 squares of normals: 0.07 standard deviation, and both are correlated
}

TEST(LeastSquares, StaysWhereTheModelIsDefinedAndSaysWhatIsNotDetermined) {
  const auto root = [](const Eigen::VectorXd& x, Eigen::VectorXd& r) {
    if (!(x[0] > 0)) return false;
    r.resize(2);
    r << std::sqrt(x[0]) - 0.1, 0.0 * x[1];
    return true;
  };
  const LeastSquaresSolution found = minimiseSquares(root, Eigen::Vector2d(9, 0), Eigen::Vector2d(1, 1));
  EXPECT_NEAR(found.x[0], 0.01, 1e-6);
  EXPECT_FALSE(found.determined) << "the second unknown is in no residual";
  EXPECT_THROW(minimiseSquares(root, Eigen::Vector2d(-1, 0), Eigen::Vector2d(1, 1)), std::invalid_argument);
}

}  // namespace
}  // namespace patina
