#include "engine/calibration/calibration_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/base/temp_folder.h"

namespace patina {
namespace {

using namespace std::chrono;
using testing::HasSubstr;

Camera someCamera(bool posed) {
  Camera camera;
  camera.width = 1280, camera.height = 960;
  camera.intrinsics << 1501.25, 0, 645, 0, 1502, 474, 0, 0, 1;
  camera.distortion << -0.09, 0.03, 0.0003, -0.0004, 0.001;
  if (posed) {
    camera.cameraFromWorld = Eigen::Vector3d(1, -1, -1).asDiagonal();
    camera.translationMm = {3, -4, 500};
  }
  return camera;
}

CalibrationRecord recordOf(StoredCalibration content) {
  CalibrationRecord record;
  record.content = std::move(content);
  record.device = "Integrated Camera (usb-0000:00:14.0-8)";
  record.taken = sys_days(2026y / May / 17) + 9h + 30min + 12s;
  record.residual = 0.1875;
  record.residualUnit = "px";
  record.madeBy = "patina 0.1.0";
  record.remarks = {"a remark"};
  return record;
}

std::vector<CalibrationRecord> oneOfEach() {
  StoredCamera camera{someCamera(false), IntrinsicVector::Constant(0.5), Board::forCamera(), 13};
  StoredScreenPose pose;
  pose.camera = someCamera(true);
  pose.screen.widthMm = 344, pose.screen.heightMm = 194, pose.screen.widthPx = 1920,
  pose.screen.heightPx = 1080;
  pose.screen.worldFromScreen = Eigen::Vector3d(-1, 1, -1).asDiagonal();
  pose.screen.originMm = {1, 2, 300};
  pose.onSample.board = Board::forSamplePlane();
  pose.onSample.centreMm = {0, -48}, pose.onSample.turnDeg = 8;
  pose.onScreen.board = Board::forScreen(344, 194);
  pose.mirrorHeightMm = 3, pose.screenAngleSdDeg = 0.02, pose.screenPositionSdMm = 0.1;
  StoredEmission emission;
  emission.emission = {{0, 0.2}, {1.8, 1.4}, 1.05};
  StoredWhiteTile tile;
  tile.irradiance = {2.7, 2.4, 1.9};
  tile.region = {10, 20, 300, 200};
  tile.mapFile = "tile.exr";
  StoredResponse response;
  for (ResponseCurve& curve : response.curves) curve = {{0, 0.25, 0.5, 1}, {0, 0.05, 0.21, 1}};
  response.dark = DarkLevel{};
  response.dark->level = {0.03, 0.031, 0.029};
  StoredScreenResponse screen;
  screen.response.value = {0, 0.5, 1}, screen.response.light = {0, 0.2, 1};
  return {recordOf(camera), recordOf(pose),     recordOf(emission),
          recordOf(tile),   recordOf(response), recordOf(screen)};
}

TEST(CalibrationFile, EveryKindComesBackAsItWas) {
  const test::TempFolder folder;
  for (const CalibrationRecord& record : oneOfEach()) {
    const auto file = folder / (std::string(kindOf(record.content)) + ".json");
    ASSERT_TRUE(writeCalibration(file, record).ok());
    const Result<CalibrationRecord> back = readCalibration(file, kindOf(record.content));
    ASSERT_TRUE(back.ok()) << back.error().sentence();
    EXPECT_EQ(kindOf(back->content), kindOf(record.content));
    EXPECT_EQ(back->device, record.device);
    EXPECT_EQ(back->taken, record.taken);
    EXPECT_EQ(back->residual, record.residual);
    EXPECT_EQ(back->remarks, record.remarks);
    // Every number keeps all its digits: written again, the same text.
    EXPECT_EQ(calibrationJson(*back), calibrationJson(record));
  }
}

TEST(CalibrationFile, AResponseIsAlsoWhatABundleNames) {
  const CalibrationRecord record = oneOfEach()[4];
  const auto curves = parseResponse(calibrationJson(record), "curve.json");
  ASSERT_TRUE(curves.ok()) << curves.error().sentence();
  EXPECT_EQ((*curves)[1].output[2], 0.21);
  // And a bare response file, made by hand, is a calibration without a date.
  const Result<CalibrationRecord> bare = parseCalibration(
      responseJson(std::get<StoredResponse>(record.content).curves), "bare.json", "camera-response");
  ASSERT_TRUE(bare.ok()) << bare.error().sentence();
}

TEST(CalibrationFile, RefusesWithASentenceThatNamesTheKey) {
  const std::string good = calibrationJson(oneOfEach()[0]);
  const auto broken = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
    const Result<CalibrationRecord> read = parseCalibration(text, "camera.json");
    EXPECT_FALSE(read.ok()) << to;
    return read.ok() ? std::string() : read.error().sentence();
  };
  EXPECT_THAT(broken("patina-calibration", "patina-capture"), HasSubstr("not a calibration"));
  EXPECT_THAT(broken("\"version\": 1", "\"version\": 2"), HasSubstr("version"));
  EXPECT_THAT(broken("\"kind\": \"camera\"", "\"kind\": \"camra\""), HasSubstr("camera"));
  EXPECT_THAT(broken("2026-05-17T09:30:12Z", "2026-02-30T09:30:12Z"), HasSubstr("taken"));
  EXPECT_THAT(broken("1501.25", "-1501.25"), HasSubstr("camera.K"));
  EXPECT_THAT(broken("\"camera\": {", "\"kamera\": {"), HasSubstr("'camera'"));
  EXPECT_THAT(broken("charuco:", "chaos:"), HasSubstr("board"));
  EXPECT_FALSE(parseCalibration("", "x").ok());
  EXPECT_FALSE(parseCalibration("[]", "x").ok());
  const Result<CalibrationRecord> other = parseCalibration(good, "camera.json", "emission");
  ASSERT_FALSE(other.ok());
  EXPECT_THAT(other.error().what, HasSubstr("'emission' is needed"));
  EXPECT_FALSE(readCalibration("/nowhere/at/all.json").ok());
}

TEST(CalibrationFile, TellsItsAge) {
  const auto taken = sys_days(2026y / May / 17) + 9h;
  EXPECT_EQ(ageInWords(taken, taken + 30s), "just now");
  EXPECT_EQ(ageInWords(taken, taken + 45min), "45 minutes ago");
  EXPECT_EQ(ageInWords(taken, taken + 5h), "5 hours ago");
  EXPECT_EQ(ageInWords(taken, taken + 72h), "3 days ago");
  EXPECT_THAT(ageInWords(taken, taken - 1h), HasSubstr("clock"));
}

}  // namespace
}  // namespace patina
