#include "engine/diagnosis/residual_components.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace patina {
namespace {

constexpr double kRounding = 1e-12;  // of sums of four numbers about 1
constexpr int kFrequencies = 3;

DiagnosisCapture layout() {
  DiagnosisCapture capture;
  for (int f = 0; f < kFrequencies; ++f) {
    capture.frequencies.push_back({f + 1, 0});
    for (int k = 0; k < 4; ++k) capture.rows.push_back({4 * f + k, f, k, f == 2, 0.0});
  }
  capture.rows.push_back({4 * kFrequencies, -1, 0, false, 0.0});
  return capture;
}

TEST(ResidualComponents, TurningKeepsLengthsAndSeparatesPhases) {
  const DiagnosisCapture capture = layout();
  const auto rows = static_cast<Eigen::Index>(capture.rowCount());
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd m(3 * rows, 2);
  for (Eigen::Index i = 0; i < m.size(); ++i) m.data()[i] = normal(random);
  Eigen::MatrixXd turned = m;
  turnToComponents(capture, turned);
  for (Eigen::Index c = 0; c < 2; ++c) EXPECT_NEAR(turned.col(c).norm(), m.col(c).norm(), kRounding * 10);
  EXPECT_NEAR(m.col(0).dot(m.col(1)), turned.col(0).dot(turned.col(1)), kRounding * 10);
  // A factor that all four photographs share is in their sum alone; the window's row stays.
  Eigen::MatrixXd same = Eigen::MatrixXd::Ones(3 * rows, 1);
  turnToComponents(capture, same);
  for (Eigen::Index r = 0; r + 1 < rows; ++r)
    EXPECT_NEAR(same(r, 0), r % 4 == kEvenSum ? 2 : 0, kRounding) << r;
  EXPECT_EQ(same(rows - 1, 0), 1);
}

TEST(ResidualComponents, APhotographsSharesAreItsColumnTurned) {
  const DiagnosisCapture capture = layout();
  const auto rows = static_cast<Eigen::Index>(capture.rowCount());
  for (std::size_t photo = 0; photo < capture.rowCount(); ++photo) {
    Eigen::MatrixXd one = Eigen::MatrixXd::Zero(3 * rows, 1);
    one(static_cast<Eigen::Index>(photo), 0) = 1;
    turnToComponents(capture, one);
    const ComponentShare share = componentsOf(capture, photo);
    for (int k = 0; k < share.count; ++k) {
      EXPECT_NEAR(one(static_cast<Eigen::Index>(share.row[k]), 0), share.share[k], kRounding) << photo;
      one(static_cast<Eigen::Index>(share.row[k]), 0) = 0;
    }
    EXPECT_NEAR(one.norm(), 0, kRounding) << "nothing lands elsewhere";
  }
}

TEST(ResidualComponents, WeightsKnowTheSplitTheScatterAndWhatWasDropped) {
  DiagnosisCapture capture = layout();
  DiagnosisSite site;
  site.weight.assign(capture.rowCount() * 3, 4.0f);
  site.weight[0] = site.weight[2 * 3] = 0;  // red, first frequency: phases 0 and 2 were clipped
  capture.inflation.assign(capture.rowCount() * 3, 1.0f);
  capture.inflation[(4 + kOddSine) * 3] = 9;
  const Eigen::VectorXd fitted = rootWeights(capture, site, false), held = rootWeights(capture, site, true);
  EXPECT_EQ(fitted[kOddSine], 0);
  EXPECT_EQ(fitted[kEvenSum], 0);
  EXPECT_EQ(fitted[kOddCosine], 2);
  EXPECT_NEAR(fitted[4 + kOddSine], 2.0 / 3, 1e-6);
  EXPECT_EQ(fitted[8], 0) << "held out";
  EXPECT_EQ(held[8], 2);
  EXPECT_EQ(held[4], 0);
}

}  // namespace
}  // namespace patina
