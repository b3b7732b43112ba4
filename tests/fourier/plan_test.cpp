// Which sets of photographs are refused, and with which words.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "engine/fourier/measurements.h"

namespace patina::test {
namespace {

FourierCapture captureWith(const std::vector<Eigen::Vector2i>& frequencies) {
  FourierCapture capture;
  capture.folder = "bundle";
  capture.photos.push_back({.file = "window.exr", .role = PhotoRole::Window, .encoding = ""});
  capture.photos.push_back({.file = "black.exr", .role = PhotoRole::Black, .encoding = ""});
  for (const auto& w : frequencies)
    for (int k = 0; k < 4; ++k)
      capture.photos.push_back(
          {.file = "p.exr", .role = PhotoRole::Pattern, .frequency = w, .phase = k, .encoding = ""});
  return capture;
}

TEST(MeasurementPlan, SortsPhotographsByFrequencyAndPhase) {
  auto capture = captureWith({{1, 0}, {0, 1}, {2, 2}, {2, -2}, {5, 0}});
  for (auto& photo : capture.photos) photo.holdout = photo.frequency == Eigen::Vector2i(5, 0);
  const auto plan = planMeasurements(capture, {});
  ASSERT_TRUE(plan.ok());
  EXPECT_EQ(plan->window, 0);
  EXPECT_EQ(plan->black, 1);
  ASSERT_EQ(plan->fitted.size(), 4u);
  EXPECT_EQ(plan->fitted[2].photo[3], 2 + 2 * 4 + 3);
  ASSERT_EQ(plan->heldOut.size(), 1u);
  EXPECT_EQ(plan->heldOut[0].frequency, Eigen::Vector2i(5, 0));
}

TEST(MeasurementPlan, RefusesTooFewFrequencies) {
  const auto plan = planMeasurements(captureWith({{1, 0}, {0, 1}, {2, 0}}), {});
  ASSERT_FALSE(plan.ok());
  EXPECT_EQ(plan.error().code, ErrorCode::Invalid);
  EXPECT_THAT(plan.error().what, testing::HasSubstr("can't determine the model: only 3"));
  EXPECT_FALSE(plan.error().tryThis.empty());
}

TEST(MeasurementPlan, RefusesFrequenciesAlongOneLine) {
  const auto plan = planMeasurements(captureWith({{1, 1}, {2, 2}, {3, 3}, {-4, -4}, {6, 6}}), {});
  ASSERT_FALSE(plan.ok());
  EXPECT_THAT(plan.error().what, testing::HasSubstr("along one line"));
}

TEST(MeasurementPlan, APatternOfFrequencyZeroIsLeftOut) {
  const auto plan = planMeasurements(captureWith({{0, 0}, {1, 0}, {0, 1}, {2, 2}, {2, -2}}), {});
  ASSERT_TRUE(plan.ok()) << plan.error().sentence();
  EXPECT_EQ(plan->fitted.size(), 4u);
}

TEST(MeasurementPlan, RefusesAHeldOutWindow) {
  auto capture = captureWith({{1, 0}, {0, 1}, {2, 2}, {2, -2}});
  capture.photos[0].holdout = true;
  const auto plan = planMeasurements(capture, {});
  ASSERT_FALSE(plan.ok());
  EXPECT_THAT(plan.error().what, testing::HasSubstr("'window'"));
}

TEST(MeasurementPlan, LeavesOutIncompleteFrequencies) {
  auto capture = captureWith({{1, 0}, {0, 1}, {2, 2}, {2, -2}, {3, 0}});
  capture.photos.pop_back();
  const auto plan = planMeasurements(capture, {});
  ASSERT_TRUE(plan.ok());
  EXPECT_EQ(plan->fitted.size(), 4u);
}

TEST(Sites, RefusesACameraThatLooksElsewhere) {
  auto capture = captureWith({{1, 0}, {0, 1}, {2, 2}, {2, -2}});
  capture.sampleWidthMm = capture.sampleHeightMm = 100;
  capture.camera.width = capture.camera.height = 32;
  capture.camera.intrinsics << 40, 0, 15.5, 0, 40, 15.5, 0, 0, 1;
  capture.camera.translationMm = {0, 0,
                                  400};     // looks along +z from below the sample: sees it from behind ...
  capture.camera.translationMm.x() = 5000;  // ... and five metres aside
  const auto sites = makeSites(capture, 0);
  ASSERT_FALSE(sites.ok());
  EXPECT_THAT(sites.error().what, testing::HasSubstr("doesn't see the sample"));
}

TEST(Sites, CoarseMapsGroupPixelsAndLoseNone) {
  auto capture = captureWith({{1, 0}, {0, 1}, {2, 2}, {2, -2}});
  capture.sampleWidthMm = capture.sampleHeightMm = 100;
  capture.camera.width = capture.camera.height = 64;
  capture.camera.intrinsics << 200, 0, 31.5, 0, 200, 31.5, 0, 0, 1;
  capture.camera.cameraFromWorld << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  capture.camera.translationMm = {0, 0, 400};
  const auto fine = makeSites(capture, 0), coarse = makeSites(capture, 10);
  ASSERT_TRUE(fine.ok() && coarse.ok());
  EXPECT_EQ(resolvedSize(capture, *fine), 50);  // 100 mm at 400 mm / 200 px = 2 mm a pixel
  EXPECT_EQ(coarse->size(), 100u);
  int pixels = 0;
  for (const auto count : coarse->pixelCount) pixels += count;
  EXPECT_EQ(pixels, static_cast<int>(fine->size()));
}

}  // namespace
}  // namespace patina::test
