#include "engine/flash/noise.h"

#include <algorithm>
#include <cmath>

namespace patina {
namespace {

constexpr int kBlock = 8;
constexpr int kBins = 16;
constexpr double kDarkest = 1e-4;
/// The quietest twentieth of blocks lies this far below the mean of blocks of equal noise: quantile of the
/// mean of 36 squared second differences, some 20 of them independent.
constexpr double kQuantile = 0.05, kQuantileOverMean = 0.54;
constexpr std::size_t kFewestBlocks = 40;

}  // namespace

double FlashNoise::variance(double value, int channel) const {
  double step = 0;
  const std::vector<float>& values = valueOfCode[static_cast<std::size_t>(channel)];
  if (values.size() > 1) {
    const auto above = std::lower_bound(values.begin() + 1, values.end() - 1, static_cast<float>(value));
    step = *above - *(above - 1);
  }
  return read * read + shot * std::max(0.0, value) + step * step / 12;
}

FlashNoise measureFlashNoise(std::span<const FlashPixels> photos, const std::array<float, 3>& largest) {
  FlashNoise noise;
  for (const FlashPixels& photo : photos) {
    if (!photo.valueOfCode[0].empty()) noise.valueOfCode = photo.valueOfCode;
  }
  std::array<std::vector<std::pair<double, double>>, kBins> bins;  // mean value, variance
  for (const FlashPixels& photo : photos) {
    const Image& image = photo.linear;
    for (int by = 0; by + kBlock <= image.height(); by += kBlock) {
      for (int bx = 0; bx + kBlock <= image.width(); bx += kBlock) {
        for (int c = 0; c < 3; ++c) {
          double sum = 0, squares = 0;
          bool clipped = false;
          for (int y = by; y < by + kBlock; ++y) {
            for (int x = bx; x < bx + kBlock; ++x) {
              const float v = image.at(x, y, c);
              sum += v;
              clipped |= largest[c] > 0 && v >= largest[c];
            }
          }
          if (clipped) continue;
          for (int y = by + 1; y + 1 < by + kBlock; ++y) {
            for (int x = bx + 1; x + 1 < bx + kBlock; ++x) {
              const double d = image.at(x - 1, y - 1, c) + image.at(x + 1, y - 1, c) +
                               image.at(x - 1, y + 1, c) + image.at(x + 1, y + 1, c) +
                               4.0 * image.at(x, y, c) -
                               2.0 * (image.at(x, y - 1, c) + image.at(x, y + 1, c) + image.at(x - 1, y, c) +
                                      image.at(x + 1, y, c));
              squares += d * d;
            }
          }
          const double mean = sum / (kBlock * kBlock);
          if (!(mean > kDarkest)) continue;
          const double variance = squares / ((kBlock - 2) * (kBlock - 2)) / 36;
          const int bin = std::clamp(static_cast<int>(kBins * (1 + std::log10(mean) / 4)), 0, kBins - 1);
          bins[bin].emplace_back(mean, variance);
        }
      }
    }
  }
  std::vector<std::array<double, 3>> points;  // value, variance without that of the codes, of the codes
  for (auto& bin : bins) {
    if (bin.size() < kFewestBlocks) continue;
    const auto nth = bin.begin() + static_cast<std::ptrdiff_t>(kQuantile * static_cast<double>(bin.size()));
    std::nth_element(bin.begin(), nth, bin.end(),
                     [](const auto& a, const auto& b) { return a.second < b.second; });
    points.push_back({nth->first, nth->second / kQuantileOverMean, noise.variance(nth->first, 1)});
  }
  // read^2 + shot v through the points: least sum of absolute logarithms, over a grid, because variances are
  // right to a factor, and one bin that texture spoils must not bend the line.
  constexpr double kLowest = 1e-6, kHighest = 0.1;  // standard deviations; variance of shot noise likewise
  constexpr int kSteps = 100;
  double least = 1e300;
  noise.read = kLowest;
  for (int r = 0; r <= kSteps; ++r) {
    const double read = kLowest * std::pow(kHighest / kLowest, static_cast<double>(r) / kSteps);
    for (int s = 0; s <= kSteps; ++s) {
      const double shot = s == 0 ? 0 : 1e-8 * std::pow(1e6, static_cast<double>(s) / kSteps);
      double sum = 0;
      for (const auto& [value, variance, codes] : points)
        sum += std::abs(std::log((read * read + shot * value + codes) / (variance + 1e-14)));
      if (sum < least) least = sum, noise.read = read, noise.shot = shot;
    }
  }
  return noise;
}

}  // namespace patina
