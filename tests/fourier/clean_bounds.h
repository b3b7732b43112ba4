#pragma once

#include <gtest/gtest.h>

#include <string>

#include "engine/fourier/fit.h"
#include "tests/results/truth_compare.h"
#include "tests/test_data.h"

namespace patina::test {

/// Median errors that an independent implementation of the model stays within; diffuse is an absolute albedo,
/// specular and sigma are relative.
struct CleanBounds {
  const char* bundle;
  double diffuse, specular, sigma, normalDeg, heldOutOverNoise;
};
inline constexpr CleanBounds kCleanLaminate{"clean_laminate", 0.004, 0.025, 0.018, 0.08, 1.035},
    kCleanCardstock{"clean_cardstock", 0.02, 0.18, 0.12, 0.75, 1.02};

/// Fits the bundle with default options and holds the errors to the bounds. Fails the calling test.
inline void expectWithinBounds(const CleanBounds& bounds) {
  const auto folder = sharedData() / "fourier" / bounds.bundle;
  const auto capture = readFourierCapture(folder);
  ASSERT_TRUE(capture.ok()) << capture.error().sentence();
  const auto fit = fitFourier(*capture, {}, {});
  ASSERT_TRUE(fit.ok()) << fit.error().sentence();
  const auto truth = readTruth(folder);
  ASSERT_TRUE(truth.ok()) << truth.error().sentence();
  const TruthErrors errors = compareWithTruth((*fit)->maps(), *truth);
  const FourierFitStats& stats = (*fit)->stats();
  const double ratio = stats.holdoutRms / stats.noiseFloorHoldout;
  ASSERT_GT(errors.compared, 2000u);
  EXPECT_LE(errors.diffuseAbsolute.median, bounds.diffuse);
  EXPECT_LE(errors.specular.median, bounds.specular);
  EXPECT_LE(errors.sigma.median, bounds.sigma);
  EXPECT_LE(errors.normalDeg.median, bounds.normalDeg);
  EXPECT_LE(ratio, bounds.heldOutOverNoise);
  EXPECT_GT(ratio, 0.97);  // below the noise: the figure itself would be wrong
  testing::Test::RecordProperty("diffuse", std::to_string(errors.diffuseAbsolute.median));
  testing::Test::RecordProperty("specular", std::to_string(errors.specular.median));
  testing::Test::RecordProperty("sigma", std::to_string(errors.sigma.median));
  testing::Test::RecordProperty("normal", std::to_string(errors.normalDeg.median));
  testing::Test::RecordProperty("held_out_over_noise", std::to_string(ratio));
}

}  // namespace patina::test
