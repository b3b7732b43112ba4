// Fits of bundles that an independent simulator made, against the bounds of the model's specification. The
// truth is read here, by the test.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "engine/fourier/fit_state.h"
#include "tests/fourier/clean_bounds.h"
#include "tests/results/truth_compare.h"
#include "tests/test_data.h"

namespace patina::test {
namespace {

std::shared_ptr<const FourierFit> fitBundle(const std::string& name, const FourierFitOptions& options = {}) {
  const auto capture = readFourierCapture(sharedData() / "fourier" / name);
  if (!capture) {
    ADD_FAILURE() << capture.error().sentence();
    return nullptr;
  }
  auto fit = fitFourier(*capture, options, {});
  if (!fit) {
    ADD_FAILURE() << fit.error().sentence();
    return nullptr;
  }
  return *fit;
}

class CleanBundle : public testing::TestWithParam<CleanBounds> {};

TEST_P(CleanBundle, IsWithinBounds) {
  PATINA_NEEDS_SHARED("fourier/" + std::string(GetParam().bundle));
  expectWithinBounds(GetParam());
}

INSTANTIATE_TEST_SUITE_P(Fourier, CleanBundle, testing::Values(kCleanLaminate, kCleanCardstock),
                         [](const auto& info) { return std::string(info.param.bundle); });

class MeasuredBundle : public testing::TestWithParam<const char*> {};

TEST_P(MeasuredBundle, FitsWithoutFailure) {
  PATINA_NEEDS_SHARED("fourier/" + std::string(GetParam()));
  const auto fit = fitBundle(GetParam());
  ASSERT_TRUE(fit);
  EXPECT_EQ(fit->stats().statusCounts.count("failed"), 0u);
  EXPECT_GT(fit->stats().holdoutRms, 0);
  for (const Image* map : {&fit->maps().diffuse, &fit->maps().specular, &fit->maps().normal,
                           &fit->maps().sigma, &fit->maps().kurtosis})
    for (const float value : map->samples()) ASSERT_TRUE(std::isfinite(value));
}

INSTANTIATE_TEST_SUITE_P(Fourier, MeasuredBundle,
                         testing::Values("measured_cardboard_ilm", "measured_satin_dragoneye"),
                         [](const auto& info) { return std::string(info.param); });

TEST(SensorNoise, IsEstimatedFromThePhotographs) {
  PATINA_NEEDS_SHARED("fourier/clean_cardstock");
  for (const char* name :
       {"clean_cardstock", "clean_laminate", "measured_satin_dragoneye", "unknown_8_paper"}) {
    const auto folder = sharedData() / "fourier" / name;
    const auto capture = readFourierCapture(folder);
    ASSERT_TRUE(capture.ok());
    auto plan = planMeasurements(*capture, {});
    auto sites = makeSites(*capture, 0);
    ASSERT_TRUE(plan.ok() && sites.ok());
    const auto measured = measure(*capture, std::move(*plan), std::move(*sites), {});
    ASSERT_TRUE(measured.ok());
    std::ifstream file(folder / "truth" / "truth.json");
    const auto truth = nlohmann::json::parse(file);
    const double full = truth["camera_full_scale"], shot = truth["noise"]["shot"],
                 read = truth["noise"]["read"];
    // what counts is the variance at the brightness of a typical photograph; 10,000 samples in 24 bins know
    // it to 2 %, five of that
    double brightness = 0;
    for (const float b : measured->brightness) brightness += b;
    brightness /= static_cast<double>(measured->brightness.size());
    const double expected = full * shot * brightness + read * read * full * full;
    EXPECT_NEAR(measured->noise.variance(brightness) / expected, 1, 0.1) << name;
  }
}

TEST(FourierFit, PaperMappingIsWorseOnGloss) {
  PATINA_NEEDS_SHARED("fourier/clean_laminate");
  FourierFitOptions paper;
  paper.lobe = LobeMapping::PaperAffine;
  const auto truth = readTruth(sharedData() / "fourier/clean_laminate");
  ASSERT_TRUE(truth.ok());
  const auto exact = fitBundle("clean_laminate"), affine = fitBundle("clean_laminate", paper);
  ASSERT_TRUE(exact && affine);
  EXPECT_LT(exact->stats().holdoutRms, affine->stats().holdoutRms);
  EXPECT_LT(compareWithTruth(exact->maps(), *truth).normalDeg.median,
            compareWithTruth(affine->maps(), *truth).normalDeg.median);
}

TEST(FourierFit, SpectrumOfATexelIsItsMeasurementAndItsModel) {
  PATINA_NEEDS_SHARED("fourier/clean_laminate");
  const auto fit = fitBundle("clean_laminate");
  ASSERT_TRUE(fit);
  const auto spectrum = fit->spectrumAt(fit->maps().width / 2, fit->maps().height / 2);
  ASSERT_EQ(spectrum.size(), 1u + 32 + 9);
  EXPECT_EQ(spectrum.front().frequency, Eigen::Vector2i::Zero());
  double chi2 = 0;
  int count = 0, heldOut = 0;
  for (const auto& sample : spectrum) {
    heldOut += sample.holdout;
    for (int c = 0; c < 3; ++c) {
      const auto gap = (sample.measured[c] - sample.diffuse[c] - sample.specular[c]) / sample.noiseSigma[c];
      chi2 += std::norm(gap);
      count += sample.frequency.isZero() ? 1 : 2;
    }
  }
  EXPECT_EQ(heldOut, 9);
  EXPECT_LT(chi2 / count, 2.0);  // one texel's scatter, some of it shared between channels
  EXPECT_GT(chi2 / count, 0.5);
  const auto lobe = fit->lobeAt(fit->maps().width / 2, fit->maps().height / 2, true, 201);
  ASSERT_EQ(lobe.model.size(), 201u);
  double energy = 0;
  for (const auto& value : lobe.model) energy += value[1] * 2 * std::numbers::pi / 200;
  // the profile across the screen integrates to the zero frequency
  EXPECT_NEAR(energy, std::abs(spectrum.front().diffuse[1] + spectrum.front().specular[1]), 0.02 * energy);
}

}  // namespace
}  // namespace patina::test
