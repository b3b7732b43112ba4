// The statistic that docs/results.md is made of, on maps with errors that were put in by hand.
#include "tests/results/truth_compare.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/test_data.h"

namespace patina::test {
namespace {

constexpr int kSize = 20;
constexpr double kFloatDigits = 1e-5;  // maps hold floats near 1

TruthMaps uniformTruth(int size) {
  TruthMaps truth;
  truth.diffuse = Image(size, size, 3, 0.4f);
  truth.specular = Image(size, size, 3, 0.05f);
  truth.normal = Image(size, size, 3, 0.0f);
  for (int j = 0; j < size; ++j) {
    for (int i = 0; i < size; ++i) truth.normal.at(i, j, 2) = 1.0f;
  }
  truth.sigma = Image(size, size, 1, 0.1f);
  truth.kurtosis = Image(size, size, 1, 1.25f);
  return truth;
}

SvbrdfMaps asFitted(const TruthMaps& truth) {
  SvbrdfMaps maps;
  maps.width = truth.sigma.width();
  maps.height = truth.sigma.height();
  maps.diffuse = truth.diffuse;
  maps.specular = truth.specular;
  maps.normal = truth.normal;
  maps.sigma = truth.sigma;
  maps.kurtosis = truth.kurtosis;
  maps.status = Image(maps.width, maps.height, 1, static_cast<float>(TexelStatus::Converged));
  return maps;
}

TEST(TruthCompare, FindsNoErrorWhereThereIsNone) {
  const TruthMaps truth = uniformTruth(kSize);
  const TruthErrors errors = compareWithTruth(asFitted(truth), truth);
  EXPECT_EQ(errors.compared, static_cast<std::size_t>(kSize * kSize));
  EXPECT_EQ(errors.sigma.p95, 0);
  EXPECT_EQ(errors.normalDeg.p95, 0);
}

TEST(TruthCompare, MeasuresEachQuantity) {
  const TruthMaps truth = uniformTruth(kSize);
  SvbrdfMaps maps = asFitted(truth);
  for (float& value : maps.diffuse.samples()) value *= 1.02f;
  for (float& value : maps.specular.samples()) value *= 0.9f;
  for (float& value : maps.sigma.samples()) value *= 1.05f;
  for (float& value : maps.kurtosis.samples()) value *= 1.5f;
  const double tiltDeg = 0.25;
  for (int j = 0; j < kSize; ++j) {
    for (int i = 0; i < kSize; ++i) {
      maps.normal.at(i, j, 0) = static_cast<float>(std::sin(tiltDeg * std::numbers::pi / 180));
      maps.normal.at(i, j, 2) = static_cast<float>(std::cos(tiltDeg * std::numbers::pi / 180));
    }
  }
  const TruthErrors errors = compareWithTruth(maps, truth);
  EXPECT_NEAR(errors.diffuse.median, 0.02, kFloatDigits);
  EXPECT_NEAR(errors.specular.median, 0.1, kFloatDigits);
  EXPECT_NEAR(errors.sigma.median, 0.05, kFloatDigits);
  EXPECT_NEAR(errors.kurtosis.median, 0.5, kFloatDigits);
  EXPECT_NEAR(errors.normalDeg.median, tiltDeg, kFloatDigits);
  EXPECT_NEAR(errors.normalDeg.p95, tiltDeg, kFloatDigits);
}

TEST(TruthCompare, LeavesOutBordersAndWhatTheFitDoesNotCallMeasured) {
  // A border shows in sigma or in gamma; each alone must be seen.
  for (const bool inSigma : {true, false}) {
    TruthMaps truth = uniformTruth(kSize);
    for (int j = 0; j < kSize; ++j) {
      for (int i = kSize / 2; i < kSize; ++i)
        (inSigma ? truth.sigma.at(i, j) : truth.kurtosis.at(i, j)) = 2.0f;
    }
    SvbrdfMaps maps = asFitted(truth);
    for (int j = 0; j < kSize; ++j) {
      // What is left out must not count: errors of the size of the value.
      for (int i = kSize / 2 - 2; i < kSize / 2 + 2; ++i) maps.sigma.at(i, j) = 1.0f;
      maps.sigma.at(0, j) = 1.0f;
      maps.status.at(0, j) = static_cast<float>(TexelStatus::MirrorOffScreen);
    }
    const TruthErrors errors = compareWithTruth(maps, truth);
    EXPECT_EQ(errors.notMeasured, static_cast<std::size_t>(kSize));
    EXPECT_EQ(errors.onEdge, static_cast<std::size_t>(4 * kSize));
    EXPECT_EQ(errors.compared, static_cast<std::size_t>((kSize - 5) * kSize));
    EXPECT_EQ(errors.sigma.p95, 0);
  }
}

TEST(TruthCompare, KeepsASmoothChangeInsideAMaterial) {
  TruthMaps truth = uniformTruth(kSize);
  for (int j = 0; j < kSize; ++j) {
    for (int i = 0; i < kSize; ++i) truth.sigma.at(i, j) = 0.1f + 0.003f * static_cast<float>(i);
  }
  EXPECT_EQ(compareWithTruth(asFitted(truth), truth).onEdge, 0u);
}

TEST(TruthCompare, LooksUpTheSamePlaceAtAnotherResolution) {
  // A ramp: a texel's value is its position, so a shift of half a texel would show.
  TruthMaps truth = uniformTruth(2 * kSize);
  for (int j = 0; j < 2 * kSize; ++j) {
    for (int i = 0; i < 2 * kSize; ++i) truth.kurtosis.at(i, j) = 1.0f + (i + 0.5f) / (2 * kSize);
  }
  SvbrdfMaps maps = asFitted(uniformTruth(kSize));
  for (int j = 0; j < kSize; ++j) {
    for (int i = 0; i < kSize; ++i) maps.kurtosis.at(i, j) = 1.0f + (i + 0.5f) / kSize;
  }
  EXPECT_NEAR(compareWithTruth(maps, truth).kurtosis.p95, 0, kFloatDigits);
}

TEST(Percentile, InterpolatesBetweenRanks) {
  EXPECT_EQ(percentile({}, 0.5), 0);
  EXPECT_EQ(percentile({3, 1, 2}, 0.5), 2);
  EXPECT_EQ(percentile({0, 10}, 0.95), 9.5);
}

TEST(ReadTruth, ReadsATestBundle) {
  PATINA_NEEDS_SHARED("fourier/clean_laminate/truth");
  const Result<TruthMaps> truth = readTruth(sharedData() / "fourier/clean_laminate");
  ASSERT_TRUE(truth.ok()) << truth.error().sentence();
  EXPECT_EQ(truth->normal.channels(), 3);
  // The two materials that its truth.json names.
  EXPECT_NEAR(truth->sigma.at(0, 0), truth->sigma.at(0, 0) > 0.07f ? 0.085 : 0.05, 0.01);
  EXPECT_GT(truth->normal.at(10, 10, 2), 0.9f);
}

}  // namespace
}  // namespace patina::test
