#include "engine/twoshot/observations.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include "engine/twoshot/metric.h"
#include "engine/twoshot/photo_noise.h"

namespace patina {
namespace {

constexpr double kEverything = std::numeric_limits<double>::infinity();

/// A picture of a disc seen from above, whose BRDF is `value(x, y)` in millimetres.
template <typename Value>
ReflectancePicture pictureOf(int side, Value&& value, double variance = 0) {
  TwoShotCapture capture;
  capture.radiusMm = 40;
  Camera camera;
  camera.width = camera.height = side;
  const double focal = 3.0 * side, centre = (side - 1) / 2.0;
  camera.intrinsics << focal, 0, centre, 0, focal, centre, 0, 0, 1;
  camera.cameraFromWorld << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  camera.translationMm = {0, 0, 300};
  ReflectancePicture picture;
  picture.shots = {0};
  picture.toLight = Eigen::Vector3d(0.5, 0, 0.9).normalized();
  picture.view = viewOf(capture, camera);
  picture.usable = picture.view.inside;
  picture.brdf = Image(side, side, 3);
  picture.variance = Image(side, side, 3, static_cast<float>(variance));
  picture.irradiance.rate = Image(side, side, 3, 1.0f);
  picture.irradiance.relativeVariance = Image(side, side, 3);
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const Eigen::Vector2f at = picture.view.positionMm[picture.view.index(x, y)];
      for (int c = 0; c < 3; ++c) picture.brdf.at(x, y, c) = static_cast<float>(value(at.x(), at.y()));
    }
  }
  return picture;
}

double sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

TEST(Observations, WeighThreeHundredRowsAPictureWhateverTheResolution) {
  for (const int side : {60, 160, 400}) {
    const auto rows = observe({pictureOf(side, [](double, double) { return 0.2; })}, {}, 0, 2000);
    EXPECT_NEAR(sum(rows.weight), kEtaRows, 1e-3) << side;
    EXPECT_LE(rows.size(), 2000u);
    EXPECT_GE(rows.size(), 60u);
    for (const Eigen::Array3d& f : rows.brdf) EXPECT_NEAR(f[0], 0.2, 1e-6);
  }
}

TEST(Observations, UnusedPixelsAreStoodForByTheirNeighbours) {
  ReflectancePicture picture = pictureOf(160, [](double, double) { return 0.2; });
  for (std::size_t i = 0; i < picture.usable.size(); i += 2) picture.usable[i] = 0;
  // But for cells at the rim that have lost their only pixel.
  EXPECT_NEAR(sum(observe({picture}, {}, 0, 2000).weight), kEtaRows, 1e-3 * kEtaRows);
  // A part of the sample that isn't seen at all is not made up for.
  picture.usable = picture.view.inside;
  for (std::size_t i = 0; i < picture.usable.size() / 2; ++i) picture.usable[i] = 0;
  EXPECT_NEAR(sum(observe({picture}, {}, 0, 2000).weight), kEtaRows / 2, 0.1 * kEtaRows);
}

TEST(Observations, ResolveAHighlightNarrowerThanABlock) {
  // A highlight of 1 mm on a disc of 80 mm: 4 pixels of 400, where a block of even size would have 7.
  constexpr double kWidthMm = 1, kPeak = 50;
  const auto highlight = [](double x, double y) {
    return 0.05 + kPeak * std::exp(-(x * x + y * y) / (2 * kWidthMm * kWidthMm));
  };
  const auto rows = observe({pictureOf(400, highlight)}, {}, 0, 2000);
  double brightest = 0, flux = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    brightest = std::max(brightest, rows.brdf[i][0]);
    flux += rows.weight[i] * rows.brdf[i][0];
  }
  EXPECT_GT(brightest, 0.9 * kPeak);
  // And the mean is that of the pixels.
  const ReflectancePicture picture = pictureOf(400, highlight);
  double total = 0, count = 0;
  for (std::size_t i = 0; i < picture.usable.size(); ++i) {
    if (picture.usable[i]) total += picture.brdf.samples()[3 * i], count += 1;
  }
  EXPECT_NEAR(flux / sum(rows.weight) / (total / count), 1, 0.02);
}

TEST(Observations, BlocksHoldOneMaterial) {
  const ReflectancePicture picture = pictureOf(160, [](double x, double) { return x < 3 ? 0.1 : 0.5; });
  std::vector<std::int8_t> label(picture.usable.size(), -1);
  for (std::size_t i = 0; i < label.size(); ++i) {
    if (picture.usable[i]) label[i] = picture.view.positionMm[i].x() < 3 ? 0 : 1;
  }
  for (const int material : {0, 1}) {
    const auto rows = observe({picture}, {label}, material, 500);
    ASSERT_GT(rows.size(), 15u);
    for (const Eigen::Array3d& f : rows.brdf) EXPECT_NEAR(f[0], material == 0 ? 0.1 : 0.5, 1e-6);
  }
}

TEST(PhotoNoise, IsFoundBelowASmoothPicture) {
  constexpr double kShot = 4e-4, kRead = 3e-3;
  constexpr int kSide = 200;
  std::mt19937 random(5);
  std::normal_distribution<float> normal;
  Image image(kSide, kSide, 3);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const double value = 0.02 + std::exp(-0.002 * ((x - 80.0) * (x - 80.0) + (y - 90.0) * (y - 90.0)));
      for (int c = 0; c < 3; ++c) {
        image.at(x, y, c) =
            static_cast<float>(value + std::sqrt(kShot * value + kRead * kRead) * normal(random));
      }
    }
  }
  const std::vector<std::uint8_t> all(image.pixelCount(), 1);
  const PhotoNoise noise = estimateNoise({&image, &all});
  for (const double value : {0.03, 0.2, 0.9}) {
    EXPECT_NEAR(std::sqrt(noise.variance(value) / (kShot * value + kRead * kRead)), 1, 0.12) << value;
  }
}

TEST(ClipLevels, TellAPlateauFromAMaximum) {
  constexpr int kSide = 100;
  const std::vector<std::uint8_t> all(kSide * kSide, 1);
  Image smooth(kSide, kSide, 3), clipped = smooth, even(kSide, kSide, 3, 0.25f);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const double value = std::exp(-0.001 * ((x - 50.0) * (x - 50.0) + (y - 50.0) * (y - 50.0)));
      for (int c = 0; c < 3; ++c) {
        smooth.at(x, y, c) = static_cast<float>(std::round(value * 1000) / 1000);  // a file's digits
        clipped.at(x, y, c) = static_cast<float>(std::min(value, 0.8));
      }
    }
  }
  EXPECT_TRUE((clipLevels({&smooth, &all}, 0, kEverything) == kEverything).all());
  EXPECT_TRUE((clipLevels({&clipped, &all}, 0, kEverything) == static_cast<double>(0.8f)).all());
  EXPECT_TRUE((clipLevels({&even, &all}, 0, kEverything) == kEverything).all())
      << "an even picture says nothing";
  EXPECT_TRUE((clipLevels({&even, &all}, 0, 0.25) == 0.25).all()) << "unless it is at a known limit";
  EXPECT_TRUE((clipLevels({&smooth, &all}, 0.7, kEverything) == 0.995 * 0.7).all())
      << "the bundle's word counts";
}

}  // namespace
}  // namespace patina
