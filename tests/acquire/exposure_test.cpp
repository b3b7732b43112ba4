#include "engine/acquire/exposure.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace patina {
namespace {

TEST(Exposure, IsAWholeNumberOfRefreshesInRange) {
  EXPECT_NEAR(wholeRefreshes(0.1, 60, 1e-4, 10), 6.0 / 60, 1e-12);
  EXPECT_NEAR(wholeRefreshes(0.021, 60, 1e-4, 10), 1.0 / 60, 1e-12);
  EXPECT_NEAR(wholeRefreshes(0.001, 60, 1e-4, 10), 1.0 / 60, 1e-12);  // one at least
  EXPECT_NEAR(wholeRefreshes(5, 60, 1e-4, 0.05), 3.0 / 60, 1e-12);    // the longest that fits
  EXPECT_NEAR(wholeRefreshes(0.001, 60, 0.04, 10), 3.0 / 60, 1e-12);  // the shortest that fits
  EXPECT_NEAR(wholeRefreshes(1, 60, 1e-4, 0.01), 0.01, 1e-12);        // none fits: the range's end
  EXPECT_NEAR(wholeRefreshes(0.0234, 0, 1e-4, 10), 0.0234, 1e-12);    // no refresh is known
  EXPECT_NEAR(wholeRefreshes(1.0 / 60, 60, 1.0 / 60, 1.0 / 60), 1.0 / 60, 1e-12);
}

TEST(Exposure, BringsThePercentileOfTheSampleToTheFill) {
  Image photo(10, 10, 3, 0.1f);
  photo.at(3, 3, 1) = 0.4f;
  photo.at(9, 9, 2) = 0.9f;  // off the sample
  Image mask(10, 10, 1, 1.0f);
  mask.at(9, 9) = 0;
  EXPECT_NEAR(exposureFor(photo, mask, 0.05, 0.8, 1.0, 1e-4, 10), 0.05 * 0.8 / 0.4, 1e-7);
  EXPECT_NEAR(exposureFor(photo, mask, 0.05, 0.8, 0.5, 1e-4, 10), 0.05 * 0.8 / 0.1, 1e-7);
  photo.at(3, 3, 1) = 0.99f;  // clipped: nobody knows by how much
  EXPECT_NEAR(exposureFor(photo, mask, 0.08, 0.8, 1.0, 1e-4, 10), 0.02, 1e-9);
  EXPECT_EQ(exposureFor(Image(4, 4, 3, 0.0f), {}, 0.05, 0.8, 1.0, 1e-4, 3), 3);
  EXPECT_EQ(exposureFor(photo, mask, 0.05, 0.8, 0.5, 1e-4, 0.1), 0.1);
}

TEST(Bracket, MergesToRadianceBeyondTheRangeOfOne) {
  // A scene of five decades; exposures that clip and round to 12 bits.
  Image scene(64, 1, 3);
  for (int x = 0; x < 64; ++x)
    for (int c = 0; c < 3; ++c) scene.at(x, 0, c) = static_cast<float>(0.002 * std::pow(10.0, 4.0 * x / 63));
  std::vector<BracketPhoto> bracket;
  for (const double exposureS : bracketExposures(0.5, 4, 4, 0)) {
    BracketPhoto one{scene, exposureS};
    for (float& sample : one.photo.samples())
      sample = std::min(1.0f, std::round(static_cast<float>(sample * exposureS * 4095)) / 4095);
    bracket.push_back(one);
  }
  ASSERT_EQ(bracket.size(), 4u);
  EXPECT_EQ(bracket[1].exposureS, 0.125);
  Image clipped;
  const Result<Image> merged = mergeBracket(bracket, 0.98, &clipped);
  ASSERT_TRUE(merged.ok());
  for (int x = 0; x < 64; ++x) {
    const double truth = scene.at(x, 0, 0);
    if (truth * bracket.back().exposureS < 0.97) {
      double codes = 0, time = 0;  // half a code of each exposure that isn't clipped, over their time
      for (const BracketPhoto& one : bracket)
        if (one.photo.at(x, 0, 0) < 0.98f) codes += 0.5 / 4095, time += one.exposureS;
      EXPECT_NEAR(merged->at(x, 0, 0), truth, 1e-6 * truth + 1.01 * codes / time) << x;
      EXPECT_EQ(clipped.at(x, 0), 0);
    } else {
      EXPECT_EQ(clipped.at(x, 0), truth * bracket.back().exposureS >= 0.98 ? 1 : 0) << x;
    }
  }
}

TEST(Bracket, WeighsByTheLightThatWasCollected) {
  std::mt19937 random(5);
  double squares[2] = {0, 0};
  for (int trial = 0; trial < 4000; ++trial) {
    // Shot noise of a thousand electrons a full scale.
    std::vector<BracketPhoto> bracket;
    for (const double exposureS : {1.0, 0.25}) {
      std::poisson_distribution<int> electrons(1000 * 0.6 * exposureS);
      bracket.push_back({Image(1, 1, 1, static_cast<float>(electrons(random)) / 1000), exposureS});
    }
    squares[0] += std::pow(mergeBracket(bracket)->at(0, 0) - 0.6, 2);
    squares[1] += std::pow((bracket[0].photo.at(0, 0) + bracket[1].photo.at(0, 0) / 0.25) / 2 - 0.6, 2);
  }
  // The best is variance 0.6 / 1000 / 1.25; an even mean has 1.56 times more. Four thousand trials: 5 %.
  EXPECT_NEAR(squares[0] / 4000, 0.6 / 1000 / 1.25, 0.05 * 0.6 / 1000 / 1.25 * 2);
  EXPECT_GT(squares[1], 1.3 * squares[0]);
}

TEST(Bracket, NothingOrSizesThatDifferAreRefused) {
  EXPECT_FALSE(mergeBracket({}).ok());
  EXPECT_FALSE(mergeBracket({{Image(2, 2, 3), 1}, {Image(3, 2, 3), 1}}).ok());
  EXPECT_FALSE(mergeBracket({{Image(2, 2, 3), 0}}).ok());
}

}  // namespace
}  // namespace patina
