#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "engine/capture/encoding.h"
#include "engine/image/png.h"
#include "tests/capture/small_bundle.h"
#include "tests/image/png_samples.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using test::TempFolder;
using testing::HasSubstr;

constexpr float kRounding = 1e-6f;  // relative: a few float operations

/// A bundle with one 16-bit PNG, 2 x 1 pixels of grey 0x1234 and 0xFFFF, encoded as said.
FourierCapture pngBundle(const fs::path& folder, const std::string& encoding) {
  FourierCapture capture = test::smallCapture(folder, 0);
  capture.camera.width = 2;
  capture.camera.height = 1;
  capture.photos = {{"p.png", PhotoRole::Window, 1, {0, 0}, 0, false, encoding}};
  fs::create_directories(folder);
  test::writeText(folder / "p.png", std::string(test::asText(test::kGrey16Bytes)));
  return capture;
}

constexpr double kGrey = 0x1234 / 65535.0;

TEST(ReadPhoto, AppliesTheRadianceScale) {
  TempFolder folder;
  FourierCapture capture = test::writeSmallBundle(folder / "b");
  capture.radianceScale = 2.5;
  const Result<Image> image = readPhoto(capture, capture.photos[0]);
  ASSERT_TRUE(image.ok()) << image.error().sentence();
  EXPECT_NEAR(image->at(3, 3, 0), 0.041 * 2.5, kRounding);
  EXPECT_EQ(image->channels(), 3);
}

TEST(ReadPhoto, UndoesSrgb) {
  TempFolder folder;
  const FourierCapture capture = pngBundle(folder / "b", "srgb");
  const Result<Image> image = readPhoto(capture, capture.photos[0]);
  ASSERT_TRUE(image.ok()) << image.error().sentence();
  EXPECT_NEAR(image->at(0, 0, 1), std::pow((kGrey + 0.055) / 1.055, 2.4), kRounding);
  EXPECT_EQ(image->at(1, 0, 2), 1.0f);
}

TEST(ReadPhoto, UndoesGamma) {
  TempFolder folder;
  const FourierCapture capture = pngBundle(folder / "b", "gamma:2.2");
  const Result<Image> image = readPhoto(capture, capture.photos[0]);
  ASSERT_TRUE(image.ok()) << image.error().sentence();
  EXPECT_NEAR(image->at(0, 0, 0), std::pow(kGrey, 2.2), kRounding);
}

TEST(ReadPhoto, UndoesAMeasuredResponseChannelByChannel) {
  TempFolder folder;
  const FourierCapture capture = pngBundle(folder / "b", "response:r.json");
  test::writeText(folder / "b" / "r.json", R"({"format": "patina-response", "version": 1,
    "R": {"input": [0, 1], "output": [0, 2]},
    "G": {"input": [0, 0.05, 1], "output": [0, 0.01, 1]},
    "B": {"input": [0, 0.5, 1], "output": [0.25, 0.25, 4]}})");
  const Result<Image> image = readPhoto(capture, capture.photos[0]);
  ASSERT_TRUE(image.ok()) << image.error().sentence();
  EXPECT_NEAR(image->at(0, 0, 0), 2 * kGrey, kRounding);
  EXPECT_NEAR(image->at(0, 0, 1), 0.01 + (kGrey - 0.05) / 0.95 * 0.99, kRounding);
  EXPECT_NEAR(image->at(0, 0, 2), 0.25, kRounding);
  EXPECT_EQ(image->at(1, 0, 2), 4.0f);
}

TEST(LinearFromSrgb, HasTheStandardsValues) {
  EXPECT_EQ(linearFromSrgbPixel(0), 0);
  EXPECT_NEAR(linearFromSrgbPixel(0.04045), 0.0031308, 1e-7);
  EXPECT_NEAR(linearFromSrgbPixel(0.5), 0.2140411, 1e-7);
  EXPECT_EQ(linearFromSrgbPixel(1), 1);
}

TEST(ParseResponse, RefusesWhatIsNoResponse) {
  const auto parse = [](const std::string& curve) {
    return parseResponse(R"({"format": "patina-response", "version": 1, "R": )" + curve + R"(, "G": )" +
                             curve + R"(, "B": )" + curve + "}",
                         "r.json");
  };
  EXPECT_TRUE(parse(R"({"input": [0, 1], "output": [0, 1]})").ok());
  for (const char* curve :
       {R"({"input": [0, 1], "output": [1, 0]})", R"({"input": [0, 0.5, 0.5, 1], "output": [0, 1, 2, 3]})",
        R"({"input": [0, 0.9], "output": [0, 1]})", R"({"input": [0.1, 1], "output": [0, 1]})",
        R"({"input": [0, 1], "output": [1, 1]})", R"({"input": [0, 1], "output": [-1, 1]})",
        R"({"input": [0, 1], "output": [0]})", R"({"input": [0], "output": [0]})", R"({"input": [0, 1]})",
        "3"}) {
    const auto response = parse(curve);
    ASSERT_FALSE(response.ok()) << curve;
    EXPECT_THAT(response.error().where, HasSubstr("r.json: R")) << curve;
  }
  EXPECT_FALSE(parseResponse("{}", "r.json").ok());
  EXPECT_FALSE(parseResponse(R"({"format": "patina-response", "version": 2})", "r.json").ok());
  EXPECT_FALSE(parseResponse("nonsense", "r.json").ok());
}

TEST(ReadFourierCapture, ChecksResponsesBeforeAnyWorkIsDone) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b");
  test::writeText(folder / "b" / "p.png", std::string(test::asText(test::kGrey16Bytes)));
  test::writeText(folder / "b" / "r.json", "{}");
  nlohmann::json bundle = test::readBundleJson(folder / "b");
  bundle["photos"][3]["file"] = "p.png";
  bundle["photos"][3]["encoding"] = "response:r.json";
  test::writeBundleJson(folder / "b", bundle);
  const Result<FourierCapture> read = readFourierCapture(folder / "b");
  ASSERT_FALSE(read.ok());
  EXPECT_THAT(read.error().where, HasSubstr("r.json: format"));
}

// What may be wrong with a photograph itself. The bundle's description stays as it was.
class BadPhoto : public testing::Test {
 protected:
  Error read() const {
    const Result<Image> image = readPhoto(capture_, capture_.photos[2]);
    EXPECT_FALSE(image.ok());
    if (image.ok()) return {};
    EXPECT_THAT(image.error().where, HasSubstr(file().string()));
    EXPECT_FALSE(image.error().tryThis.empty());
    return image.error();
  }
  fs::path file() const { return capture_.folder / capture_.photos[2].file; }

  TempFolder folder_;
  FourierCapture capture_ = test::writeSmallBundle(folder_ / "b");
};

TEST_F(BadPhoto, Missing) {
  fs::remove(file());
  EXPECT_EQ(read().code, ErrorCode::NotFound);
}

TEST_F(BadPhoto, WrongSize) {
  ASSERT_TRUE(writeExr(file(), Image(13, 12, 3), {"R", "G", "B"}).ok());
  const Error error = read();
  EXPECT_EQ(error.code, ErrorCode::Invalid);
  EXPECT_THAT(error.what, HasSubstr("13 x 12"));
  EXPECT_THAT(error.what, HasSubstr("12 x 12"));
}

TEST_F(BadPhoto, Truncated) {
  const std::string bytes = test::readText(file());
  test::writeText(file(), bytes.substr(0, bytes.size() - 40));
  EXPECT_EQ(read().code, ErrorCode::Malformed);
  test::writeText(file(), "");
  EXPECT_EQ(read().code, ErrorCode::Malformed);
}

TEST_F(BadPhoto, NotANumber) {
  Image image(12, 12, 3, 0.5f);
  image.at(7, 5, 2) = NAN;
  ASSERT_TRUE(writeExr(file(), image, {"R", "G", "B"}).ok());
  const Error error = read();
  EXPECT_EQ(error.code, ErrorCode::Invalid);
  EXPECT_THAT(error.what, HasSubstr("(7, 5)"));
}

TEST_F(BadPhoto, OverflowsWhenScaled) {
  ASSERT_TRUE(writeExr(file(), Image(12, 12, 3, 3e38f), {"R", "G", "B"}).ok());
  capture_.radianceScale = 10;
  EXPECT_EQ(read().code, ErrorCode::Invalid);
}

TEST_F(BadPhoto, WithoutColours) {
  ASSERT_TRUE(writeExr(file(), Image(12, 12, 1), {"Y"}).ok());
  EXPECT_THAT(read().what, HasSubstr("no channel 'R'"));
}

TEST_F(BadPhoto, PngCalledExr) {
  ASSERT_TRUE(writePng(file(), Image(12, 12, 3)).ok());
  EXPECT_THAT(read().what, HasSubstr("not an OpenEXR image"));
}

TEST_F(BadPhoto, ReplacedByALinkAfterTheBundleWasRead) {
  fs::rename(file(), folder_ / "outside.exr");
  fs::create_symlink("../outside.exr", file());
  EXPECT_EQ(read().code, ErrorCode::Refused);
}

}  // namespace
}  // namespace patina
