#include "engine/acquire/rig_assembly.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "devices/simulated/live_rig.h"

namespace patina {
namespace {

constexpr double kExact = 1e-12;

/// Calibrations that say what a simulated rig truly is.
RigParts trueParts(const LiveRigSetup& setup) {
  RigParts parts;
  parts.pose.camera = setup.camera;
  parts.pose.screen = setup.screen;
  parts.pose.screen.emission.reset();
  parts.pose.onSample.board = *parseBoard("charuco:7x5:12:0.7:4x4_50:0", "");
  parts.pose.onScreen.board = *parseBoard("charuco:7x5:12:0.7:4x4_50:20", "");
  return parts;
}

TEST(RigAssembly, BringsTheEmissionToTheUnitOfHeadOnWhite) {
  RigParts parts = trueParts(LiveRig::desk("laminate", 16, 320));
  StoredEmission emission;
  emission.emission = ScreenEmission{{0.0, 0.4}, {1.6, 1.3}, 0.037};
  emission.radianceScale = 21.5;
  parts.emission = emission;
  const Result<RigDescription> rig = rigFromParts(parts, 90, 60, "sheet");
  ASSERT_TRUE(rig.ok()) << rig.error().sentence();
  ASSERT_TRUE(rig->screen.emission.has_value());
  const ScreenEmission& found = *rig->screen.emission;
  EXPECT_NEAR(found.gain * std::exp(-0.5 * std::pow(0.4 / 1.3, 2)), 1.0, kExact);
  EXPECT_EQ(found.sigma, emission.emission.sigma);
  EXPECT_EQ(rig->radianceOfFullScaleSecond, 21.5);
  EXPECT_EQ(rig->sampleWidthMm, 90);
}

TEST(RigAssembly, TakesTheMeasuredResponseAndGuessesOneWithout) {
  RigParts parts = trueParts(LiveRig::desk("laminate", 16, 320));
  const Result<RigDescription> guessed = rigFromParts(parts, 90, 60, "");
  ASSERT_TRUE(guessed.ok()) << guessed.error().sentence();
  EXPECT_EQ(guessed->screenResponse.level, ScreenResponse::gamma(2.2).level);
  StoredScreenResponse curve;
  for (int i = 0; i <= 20; ++i) {
    curve.response.value.push_back(i / 20.0);
    curve.response.light.push_back(std::pow(i / 20.0, 1.8));
  }
  parts.screen = curve;
  const Result<RigDescription> measured = rigFromParts(parts, 90, 60, "");
  ASSERT_TRUE(measured.ok()) << measured.error().sentence();
  constexpr double kBetweenKnots = 2e-3;  // twenty knots of a curve: what lies between them is interpolated
  EXPECT_NEAR(measured->screenResponse.level[128], std::pow(128 / 255.0, 1.8), kBetweenKnots);
  EXPECT_EQ(measured->screenResponse.level[255], 1.0);
}

TEST(RigAssembly, SaysWhatIsMissing) {
  const RigParts parts = trueParts(LiveRig::desk("laminate", 16, 320));
  const Result<RigDescription> rig = rigFromParts(parts, 0, 60, "");
  ASSERT_FALSE(rig.ok());
  EXPECT_THAT(rig.error().sentence(), testing::HasSubstr("sample's size"));
}

TEST(RigAssembly, ReadsWhatAFolderHolds) {
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "rig_assembly";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  EXPECT_FALSE(readRigParts(folder).ok());  // no screen pose
  const RigParts parts = trueParts(LiveRig::desk("laminate", 16, 320));
  CalibrationRecord record;
  record.content = parts.pose;
  record.residualUnit = "px";
  record.madeBy = "test";
  ASSERT_TRUE(writeCalibration(folder / "screen-pose.json", record).ok());
  const Result<RigParts> read = readRigParts(folder);
  ASSERT_TRUE(read.ok()) << read.error().sentence();
  EXPECT_FALSE(read->emission.has_value());
  EXPECT_EQ(read->remarks.size(), 2u);
  EXPECT_LT((read->pose.screen.originMm - parts.pose.screen.originMm).norm(), 1e-6);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace patina
