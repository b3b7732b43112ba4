#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "engine/capture/flash_capture.h"
#include "engine/capture/two_shot_capture.h"
#include "engine/image/exr.h"
#include "engine/image/png.h"
#include "tests/base/temp_folder.h"
#include "tests/test_data.h"

namespace patina {
namespace {

using nlohmann::json;
using testing::HasSubstr;

json photoJson(const std::string& file) {
  return {{"file", file},
          {"encoding", "srgb"},
          {"rectified", true},
          {"camera_position_mm", {10, 2, 160}},
          {"light", {{"type", "point"}, {"position_mm", {12, 2, 160}}, {"intensity", {15e4, 14e4, 13e4}}}}};
}

json cameraJson() {
  return {{"width", 8},
          {"height", 8},
          {"K", {{20, 0, 3.5}, {0, 20, 3.5}, {0, 0, 1}}},
          {"distortion", {0, 0, 0, 0, 0}},
          {"R", {{1, 0, 0}, {0, -1, 0}, {0, 0, -1}}},
          {"t", {0, 0, 300}}};
}

json bundleJson() {
  return {{"format", "patina-capture"},
          {"version", 1},
          {"kind", "flash"},
          {"sample", {{"width_mm", 60}, {"height_mm", 40}}},
          {"photos", {photoJson("a.png"), photoJson("b.png")}}};
}

Result<FlashCapture> parse(const json& bundle) {
  return parseFlashCapture(bundle.dump(), "folder", "capture.json");
}

TEST(FlashCapture, SharedBundlesAreReadAndWrittenBack) {
  PATINA_NEEDS_SHARED("flash");
  int read = 0;
  for (const auto& entry : std::filesystem::directory_iterator(test::sharedData() / "flash")) {
    const auto kind = captureKind(entry.path());
    ASSERT_TRUE(kind.ok()) << kind.error().sentence();
    EXPECT_EQ(*kind, "flash");
    const auto capture = readFlashCapture(entry.path());
    ASSERT_TRUE(capture.ok()) << capture.error().sentence();
    EXPECT_TRUE(capture->ignoredKeys.empty());
    const std::string text = flashCaptureJson(*capture);
    const auto again = parseFlashCapture(text, capture->folder, "again");
    ASSERT_TRUE(again.ok()) << again.error().sentence();
    EXPECT_EQ(flashCaptureJson(*again), text);
    const auto pixels = readFlashPixels(*capture, capture->photos[0]);
    ASSERT_TRUE(pixels.ok()) << pixels.error().sentence();
    EXPECT_EQ(pixels->valueOfCode[0].size(), 256u) << "the photographs are of 8 bits";
    ++read;
  }
  EXPECT_GE(read, 1);
}

TEST(FlashCapture, WhatItSaysArrives) {
  json bundle = bundleJson();
  bundle["photos"][1]["split"] = "holdout";
  bundle["photos"][1]["rectified"] = false;
  bundle["photos"][1]["camera"] = cameraJson();
  bundle["photos"][1].erase("camera_position_mm");
  bundle["photos"][1]["flavour"] = "sweet";
  bundle["saturation"] = 0.9;
  bundle["sample"]["name"] = "card";
  const auto capture = parse(bundle);
  ASSERT_TRUE(capture.ok()) << capture.error().sentence();
  EXPECT_EQ(capture->widthMm, 60);
  EXPECT_EQ(capture->sampleName, "card");
  EXPECT_EQ(capture->saturation, 0.9);
  ASSERT_EQ(capture->photos.size(), 2u);
  EXPECT_TRUE(capture->photos[0].rectified);
  EXPECT_FALSE(capture->photos[0].holdout);
  EXPECT_EQ(capture->photos[0].lightPositionMm, Eigen::Vector3d(12, 2, 160));
  EXPECT_EQ(capture->photos[0].lightIntensity, Eigen::Vector3d(15e4, 14e4, 13e4));
  EXPECT_TRUE(capture->photos[1].holdout);
  EXPECT_NEAR((capture->photos[1].cameraPositionMm - Eigen::Vector3d(0, 0, 300)).norm(), 0, 1e-9)
      << "the camera's own position, where no other is given";
  EXPECT_EQ(capture->ignoredKeys, std::vector<std::string>{"photos[].flavour"});
}

struct Broken {
  std::string name;
  std::function<void(json&)> breakIt;
  ErrorCode code;
  std::string where;
  std::string words;
};

void PrintTo(const Broken& broken, std::ostream* out) {
  *out << broken.name;
}

const Broken kBroken[] = {
    {"Fourier", [](json& b) { b["kind"] = "fourier"; }, ErrorCode::Unsupported, "kind", "fourier"},
    {"StrangeKind", [](json& b) { b["kind"] = "x-ray"; }, ErrorCode::Unsupported, "kind", "x-ray"},
    {"NoWidth", [](json& b) { b["sample"].erase("width_mm"); }, ErrorCode::Malformed, "sample.width_mm",
     "missing"},
    {"NoPhotos", [](json& b) { b["photos"] = json::array(); }, ErrorCode::Malformed, "photos", ""},
    {"AllHeldOut",
     [](json& b) {
       for (json& photo : b["photos"]) photo["split"] = "holdout";
     },
     ErrorCode::Invalid, "photos", "held out"},
    {"CameraBelow",
     [](json& b) {
       b["photos"][0]["camera_position_mm"] = {0, 0, -10};
     },
     ErrorCode::Invalid, "photos[0].camera_position_mm", "in front of the sample"},
    {"LightBelow",
     [](json& b) {
       b["photos"][1]["light"]["position_mm"] = {0, 0, 0};
     },
     ErrorCode::Invalid, "photos[1].light.position_mm", "in front of the sample"},
    {"LightDirectional", [](json& b) { b["photos"][0]["light"]["type"] = "directional"; },
     ErrorCode::Unsupported, "photos[0].light.type", "directional"},
    {"NoIntensity", [](json& b) { b["photos"][0]["light"].erase("intensity"); }, ErrorCode::Malformed,
     "photos[0].light.intensity", "missing"},
    {"Dark",
     [](json& b) {
       b["photos"][0]["light"]["intensity"] = {1, 0, 1};
     },
     ErrorCode::Invalid, "photos[0].light.intensity", ""},
    {"NoCamera", [](json& b) { b["photos"][0]["rectified"] = false; }, ErrorCode::Malformed,
     "photos[0].camera", "rectified"},
    {"RectifiedIsANumber", [](json& b) { b["photos"][0]["rectified"] = 1; }, ErrorCode::Malformed,
     "photos[0].rectified", "neither"},
    {"Leaves", [](json& b) { b["photos"][0]["file"] = "../a.png"; }, ErrorCode::Refused, "photos[0].file",
     ""},
    {"NoEncoding", [](json& b) { b["photos"][0].erase("encoding"); }, ErrorCode::Malformed,
     "photos[0].encoding", "encoding"},
    {"Split", [](json& b) { b["photos"][0]["split"] = "later"; }, ErrorCode::Malformed, "photos[0].split",
     "later"},
};

class BrokenFlashCapture : public testing::TestWithParam<Broken> {};

TEST_P(BrokenFlashCapture, IsRefusedByName) {
  json bundle = bundleJson();
  GetParam().breakIt(bundle);
  const auto capture = parse(bundle);
  ASSERT_FALSE(capture.ok());
  EXPECT_EQ(capture.error().code, GetParam().code);
  EXPECT_THAT(capture.error().where, HasSubstr("capture.json: " + GetParam().where));
  EXPECT_THAT(capture.error().what, HasSubstr(GetParam().words));
}

INSTANTIATE_TEST_SUITE_P(, BrokenFlashCapture, testing::ValuesIn(kBroken),
                         [](const auto& info) { return info.param.name; });

TEST(FlashCapture, FilesAreLookedFor) {
  test::TempFolder folder;
  json bundle = bundleJson();
  test::writeText(folder / "capture.json", bundle.dump());
  Image grey(4, 3, 3, 0.5f);
  ASSERT_TRUE(writePng(folder / "a.png", grey).ok());
  const auto missing = readFlashCapture(folder.path());
  ASSERT_FALSE(missing.ok());
  EXPECT_EQ(missing.error().code, ErrorCode::NotFound);
  EXPECT_THAT(missing.error().sentence(), HasSubstr("b.png"));
  bundle["photos"][1]["file"] = "a.png";
  test::writeText(folder / "capture.json", bundle.dump());
  const auto twice = readFlashCapture(folder.path());
  ASSERT_FALSE(twice.ok());
  EXPECT_THAT(twice.error().sentence(), HasSubstr("two photographs"));
}

TEST(FlashCapture, PixelsSayHowFineTheyAre) {
  test::TempFolder folder;
  FlashCapture capture;
  capture.folder = folder.path();
  FlashPhoto png, exr;
  png.file = "a.png", png.encoding = "gamma:2";
  exr.file = "b.exr";
  ASSERT_TRUE(writePng(folder / "a.png", Image(4, 3, 3, 0.2f)).ok());
  ASSERT_TRUE(writeExr(folder / "b.exr", Image(4, 3, 3, 0.3f), {"R", "G", "B"}).ok());
  const auto coarse = readFlashPixels(capture, png);
  ASSERT_TRUE(coarse.ok()) << coarse.error().sentence();
  EXPECT_NEAR(coarse->linear.at(1, 1, 1), 0.04, 1e-3);
  ASSERT_EQ(coarse->valueOfCode[2].size(), 256u);
  EXPECT_NEAR(coarse->valueOfCode[2][51], 0.04, 1e-6);
  EXPECT_EQ(coarse->largest[0], 1.0f);
  const auto fine = readFlashPixels(capture, exr);
  ASSERT_TRUE(fine.ok()) << fine.error().sentence();
  EXPECT_TRUE(fine->valueOfCode[0].empty());
  EXPECT_EQ(fine->largest[0], 0.0f);
  const auto wrong = readFlashPixels(capture, png, ImageSize{5, 3});
  ASSERT_FALSE(wrong.ok());
  EXPECT_THAT(wrong.error().where, HasSubstr("a.png"));
}

}  // namespace
}  // namespace patina
