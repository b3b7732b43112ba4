#include "devices/simulated/two_shot_scenes.h"

#include <gtest/gtest.h>

#include "engine/capture/two_shot_capture.h"
#include "tests/base/temp_folder.h"

namespace patina {
namespace {

TEST(TwoShotScenes, EachIsUsableAndHasShotsToFitAndToHoldOut) {
  ASSERT_GE(twoShotSceneNames().size(), 3u);
  for (const std::string& name : twoShotSceneNames()) {
    EXPECT_FALSE(twoShotSceneSummary(name).empty()) << name;
    const auto scene = twoShotScene(name);
    ASSERT_TRUE(scene.ok()) << scene.error().sentence();
    EXPECT_TRUE(scene->validate().empty()) << name << ": " << scene->validate().front();
    int fitted = 0, held = 0;
    for (const TwoShotPose& pose : scene->poses) {
      ++(pose.holdout ? held : fitted);
      EXPECT_GT(pose.directions.toLight.z(), 0.1) << name << ": a light at the horizon";
      EXPECT_GT(pose.directions.toCamera.z(), 0.1) << name << ": a camera at the horizon";
    }
    EXPECT_EQ(fitted, 3) << name;
    EXPECT_EQ(held, 2) << name;
  }
}

TEST(TwoShotScenes, TheSheetIsPhotographedByOneCameraAndReadsBack) {
  auto scene = twoShotScene("two-paints");
  ASSERT_TRUE(scene.ok());
  scene->pixels = 24;
  scene->samplesPerPixelSide = 1;
  const test::TempFolder folder;
  const auto report = simulateTwoShot(*scene, folder.path() / "sheet", {});
  ASSERT_TRUE(report.ok()) << report.error().sentence();
  const auto capture = readTwoShotCapture(folder.path() / "sheet");
  ASSERT_TRUE(capture.ok()) << capture.error().sentence();
  EXPECT_FALSE(capture->disc);
  for (const TwoShotPhoto& shot : capture->shots)
    EXPECT_LT((shot.camera.positionMm() - capture->shots[0].camera.positionMm()).norm(), 1e-6);
}

TEST(TwoShotScenes, AnUnknownNameIsRefusedWithThoseThereAre) {
  const auto scene = twoShotScene("velvet");
  ASSERT_FALSE(scene.ok());
  EXPECT_NE(scene.error().tryThis.find("bronze-disc"), std::string::npos);
}

}  // namespace
}  // namespace patina
