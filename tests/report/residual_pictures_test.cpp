#include "engine/report/residual_pictures.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/report/made_up_explanation.h"

namespace patina {
namespace {

/// Standard deviation of a residual picture's values inside the sample, in standard deviations of the noise.
/// The ground off the sample is not a multiple of a 63rd.
double spread(const Image& picture) {
  double sum = 0, n = 0;
  for (const float value : picture.samples()) {
    if (std::abs(value * 63 - std::round(value * 63)) > 1e-3) continue;
    const double sigmas = (value - 0.5) * 2 * kResidualRangeSigmas;
    sum += sigmas * sigmas, n += 1;
  }
  return n > 0 ? std::sqrt(sum / n) : -1;
}

TEST(ResidualView, APerfectPredictionLooksLikeItsExpectedNoise) {
  const ResidualView view = residualView(test::madeUpPicture(160, 120, 4), 400);
  ASSERT_FALSE(view.empty());
  EXPECT_NEAR(view.rmsAfter, 1, 0.02);
  EXPECT_GT(view.rmsBefore, 1.2);
  EXPECT_NEAR(spread(view.after), spread(view.expected), 0.03);
  EXPECT_NEAR(spread(view.expected), 1, 0.03);
  EXPECT_GT(spread(view.before), 1.2);
}

TEST(ResidualView, AveragingManyPixelsAveragesTheirNoise) {
  const ResidualView view = residualView(test::madeUpPicture(640, 480, 0.6f), 80);
  EXPECT_LE(view.before.width(), 80);
  EXPECT_NEAR(view.rmsAfter, 1, 0.05);
  EXPECT_GT(view.rmsBefore, 1.3) << "below the noise of a pixel, above that of sixty-four";
}

TEST(ResidualView, IsCroppedToTheSample) {
  ResidualPicture picture = test::madeUpPicture(40, 40, 1);
  ResidualPicture wide = picture;
  for (Image* image : {&wide.captured, &wide.predictedBefore, &wide.predictedAfter, &wide.noiseSigma}) {
    Image framed(200, 100, 3);
    for (int y = 0; y < 40; ++y)
      for (int x = 0; x < 40; ++x)
        for (int c = 0; c < 3; ++c) framed.at(x + 70, y + 9, c) = image->at(x, y, c);
    *image = framed;
  }
  const ResidualView small = residualView(picture, 100), large = residualView(wide, 100);
  EXPECT_EQ(small.captured.width(), large.captured.width());
  EXPECT_EQ(small.captured.height(), large.captured.height());
  EXPECT_DOUBLE_EQ(small.rmsBefore, large.rmsBefore);
}

TEST(ResidualView, PartsThatDontFitAreLeftOut) {
  EXPECT_TRUE(residualView({}, 100).empty());
  ResidualPicture picture = test::madeUpPicture(20, 20, 1);
  picture.predictedAfter = Image(3, 3, 3);
  const ResidualView view = residualView(picture, 100);
  EXPECT_FALSE(view.empty());
  EXPECT_TRUE(view.after.empty());
  EXPECT_EQ(view.rmsAfter, -1);
  picture.noiseSigma = Image(20, 20, 3);
  EXPECT_TRUE(residualView(picture, 100).empty()) << "no noise: off the sample everywhere";
}

TEST(PlacePicture, MoreResidualIsLighter) {
  Image place(12, 4, 1);
  for (int x = 1; x < 11; ++x) place.at(x, 2) = static_cast<float>(x);
  const Image shown = placePicture(place, 100, 0.7, 10);
  ASSERT_EQ(shown.width(), 10);
  ASSERT_EQ(shown.height(), 1);
  const auto lightness = [&](int x) { return shown.at(x, 0, 0) + shown.at(x, 0, 1) + shown.at(x, 0, 2); };
  for (int x = 1; x < 10; ++x) EXPECT_GT(lightness(x), lightness(x - 1));
  EXPECT_TRUE(placePicture(Image(4, 4, 1), 100, 0.7, 10).empty());
  EXPECT_TRUE(placePicture({}, 100, 0.7, 10).empty());
}

TEST(MapPicture, RangeIsThatOfTheMap) {
  Image map(100, 10, 1);
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 100; ++x) map.at(x, y) = static_cast<float>(x);
  map.at(5, 5) = NAN;
  double low = 0, high = 0;
  const Image shown = mapPicture(map, 200, &low, &high);
  EXPECT_EQ(shown.width(), 100);
  EXPECT_NEAR(low, 2, 1);
  EXPECT_NEAR(high, 97, 1);
  EXPECT_TRUE(mapPicture({}, 100, &low, &high).empty());
  EXPECT_TRUE(mapPicture(Image(3, 3, 2), 100, &low, &high).empty());
}

}  // namespace
}  // namespace patina
