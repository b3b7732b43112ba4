#include "engine/calibration/screen_response.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/calibration/monotone.h"

namespace patina {
namespace {

using testing::ElementsAre;

std::vector<GreySample> ramp(double gamma, double noise, int count = 33) {
  std::vector<GreySample> samples;
  std::mt19937 random(8);
  std::normal_distribution<double> normal(0, noise);
  for (const double value : greyRamp(count)) {
    const double light = 0.003 + 0.997 * std::pow(value, gamma);
    samples.push_back({value, Eigen::Vector3d(2.0, 1.7, 1.1) * (light + normal(random))});
  }
  return samples;
}

TEST(ScreenCurve, InvertsAMeasuredCurve) {
  const Result<ScreenCurve> found = fitScreenResponse(ramp(2.2, 0.0005));
  ASSERT_TRUE(found.ok()) << found.error().sentence();
  // 0.2 % of white: what the ramp's noise and its 33 steps leave.
  for (double v = 0; v <= 1; v += 0.01) EXPECT_NEAR(found->lightOf(v), std::pow(v, 2.2), 0.002) << v;
  for (double l = 0.02; l <= 1; l += 0.02) EXPECT_NEAR(std::pow(found->valueFor(l), 2.2), l, 0.002) << l;
  EXPECT_NEAR(found->exponent, 2.2, 0.02);
  EXPECT_NEAR(found->blackShare, 0.003, 0.001);
  EXPECT_TRUE(found->warnings.empty());
  const std::vector<double> table = found->inverseTable(256);
  ASSERT_EQ(table.size(), 256u);
  EXPECT_EQ(table.front(), 0);
  EXPECT_NEAR(table.back(), 1, 1e-9);
  for (std::size_t i = 1; i < table.size(); ++i) EXPECT_GE(table[i], table[i - 1]);
}

TEST(ScreenCurve, RefusesWhatIsNoRamp) {
  std::vector<GreySample> samples = ramp(2.2, 0);
  EXPECT_FALSE(fitScreenResponse({samples.begin(), samples.begin() + 3}).ok());
  EXPECT_FALSE(fitScreenResponse({samples.begin(), samples.begin() + 20}).ok()) << "no white";
  for (GreySample& sample : samples) sample.light.setConstant(0.5);
  EXPECT_FALSE(fitScreenResponse(samples).ok());
  samples = ramp(2.2, 0);
  samples[10].light *= 3;
  EXPECT_FALSE(fitScreenResponse(samples)->warnings.empty());
}

TEST(ScreenCurve, ThresholdedFramesAddUpToThePattern) {
  Image pattern(64, 32, 1);
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 64; ++x) pattern.at(x, y) = static_cast<float>(x + y / 32.0) / 64;
  constexpr int kFrames = 180;  // three seconds at 60 Hz
  Image sum(64, 32, 1);
  for (int frame = 0; frame < kFrames; ++frame) {
    const Image shown = thresholdedFrame(pattern, frame, kFrames);
    for (std::size_t i = 0; i < sum.samples().size(); ++i) {
      ASSERT_TRUE(shown.samples()[i] == 0 || shown.samples()[i] == 1);
      sum.samples()[i] += shown.samples()[i] / kFrames;
    }
  }
  for (std::size_t i = 0; i < sum.samples().size(); ++i)
    EXPECT_NEAR(sum.samples()[i], pattern.samples()[i], 0.5 / kFrames + 1e-5);
  EXPECT_EQ(whiteFrames(0, kFrames), 0);
  EXPECT_EQ(whiteFrames(1, kFrames), kFrames);
  EXPECT_EQ(whiteFrames(0.5, kFrames), kFrames / 2);
}

TEST(ScreenCurve, MeanLightLeavesOutTheOdd) {
  Image photo(20, 20, 3, 0.5f);
  photo.at(3, 3, 1) = 100;
  EXPECT_NEAR(meanLight(photo, {})[1], 0.5, 1e-6);
  EXPECT_NEAR(meanLight(photo, {-5, -5, 10, 10})[0], 0.5, 1e-6);
}

TEST(Monotone, PoolsViolatorsAndNeverOvershoots) {
  EXPECT_THAT(isotonic({1, 3, 2, 4}, {1, 1, 1, 1}), ElementsAre(1, 2.5, 2.5, 4));
  EXPECT_THAT(isotonic({3, 2, 1}, {1, 1, 2}), ElementsAre(1.75, 1.75, 1.75));
  const std::vector<double> x = {0, 0.3, 0.4, 0.9, 1}, y = {0, 0, 0.8, 0.85, 1};
  double last = -1;
  for (double at = 0; at <= 1.0001; at += 0.001) {
    const double value = monotoneCubic(x, y, at);
    EXPECT_GE(value, last - 1e-12) << at;
    EXPECT_GE(value, 0);
    EXPECT_LE(value, 1);
    last = value;
  }
  for (std::size_t i = 0; i < x.size(); ++i) EXPECT_NEAR(monotoneCubic(x, y, x[i]), y[i], 1e-12);
}

}  // namespace
}  // namespace patina
