#include "engine/fourier/emission_calibration.h"

#include <gtest/gtest.h>

#include <cmath>

#include "devices/simulated/simulated_rig.h"
#include "tests/base/temp_folder.h"
#include "tests/test_data.h"

namespace patina {
namespace {

// The stated bound of the white paper's calibration: of gain and widths; the mean likewise, in units of the
// width.
constexpr double kStatedBound = 0.01;

TEST(EmissionCalibration, IsFoundFromWhitePaper) {
  SimulatedRig rig = SimulatedRig::desk(80, 120, 120);
  rig.screen.emission = ScreenEmission{{0.0, 0.22}, {1.7, 1.35}, 1.08};
  SimulatedSheet paper;
  paper.materials[0].diffuse = {0.92, 0.91, 0.88};
  paper.materials[0].specular.setZero();
  paper.slopeRms = 0, paper.albedoVariation = 0, paper.sigmaVariation = 0;
  SimulatedCaptureOptions options;
  options.fitted = {{1, 0}, {0, 1}, {2, 0}, {0, 2}, {1, 1}, {1, -1}, {3, 0}, {0, 3}, {20, 20}, {40, 0}};
  options.heldOut = {};
  options.samplesPerPixelSide = 1;
  const test::TempFolder folder;
  JobContext job;
  job.seed = 3;
  const auto simulated = simulateCapture(folder / "paper", rig, paper, options, job);
  ASSERT_TRUE(simulated.ok()) << simulated.error().sentence();
  Result<FourierCapture> capture = readFourierCapture(folder / "paper");
  ASSERT_TRUE(capture.ok()) << capture.error().sentence();
  capture->screen.emission.reset();

  EmissionOptions known;
  known.albedo = {0.92, 0.91, 0.88};
  const Result<EmissionCalibration> found = calibrateEmission(*capture, known);
  ASSERT_TRUE(found.ok()) << found.error().sentence();
  EXPECT_TRUE(found->converged);
  EXPECT_NEAR(found->emission.gain, 1.08, 1.08 * kStatedBound);
  EXPECT_NEAR(found->emission.sigma.x(), 1.7, 1.7 * kStatedBound);
  EXPECT_NEAR(found->emission.sigma.y(), 1.35, 1.35 * kStatedBound);
  EXPECT_NEAR(found->emission.mean.y(), 0.22, 1.35 * kStatedBound);
  EXPECT_EQ(found->emission.mean.x(), 0);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(found->channelGain[c], 1, kStatedBound);
  EXPECT_TRUE(found->warnings.empty()) << found->warnings.front();
  EXPECT_LT(found->residual, 3 * found->noise + 2e-3);

  // Albedo and gain can't be told apart: what is taken for the paper sets the scale.
  EmissionOptions one;
  one.albedo.setOnes();
  const Result<EmissionCalibration> unit = calibrateEmission(*capture, one);
  ASSERT_TRUE(unit.ok());
  EXPECT_NEAR(unit->emission.gain, 1.08 * 0.9033, 1.08 * kStatedBound);
  EXPECT_NEAR(unit->emission.sigma.x(), found->emission.sigma.x(), 2e-3);
}

TEST(EmissionCalibration, ReadsABundleOfAnotherMaker) {
  PATINA_NEEDS_SHARED("fourier/unknown_8_paper/capture.json");
  const Result<FourierCapture> capture = readFourierCapture(test::sharedData() / "fourier/unknown_8_paper");
  ASSERT_TRUE(capture.ok());
  const Result<EmissionCalibration> found = calibrateEmission(*capture);
  ASSERT_TRUE(found.ok()) << found.error().sentence();
  EXPECT_TRUE(found->converged);
  EXPECT_EQ(found->albedo, capture->known->albedo);
  EXPECT_LT(found->residual, 0.02);
}

}  // namespace
}  // namespace patina
