#include "engine/image/png.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/base/temp_folder.h"
#include "tests/image/png_samples.h"

namespace patina {
namespace {

using test::asText;
using test::TempFolder;

constexpr float kRounding = 1e-7f;  // of a float in 0..1

std::vector<float> samplesOf(const Result<Image>& image) {
  if (!image) return {};
  return {image->samples().begin(), image->samples().end()};
}

void expectSamples(std::string_view bytes, const std::vector<float>& expected, float scale) {
  const Result<Image> image = readPngBytes(bytes, "test");
  ASSERT_TRUE(image.ok()) << image.error().sentence();
  const std::vector<float> samples = samplesOf(image);
  ASSERT_EQ(samples.size(), expected.size());
  for (std::size_t i = 0; i < samples.size(); ++i)
    EXPECT_NEAR(samples[i], expected[i] / scale, kRounding) << i;
}

TEST(ReadPng, GivesEightBits) {
  expectSamples(asText(test::kRgb8Bytes), {0, 51, 102, 153, 204, 255, 1, 2, 3, 4, 5, 6}, 255);
}

TEST(ReadPng, RepeatsGreyAndKeepsSixteenBits) {
  expectSamples(asText(test::kGrey16Bytes), {0x1234, 0x1234, 0x1234, 65535, 65535, 65535}, 65535);
}

TEST(ReadPng, UndoesNoGammaAndDropsOpacity) {
  expectSamples(asText(test::kRgba16GammaBytes), {1000, 2000, 3000}, 65535);
}

TEST(ReadPng, LooksUpPalettes) {
  expectSamples(asText(test::kPalette2Bytes), {1, 0, 0, 0, 1, 0, 0, 0, 1}, 1);
}

TEST(ReadPng, SpreadsSingleBits) {
  expectSamples(asText(test::kGrey1Bytes), {1, 1, 1, 0, 0, 0, 1, 1, 1}, 1);
}

TEST(ReadPng, UnravelsInterlacing) {
  expectSamples(asText(test::kInterlacedBytes), {10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120}, 255);
}

TEST(ReadPng, RefusesEveryTruncation) {
  const std::string_view whole = asText(test::kRgb8Bytes);
  for (std::size_t length = 0; length < whole.size() - 1; ++length) {
    const Result<Image> image = readPngBytes(whole.substr(0, length), "cut.png");
    ASSERT_FALSE(image.ok()) << length << " bytes";
    EXPECT_EQ(image.error().code, ErrorCode::Malformed);
    EXPECT_EQ(image.error().where, "cut.png");
  }
}

TEST(ReadPng, RefusesAbsurdSizesWithoutTakingTheMemory) {
  EXPECT_EQ(readPngBytes(asText(test::kHugeBytes), "x").error().code, ErrorCode::Malformed);
  EXPECT_EQ(readPngBytes(asText(test::kTooLongBytes), "x").error().code, ErrorCode::Malformed);
}

TEST(ReadPng, RefusesAnotherSizeThanExpected) {
  EXPECT_TRUE(readPngBytes(asText(test::kRgb8Bytes), "x", ImageSize{2, 2}).ok());
  const Result<Image> image = readPngBytes(asText(test::kRgb8Bytes), "x", ImageSize{3, 2});
  ASSERT_FALSE(image.ok());
  EXPECT_EQ(image.error().code, ErrorCode::Invalid);
  EXPECT_NE(image.error().what.find("2 x 2"), std::string::npos);
  EXPECT_NE(image.error().what.find("3 x 2"), std::string::npos);
}

TEST(ReadPng, RefusesOtherFormats) {
  const Result<Image> image = readPngBytes("GIF89a", "x.gif");
  ASSERT_FALSE(image.ok());
  EXPECT_EQ(image.error().what, "this is not a PNG image");
  EXPECT_EQ(readPng("/nowhere/x.png").error().code, ErrorCode::NotFound);
}

TEST(WritePng, RoundsAndClamps) {
  TempFolder folder;
  Image image(4, 1, 1);
  image.at(0, 0) = -3.0f;
  image.at(1, 0) = 0.5f;
  image.at(2, 0) = 7.0f;
  image.at(3, 0) = NAN;
  ASSERT_TRUE(writePng(folder / "a.png", image).ok());
  const Result<Image> back = readPng(folder / "a.png");
  ASSERT_TRUE(back.ok());
  EXPECT_EQ(samplesOf(back),
            (std::vector<float>{0, 0, 0, 128 / 255.0f, 128 / 255.0f, 128 / 255.0f, 1, 1, 1, 0, 0, 0}));
  EXPECT_EQ(test::everythingIn(folder.path()).size(), 1u);
}

TEST(WritePng, KeepsColours) {
  TempFolder folder;
  Image image(3, 2, 3);
  for (std::size_t i = 0; i < image.samples().size(); ++i) image.samples()[i] = static_cast<float>(i) / 17.0f;
  ASSERT_TRUE(writePng(folder / "a.png", image).ok());
  const Result<Image> back = readPng(folder / "a.png");
  ASSERT_TRUE(back.ok());
  for (std::size_t i = 0; i < image.samples().size(); ++i) {
    EXPECT_NEAR(back->samples()[i], image.samples()[i], 0.5f / 255 + kRounding);
  }
}

TEST(WritePng, SaysWhenItCannot) {
  EXPECT_EQ(writePng("/nowhere/x.png", Image(1, 1, 3)).error().code, ErrorCode::WriteFailed);
  EXPECT_THROW((void)writePng("x.png", Image(1, 1, 2)), std::invalid_argument);
}

}  // namespace
}  // namespace patina
