#include "engine/calibration/white_tile.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace patina {
namespace {

using testing::HasSubstr;

constexpr double kStatedBound = 0.005;  // of the irradiance

/// A lamp at (x, y, z) over a tile of 100 mm: cosine over squared distance.
double lampAt(double u, double v) {
  const double dx = 100 * (u - 0.5) - 60, dy = 100 * (v - 0.5) + 40, z = 400, d2 = dx * dx + dy * dy + z * z;
  return z * z * z / (d2 * std::sqrt(d2));
}

struct Scene {
  int width = 300, height = 240;
  Eigen::Vector3d irradiance{2.7, 2.4, 1.9}, reflectance{0.991, 0.990, 0.987}, black{0.01, 0.012, 0.009};
  double exposureS = 0.25, noise = 0.004, clipAt = 1e9;
  bool shadow = false;
  double truth(int x, int y, int c) const {
    return irradiance[c] * lampAt((x + 0.5) / width, (y + 0.5) / height);
  }
  Image photo() const {
    Image image(width, height, 3);
    std::mt19937 random(9);
    std::normal_distribution<double> normal;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) {
          double v = truth(x, y, c) * reflectance[c] / M_PI * exposureS;
          if (shadow && x > 60 && x < 120 && y > 60 && y < 140) v *= 0.9;
          v += black[c] + noise * std::sqrt(v) * normal(random) + 5e-4 * normal(random);
          image.at(x, y, c) = static_cast<float>(std::min(v, clipAt));
        }
    return image;
  }
  Result<WhiteTileCalibration> calibrated(double saturation = 0) const {
    WhiteTileOptions options;
    options.exposureS = exposureS;
    options.blackLevel = black;
    options.saturation = saturation;
    return calibrateWhiteTile(photo(), {reflectance, {}, "test"}, options);
  }
  double worstError(const WhiteTileCalibration& found) const {
    double worst = 0;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c)
          worst = std::max(worst, std::abs(found.irradiance.at(x, y, c) / truth(x, y, c) - 1));
    return worst;
  }
};

TEST(WhiteTile, FindsTheIrradianceOfEveryPixel) {
  const Scene scene;
  const Result<WhiteTileCalibration> found = scene.calibrated(1);
  ASSERT_TRUE(found.ok()) << found.error().sentence();
  EXPECT_LT(scene.worstError(*found), kStatedBound);
  EXPECT_TRUE(found->passed());
  for (int c = 0; c < 3; ++c) {
    EXPECT_GT(found->relativeSd[c], 0);
    EXPECT_LT(found->relativeSd[c], kStatedBound);
  }
}

TEST(WhiteTile, IsNotPulledByAShadowAndNamesIt) {
  Scene scene;
  scene.shadow = true;
  const Result<WhiteTileCalibration> found = scene.calibrated(1);
  ASSERT_TRUE(found.ok());
  EXPECT_LT(scene.worstError(*found), kStatedBound);
  EXPECT_FALSE(found->passed());
  for (const TileCheck& check : found->checks)
    EXPECT_EQ(check.passed, check.id != "shadow") << check.sentence;
}

TEST(WhiteTile, NamesWhatIsWrong) {
  Scene clipped;
  clipped.clipAt = 0.2;  // part of the red channel
  Result<WhiteTileCalibration> found = clipped.calibrated(0.2);
  ASSERT_TRUE(found.ok()) << found.error().sentence();
  EXPECT_FALSE(found->checks[0].passed);
  EXPECT_THAT(found->checks[0].sentence, HasSubstr("shorter"));
  found = clipped.calibrated();  // the plateau is seen without being told
  ASSERT_TRUE(found.ok());
  EXPECT_FALSE(found->checks[0].passed);
  const Scene dim;
  found = dim.calibrated(10);
  ASSERT_TRUE(found.ok());
  EXPECT_FALSE(found->checks[1].passed);
  Scene black;
  black.irradiance.setZero();
  EXPECT_FALSE(black.calibrated(1).ok());
  WhiteTileOptions outside;
  outside.region = {10, 10, 400, 100};
  EXPECT_FALSE(calibrateWhiteTile(Image(300, 240, 3, 0.5f), {}, outside).ok());
}

TEST(ReflectanceTable, IsWeightedToThreeChannels) {
  std::string text = "wavelength [nm]; reflectance\n# certificate 4711\n";
  for (int nm = 300; nm <= 800; nm += 10)
    text += std::to_string(nm) + "; " + std::to_string(0.97 + 0.00004 * (nm - 300)) + "\n";
  const Result<CertifiedReflectance> table = parseReflectanceTable(text, "tile.csv");
  ASSERT_TRUE(table.ok()) << table.error().sentence();
  // A straight line's weighted mean is its value in the band's middle.
  EXPECT_NEAR(table->rgb[0], 0.97 + 0.00004 * 300, 1e-6);
  EXPECT_NEAR(table->rgb[1], 0.97 + 0.00004 * 240, 1e-6);
  EXPECT_NEAR(table->rgb[2], 0.97 + 0.00004 * 155, 1e-6);
  EXPECT_NEAR(table->spread[1], 0.00004 * 22, 0.00004 * 4);
  const Result<CertifiedReflectance> percent = parseReflectanceTable("nm\t%\n380\t98.5\n700\t98.5\n", "p");
  ASSERT_TRUE(percent.ok()) << percent.error().sentence();
  EXPECT_NEAR(percent->rgb[1], 0.985, 1e-12);
  EXPECT_FALSE(parseReflectanceTable("", "e").ok());
  EXPECT_THAT(parseReflectanceTable("500,0.9\n600,x\n", "e").error().where, HasSubstr("line 2"));
  EXPECT_THAT(parseReflectanceTable("500,0.9\n600,0.9\n", "e").error().what, HasSubstr("reach"));
}

}  // namespace
}  // namespace patina
