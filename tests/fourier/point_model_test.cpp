#include "engine/fourier/point_model.h"

#include <gtest/gtest.h>

#include <numbers>

namespace patina::test {
namespace {

TEST(PatternRadiance, MatchesTheIntegralOfTheClippedSine) {
  // f: a Gaussian on the line, broad enough for the series' last harmonic to be small
  const double mean = 0.37, sigma = 0.12, w = 3, mass = 1.7;
  std::array<std::complex<float>, 2 + kEvenHarmonics> harmonics;
  auto transform = [&](double frequency) {
    return std::complex<float>(
        std::polar(mass * std::exp(-0.5 * frequency * frequency * sigma * sigma), -frequency * mean));
  };
  harmonics[0] = transform(0);
  harmonics[1] = transform(w);
  for (int m = 1; m <= kEvenHarmonics; ++m) harmonics[1 + m] = transform(2 * m * w);
  for (int phase = 0; phase < 4; ++phase) {
    double sum = 0;
    constexpr int kSteps = 200'000;
    for (int i = 0; i < kSteps; ++i) {
      const double x = -4 + 8 * (i + 0.5) / kSteps;
      const double f = mass / (sigma * std::sqrt(2 * std::numbers::pi)) *
                       std::exp(-0.5 * (x - mean) * (x - mean) / sigma / sigma);
      sum += f * std::max(0.0, std::sin(w * x + phase * std::numbers::pi / 2)) * 8 / kSteps;
    }
    EXPECT_NEAR(patternRadiance(harmonics, phase), sum, 1e-4 * mass) << phase;
  }
}

TEST(PatternRadiance, FourPhasesGiveBackZ) {
  std::array<std::complex<float>, 2 + kEvenHarmonics> harmonics{};
  harmonics[0] = 2.0f;
  harmonics[1] = {0.3f, -0.8f};
  harmonics[2] = {0.1f, 0.4f};
  const float i[4] = {patternRadiance(harmonics, 0), patternRadiance(harmonics, 1),
                      patternRadiance(harmonics, 2), patternRadiance(harmonics, 3)};
  EXPECT_NEAR(i[1] - i[3], harmonics[1].real(), 1e-6);
  EXPECT_NEAR(-(i[0] - i[2]), harmonics[1].imag(), 1e-6);
}

}  // namespace
}  // namespace patina::test
