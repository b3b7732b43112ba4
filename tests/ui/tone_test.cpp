#include "widgets/tone.h"

#include <gtest/gtest.h>

#include <cmath>

#include "widgets/colour_bar.h"
#include "widgets/sheet_shading.h"

namespace patina {
namespace {

// Published values of the sRGB curve (IEC 61966-2-1), rounded to 8 bits.
TEST(EncodeSrgb8, MatchesPublishedValues) {
  EXPECT_EQ(encodeSrgb8(0.0f), 0);
  EXPECT_EQ(encodeSrgb8(1.0f), 255);
  EXPECT_EQ(encodeSrgb8(0.5f), 188);
  EXPECT_EQ(encodeSrgb8(0.2158605f), 128);
  EXPECT_EQ(encodeSrgb8(0.0031308f), 10);
  EXPECT_EQ(encodeSrgb8(-1.0f), 0);
  EXPECT_EQ(encodeSrgb8(7.0f), 255);
  EXPECT_EQ(encodeSrgb8(std::nanf("")), 0);
}

TEST(ToneMapper, OneStopDoubles) {
  const float half[3] = {0.25f, 0.25f, 0.25f}, full[3] = {0.5f, 0.5f, 0.5f};
  ToneSettings plain, brighter;
  brighter.exposureEv = 1;
  EXPECT_EQ(ToneMapper(ToneStyle::LinearRgb, brighter)(half), ToneMapper(ToneStyle::LinearRgb, plain)(full));
}

TEST(ToneMapper, ScalarRampRisesInLightness) {
  ToneSettings tone;
  const ToneMapper mapper(ToneStyle::Scalar, tone);
  double previous = -1;
  for (int i = 0; i <= 64; ++i) {
    const float value = i / 64.0f;
    const QRgb colour = mapper({&value, 1});
    const double luma = 0.2126 * qRed(colour) + 0.7152 * qGreen(colour) + 0.0722 * qBlue(colour);
    EXPECT_GE(luma, previous - 0.5) << "at " << value;  // half a code value: rounding
    previous = luma;
  }
}

TEST(AutomaticTone, IgnoresUnmeasuredTexelsAndOutliers) {
  Image map(100, 10, 1), status(100, 10, 1, 1.0f);
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 100; ++x) map.at(x, y) = 1.0f + x / 100.0f;
  for (int x = 0; x < 50; ++x) {
    map.at(x, 0) = -1000;
    status.at(x, 0) = 0;
  }
  const ToneSettings tone = automaticTone(ToneStyle::Scalar, map, &status);
  EXPECT_NEAR(tone.low, 1.0, 0.03);
  EXPECT_NEAR(tone.high, 1.98, 0.03);
}

TEST(AutomaticTone, FlatMapHasARange) {
  const ToneSettings tone = automaticTone(ToneStyle::Scalar, Image(8, 8, 1, 0.3f));
  EXPECT_LT(tone.low, 0.3);
  EXPECT_GT(tone.high, 0.3);
}

TEST(AutomaticTone, SurvivesNotANumber) {
  Image map(8, 8, 1, std::nanf(""));
  const ToneSettings tone = automaticTone(ToneStyle::Scalar, map);
  EXPECT_TRUE(std::isfinite(tone.low) && std::isfinite(tone.high));
}

TEST(RoundTicks, AreRoundAndInside) {
  const auto ticks = roundTicks(0.013, 0.087, 5);
  ASSERT_GE(ticks.size(), 3u);
  for (const double tick : ticks) {
    EXPECT_GE(tick, 0.013);
    EXPECT_LE(tick, 0.087);
    EXPECT_NEAR(tick / 0.02, std::round(tick / 0.02), 1e-9);
  }
  EXPECT_TRUE(roundTicks(1, 1, 5).empty());
}

// A matte sheet has a closed form: albedo / pi * cos * intensity / distance^2, with intensity pi *
// reference^2.
TEST(ShadeSheet, MatteSheetFollowsInverseSquareAndCosine) {
  SvbrdfMaps maps;
  maps.width = maps.height = 9;
  maps.widthMm = maps.heightMm = 90;
  maps.diffuse = Image(9, 9, 3, 0.5f);
  maps.specular = Image(9, 9, 3, 0.0f);
  maps.normal = Image(9, 9, 3);
  maps.sigma = Image(9, 9, 1, 0.1f);
  maps.kurtosis = Image(9, 9, 1, 1.0f);
  maps.status = Image(9, 9, 1, 1.0f);
  for (int y = 0; y < 9; ++y)
    for (int x = 0; x < 9; ++x) maps.normal.at(x, y, 2) = 1;
  SheetLighting lighting;
  lighting.lightMm = {0, 0, 50};
  lighting.referenceDistanceMm = 50;
  Image radiance;
  shadeSheet(maps, lighting, 1, radiance);
  constexpr float kTolerance = 1e-4f;  // float arithmetic
  EXPECT_NEAR(radiance.at(4, 4, 1), 0.5f, kTolerance);
  const double distance2 = 40 * 40 + 50 * 50, cosine = 50 / std::sqrt(distance2);
  EXPECT_NEAR(radiance.at(8, 4, 0), 0.5 * 2500 / distance2 * cosine, kTolerance);
  EXPECT_NEAR(radiance.at(4, 0, 2), 0.5 * 2500 / distance2 * cosine, kTolerance);
}

// Row 0 is at +y: a light over the +y edge brightens row 0.
TEST(ShadeSheet, RowZeroIsAtPlusY) {
  SvbrdfMaps maps;
  maps.width = maps.height = 4;
  maps.widthMm = maps.heightMm = 40;
  maps.diffuse = Image(4, 4, 3, 0.5f);
  maps.specular = Image(4, 4, 3);
  maps.normal = Image(4, 4, 3);
  maps.sigma = Image(4, 4, 1, 0.1f);
  maps.kurtosis = Image(4, 4, 1, 1.0f);
  maps.status = Image(4, 4, 1, 1.0f);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 4; ++x) maps.normal.at(x, y, 2) = 1;
  SheetLighting lighting;
  lighting.lightMm = {0, 20, 10};
  Image radiance;
  shadeSheet(maps, lighting, 1, radiance);
  EXPECT_GT(radiance.at(1, 0), 2 * radiance.at(1, 3));
}

}  // namespace
}  // namespace patina
