#include "engine/calibration/hdr_merge.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace patina {
namespace {

using testing::HasSubstr;

constexpr double kShot = 2e-4, kRead = 1e-3;
constexpr int kWidth = 160, kHeight = 120;

double radianceAt(int x, int y) {  // twelve stops
  return 0.02 * std::pow(2.0, 12.0 * x / kWidth) * (1 + 0.1 * std::sin(0.3 * y));
}

std::vector<ExposedPhoto> bracket(double blackLevel) {
  std::vector<ExposedPhoto> photos;
  std::mt19937 random(6);
  std::normal_distribution<double> normal;
  for (const double exposure : {0.01, 1.0, 0.1}) {
    ExposedPhoto photo{"at " + std::to_string(exposure), Image(kWidth, kHeight, 3), exposure};
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        for (int c = 0; c < 3; ++c) {
          const double v = radianceAt(x, y) * exposure;
          photo.image.at(x, y, c) = static_cast<float>(
              std::min(1.0, v + std::sqrt(kShot * v + kRead * kRead) * normal(random) + blackLevel));
        }
    photos.push_back(std::move(photo));
  }
  return photos;
}

MergeOptions options(double blackLevel) {
  MergeOptions merge;
  merge.shot = kShot, merge.read = kRead;
  merge.blackLevel.setConstant(blackLevel);
  return merge;
}

TEST(HdrMerge, IsAsGoodAsTheNoiseAllowsAndSaysHowGood) {
  const Result<MergedRadiance> merged = mergeExposures(bracket(0.05), options(0.05));
  ASSERT_TRUE(merged.ok()) << merged.error().sentence();
  double pulls = 0, meanPull = 0;
  int count = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (int c = 0; c < 3; ++c) {
        const double sd = merged->relativeSd.at(x, y, c);
        if (!std::isfinite(sd)) continue;
        const double pull = (merged->radiance.at(x, y, c) / radianceAt(x, y) - 1) / sd;
        pulls += pull * pull, meanPull += pull, ++count;
      }
  // 50 000 samples: the mean square of standard normals is 1 within 0.01; what stands beside clipping is cut
  // a little.
  EXPECT_NEAR(pulls / count, 1, 0.05);
  EXPECT_NEAR(meanPull / count, 0, 0.03);
  EXPECT_EQ(merged->clipped, 0u);
  for (const double mismatch : merged->mismatch) EXPECT_LT(std::abs(mismatch), 0.005);
  EXPECT_TRUE(merged->warnings.empty());
}

TEST(HdrMerge, MarksWhatNoExposureSaw) {
  std::vector<ExposedPhoto> photos = bracket(0);
  photos.erase(photos.begin());  // the shortest
  const Result<MergedRadiance> merged = mergeExposures(photos, options(0));
  ASSERT_TRUE(merged.ok());
  EXPECT_GT(merged->clipped, 0u);
  EXPECT_TRUE(std::isinf(merged->relativeSd.at(kWidth - 1, 60, 0)));
  EXPECT_NEAR(merged->radiance.at(kWidth - 1, 60, 0), 10, 1e-5) << "the bound: full scale at 0.1 s";
}

TEST(HdrMerge, NamesAWrongExposure) {
  std::vector<ExposedPhoto> photos = bracket(0);
  photos[2].exposureS *= 1.25;
  const Result<MergedRadiance> merged = mergeExposures(photos, options(0));
  ASSERT_TRUE(merged.ok());
  ASSERT_FALSE(merged->warnings.empty());
  EXPECT_THAT(testing::PrintToString(merged->warnings), HasSubstr(photos[2].name));
  photos[1].exposureS = 0;
  EXPECT_FALSE(mergeExposures(photos, options(0)).ok());
  EXPECT_FALSE(mergeExposures({}, options(0)).ok());
  photos = bracket(0);
  photos[1].image = Image(10, 10, 3);
  EXPECT_FALSE(mergeExposures(photos, options(0)).ok());
}

}  // namespace
}  // namespace patina
