#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "engine/capture/two_shot_capture.h"
#include "engine/image/exr.h"
#include "tests/base/temp_folder.h"
#include "tests/test_data.h"

namespace patina {
namespace {

using nlohmann::json;
using testing::HasSubstr;

json cameraJson() {
  return {{"width", 8},
          {"height", 8},
          {"K", {{20, 0, 3.5}, {0, 20, 3.5}, {0, 0, 1}}},
          {"distortion", {0, 0, 0, 0, 0}},
          {"R", {{1, 0, 0}, {0, -1, 0}, {0, 0, -1}}},
          {"t", {0, 0, 300}}};
}

json shotJson(const std::string& file) {
  return {{"file", file},
          {"camera", cameraJson()},
          {"light", {{"type", "directional"}, {"direction", {0.6, 0, 0.8}}}},
          {"exposure_s", 0.5}};
}

json bundleJson() {
  return {{"format", "patina-capture"},
          {"version", 1},
          {"kind", "two-shot"},
          {"sample", {{"shape", "disc"}, {"radius_mm", 40}}},
          {"shots", {shotJson("a.exr")}},
          {"white_reference", {{"reflectance", {0.99, 0.98, 0.97}}, {"shots", {shotJson("w.exr")}}}}};
}

Result<TwoShotCapture> parse(const json& bundle) {
  return parseTwoShotCapture(bundle.dump(), "folder", "capture.json");
}

TEST(TwoShotCapture, SharedBundlesAreReadAndWrittenBack) {
  PATINA_NEEDS_SHARED("two-shot");
  int read = 0;
  for (const auto& entry : std::filesystem::directory_iterator(test::sharedData() / "two-shot")) {
    const auto kind = captureKind(entry.path());
    ASSERT_TRUE(kind.ok()) << kind.error().sentence();
    EXPECT_EQ(*kind, "two-shot");
    const auto capture = readTwoShotCapture(entry.path());
    ASSERT_TRUE(capture.ok()) << capture.error().sentence();
    const std::string text = twoShotCaptureJson(*capture);
    const auto again = parseTwoShotCapture(text, capture->folder, "again");
    ASSERT_TRUE(again.ok()) << again.error().sentence();
    EXPECT_EQ(twoShotCaptureJson(*again), text);
    EXPECT_EQ(again->shots.size(), capture->shots.size());
    ++read;
  }
  EXPECT_GT(read, 5);
}

TEST(TwoShotCapture, WhatItSaysArrives) {
  json bundle = bundleJson();
  bundle["shots"].push_back(shotJson("b.exr"));
  bundle["shots"][1]["split"] = "holdout";
  bundle["shots"][1]["light"]["normal_irradiance"] = {1, 2, 3};
  bundle["saturation"] = 0.9;
  bundle["sample"] = {{"shape", "rectangle"}, {"width_mm", 60}, {"height_mm", 20}, {"name", "card"}};
  bundle["colour"] = "blue";
  const auto capture = parse(bundle);
  ASSERT_TRUE(capture.ok()) << capture.error().sentence();
  EXPECT_TRUE(capture->shots[1].holdout);
  EXPECT_EQ(*capture->shots[1].normalIrradiance, Eigen::Vector3d(1, 2, 3));
  EXPECT_FALSE(capture->shots[0].normalIrradiance.has_value());
  EXPECT_EQ(capture->saturation, 0.9);
  EXPECT_EQ(capture->whiteReflectance.y(), 0.98);
  EXPECT_EQ(capture->sampleName, "card");
  EXPECT_TRUE(capture->onSample(29, -9));
  EXPECT_FALSE(capture->onSample(29, 11));
  EXPECT_EQ(capture->ignoredKeys, std::vector<std::string>{"colour"});
}

TEST(TwoShotCapture, NeedsNoWhiteWhereIrradianceIsKnown) {
  json bundle = bundleJson();
  bundle.erase("white_reference");
  EXPECT_FALSE(parse(bundle).ok());
  bundle["shots"][0]["light"]["normal_irradiance"] = {1, 1, 1};
  EXPECT_TRUE(parse(bundle).ok());
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
    {"Version", [](json& b) { b["version"] = 2; }, ErrorCode::Unsupported, "version", "version 2"},
    {"Shape", [](json& b) { b["sample"]["shape"] = "star"; }, ErrorCode::Unsupported, "sample.shape", "star"},
    {"NoRadius", [](json& b) { b["sample"].erase("radius_mm"); }, ErrorCode::Malformed, "sample.radius_mm",
     "missing"},
    {"NoShots", [](json& b) { b["shots"] = json::array(); }, ErrorCode::Malformed, "shots", ""},
    {"AllHeldOut", [](json& b) { b["shots"][0]["split"] = "holdout"; }, ErrorCode::Invalid, "shots",
     "held out"},
    {"Split", [](json& b) { b["shots"][0]["split"] = "later"; }, ErrorCode::Malformed, "shots[0].split",
     "later"},
    {"LightBelow",
     [](json& b) {
       b["shots"][0]["light"]["direction"] = {0.6, 0, -0.8};
     },
     ErrorCode::Invalid, "shots[0].light.direction", "in front of the sample"},
    {"LightNotUnit",
     [](json& b) {
       b["shots"][0]["light"]["direction"] = {0.6, 0, 0.9};
     },
     ErrorCode::Invalid, "shots[0].light.direction", "length 1"},
    {"LightPoint", [](json& b) { b["shots"][0]["light"]["type"] = "point"; }, ErrorCode::Unsupported,
     "shots[0].light.type", "point"},
    {"OtherLight",
     [](json& b) {
       b["white_reference"]["shots"][0]["light"]["direction"] = {0.5976, 0, 0.8018};
     },
     ErrorCode::Invalid, "shots[0].light", "white reference"},
    {"Exposure", [](json& b) { b["shots"][0]["exposure_s"] = 0; }, ErrorCode::Invalid, "shots[0].exposure_s",
     ""},
    {"CameraBelow",
     [](json& b) {
       b["shots"][0]["camera"]["t"] = {0, 0, -300};
     },
     ErrorCode::Invalid, "shots[0].camera.t", "in front of the sample"},
    {"Leaves", [](json& b) { b["shots"][0]["file"] = "../a.exr"; }, ErrorCode::Refused, "shots[0].file", ""},
    {"PngWithoutEncoding", [](json& b) { b["shots"][0]["file"] = "a.png"; }, ErrorCode::Malformed,
     "shots[0].encoding", "encoding"},
    {"Reflectance",
     [](json& b) {
       b["white_reference"]["reflectance"] = {0, 1, 1};
     },
     ErrorCode::Invalid, "white_reference.reflectance", ""},
    {"Saturation", [](json& b) { b["saturation"] = -1; }, ErrorCode::Invalid, "saturation", ""},
};

class BrokenTwoShot : public testing::TestWithParam<Broken> {};

TEST_P(BrokenTwoShot, IsRefusedWithKeyAndReason) {
  json bundle = bundleJson();
  ASSERT_TRUE(parse(bundle).ok());
  GetParam().breakIt(bundle);
  const auto capture = parse(bundle);
  ASSERT_FALSE(capture.ok());
  EXPECT_EQ(static_cast<int>(capture.error().code), static_cast<int>(GetParam().code));
  EXPECT_THAT(capture.error().where, HasSubstr(GetParam().where));
  EXPECT_THAT(capture.error().sentence(), HasSubstr(GetParam().words));
}

INSTANTIATE_TEST_SUITE_P(Every, BrokenTwoShot, testing::ValuesIn(kBroken),
                         [](const auto& info) { return info.param.name; });

TEST(TwoShotCapture, MissingFilesAndPixelsThatAreNotNumbersAreNamed) {
  test::TempFolder folder;
  test::writeText(folder / "capture.json", bundleJson().dump());
  auto capture = readTwoShotCapture(folder.path());
  ASSERT_FALSE(capture.ok());
  EXPECT_EQ(static_cast<int>(capture.error().code), static_cast<int>(ErrorCode::NotFound));
  Image image(8, 8, 3, 0.5f);
  ASSERT_TRUE(writeExr(folder / "w.exr", image, {"R", "G", "B"}).ok());
  image.at(2, 3, 1) = NAN;
  ASSERT_TRUE(writeExr(folder / "a.exr", image, {"R", "G", "B"}).ok());
  capture = readTwoShotCapture(folder.path());
  ASSERT_TRUE(capture.ok()) << capture.error().sentence();
  const auto photo = readPhoto(*capture, capture->shots[0]);
  ASSERT_FALSE(photo.ok());
  EXPECT_THAT(photo.error().sentence(), HasSubstr("(2, 3)"));
  EXPECT_TRUE(readPhoto(*capture, capture->whiteShots[0]).ok());
}

}  // namespace
}  // namespace patina
