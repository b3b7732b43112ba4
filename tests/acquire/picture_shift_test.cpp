#include "engine/acquire/picture_shift.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

namespace patina {
namespace {

/// Smooth random texture, seen through a shifted window; blurred by sigma.
Image texture(double dx, double dy, double blur, double noise, unsigned seed) {
  constexpr int kSide = 64, kWaves = 40;
  std::mt19937 fixed(7), random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::normal_distribution<double> normal;
  Image image(kSide, kSide, 3);
  std::vector<std::array<double, 4>> waves;
  for (int k = 0; k < kWaves; ++k)
    waves.push_back({2.2 * uniform(fixed), 2.2 * uniform(fixed), 6 * uniform(fixed), 0.06});
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      double value = 0;
      for (const auto& [kx, ky, phase, amplitude] : waves)
        value += amplitude * std::exp(-0.5 * blur * blur * (kx * kx + ky * ky)) *
                 std::cos(kx * (x - dx) + ky * (y - dy) + phase);
      for (int c = 0; c < 3; ++c)
        image.at(x, y, c) = static_cast<float>(0.5 * std::exp(value) + noise * normal(random));
    }
  return image;
}

TEST(PictureShift, FindsAShiftUnderOtherLight) {
  const Image reference = texture(0, 0, 0, 0.002, 1);
  for (const auto& [dx, dy] : {std::pair{0.0, 0.0}, {0.4, 0.0}, {-0.2, 0.5}, {0.6, -0.6}}) {
    Image photo = texture(dx, dy, 0, 0.002, 2);
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x)
        for (float& sample : photo.pixel(x, y))
          sample *= static_cast<float>(0.3 + 0.25 * std::sin(0.08 * x + 0.05 * y));
    const PictureShift shift = pictureShift(reference, photo, {});
    EXPECT_LT(shift.uncertaintyPx, 0.1);
    // One step, with differences for a gradient, on texture of three pixels a wave: right to a fifth.
    EXPECT_NEAR(shift.px.x(), dx, 0.2 * std::hypot(dx, dy) + 0.02);
    EXPECT_NEAR(shift.px.y(), dy, 0.2 * std::hypot(dx, dy) + 0.02);
  }
}

TEST(PictureShift, SaysThatItCantTellWithoutTexture) {
  EXPECT_GT(pictureShift(Image(64, 64, 3, 0.5f), Image(64, 64, 3, 0.4f), {}).uncertaintyPx, 1);
  Image noisy(64, 64, 3, 0.5f), other = noisy;
  std::mt19937 random(3);
  std::normal_distribution<float> normal(0, 0.01f);
  for (float& sample : noisy.samples()) sample += normal(random);
  for (float& sample : other.samples()) sample += normal(random);
  const PictureShift shift = pictureShift(noisy, other, {});
  EXPECT_LT(shift.px.norm(), 5 * shift.uncertaintyPx + 1);  // whatever it says, it isn't sure of a shift
  EXPECT_GT(pictureShift(texture(0, 0, 0, 0, 1), Image(32, 64, 3), {}).uncertaintyPx, 1);
}

TEST(Sharpness, FallsWithBlurAndNotWithNoise) {
  const double sharp = sharpness(texture(0, 0, 0, 0.01, 1), texture(0, 0, 0, 0.01, 2), {});
  const double noisy = sharpness(texture(0, 0, 0, 0.03, 3), texture(0, 0, 0, 0.03, 4), {});
  const double blurred = sharpness(texture(0, 0, 2.5, 0.01, 5), texture(0, 0, 2.5, 0.01, 6), {});
  EXPECT_GT(sharp, 0.2);
  EXPECT_NEAR(noisy, sharp, 0.25 * sharp);
  EXPECT_LT(blurred, 0.5 * sharp);
  EXPECT_LT(sharpness(Image(64, 64, 3, 0.5f), Image(64, 64, 3, 0.5f), {}), 0);
}

}  // namespace
}  // namespace patina
