// The parts of the comparison that need no window.
#include "widgets/comparison_view.h"

#include <gtest/gtest.h>

#include "widgets/shot_entry.h"

namespace patina::test {
namespace {

TEST(ComparisonView, DifferenceIsSignedRelativeAndCalmInTheDark) {
  const std::array<float, 3> dim{0.1f, 0.2f, 0.3f}, bright{0.2f, 0.4f, 0.6f}, none{0, 0, 0},
      noise{1e-5f, 0, 0};
  EXPECT_NEAR(ComparisonView::relativeDifference(dim, bright, 1e-3f), 1.0f, 1e-6f);
  EXPECT_NEAR(ComparisonView::relativeDifference(bright, dim, 1e-3f), -0.5f, 1e-6f);
  EXPECT_TRUE(std::isnan(ComparisonView::relativeDifference(none, none, 1e-3f))) << "beside the sample";
  EXPECT_LT(ComparisonView::relativeDifference(noise, bright, 1.0f), 1.0f) << "divided by noise";
}

TEST(ToneMapper, DivergingIsDarkAtZeroAndTellsTheSignByHue) {
  ToneSettings range;
  range.low = -1;
  range.high = 1;
  const ToneMapper tone(ToneStyle::Diverging, range);
  const auto colour = [&](float value) { return QColor(tone(std::array<float, 1>{value})); };
  EXPECT_LT(colour(0).lightness(), 60);
  EXPECT_NEAR(colour(0).red(), colour(0).blue(), 3) << "zero has a hue";
  EXPECT_GT(colour(1).red(), colour(1).blue() + 40);
  EXPECT_GT(colour(-1).blue(), colour(-1).red() + 40);
  int before = 0;
  for (int i = 0; i <= 10; ++i) {  // the size of a difference reads in grey, alike to both sides
    const int up = qGray(colour(0.1f * i).rgb()), down = qGray(colour(-0.1f * i).rgb());
    EXPECT_GE(up, before);
    EXPECT_NEAR(up, down, 18);
    before = up;
  }
  EXPECT_EQ(tone(std::array<float, 1>{NAN}), qRgb(56, 56, 56));
  Image image(2, 1, 1);
  image.at(0, 0) = -0.2f;
  image.at(1, 0) = 0.1f;
  const ToneSettings automatic = automaticTone(ToneStyle::Diverging, image);
  EXPECT_DOUBLE_EQ(automatic.low, -automatic.high);
}

TEST(PictureRenderer, SamplesTheSameInHalfAsInWholePictures) {
  auto picture = std::make_shared<Image>(8, 8, 1);
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x) picture->at(x, y) = static_cast<float>(x);
  PictureRenderer renderer;
  renderer.setPicture(picture);
  std::vector<float> samples;
  renderer.sample(samples, QRect(0, 0, 12, 4), {4, 0}, 1.0);
  ASSERT_EQ(samples.size(), 48u);
  EXPECT_TRUE(std::isnan(samples[3])) << "beside the picture";
  EXPECT_FLOAT_EQ(samples[4], 0);
  EXPECT_FLOAT_EQ(samples[11], 7);
  renderer.sample(samples, QRect(0, 0, 4, 4), {0, 0}, 0.5);
  EXPECT_NEAR(samples[1], 2.5f, 1e-5f) << "the mean of the columns 2 and 3";
  renderer.sample(samples, QRect(0, 0, 32, 32), {0, 0}, 4.0);
  EXPECT_FLOAT_EQ(samples[7], 1) << "magnified: squares";
  EXPECT_FLOAT_EQ(samples[8], 2);
}

TEST(ShotEntry, SpeaksOfErrorsAndAnglesAsPeopleDo) {
  constexpr double kRad = 3.14159265358979323846 / 180;
  EXPECT_EQ(logErrorText(std::log(1.25)), "25 %");
  EXPECT_EQ(percentText(0.0123), "1.2 %");
  EXPECT_EQ(percentText(-1), QStringLiteral("\u2013"));
  EXPECT_EQ(anglesText({6 * kRad, 38 * kRad, 89 * kRad}), QStringLiteral("6\u00b0 38\u00b0 89\u00b0"));
  EXPECT_EQ(anglesText({6 * kRad, 38 * kRad, -91 * kRad}), QStringLiteral("6\u00b0 38\u00b0 89\u00b0"))
      << "phiD has the period 180 degrees";
}

}  // namespace
}  // namespace patina::test
