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
  // read^2 + shot v through the bins' points, each counted by its relative error.
  double aa = 0, ab = 0, bb = 0, ar = 0, br = 0;
  for (auto& bin : bins) {
    if (bin.size() < kFewestBlocks) continue;
    const auto nth = bin.begin() + static_cast<std::ptrdiff_t>(kQuantile * static_cast<double>(bin.size()));
    std::nth_element(bin.begin(), nth, bin.end(),
                     [](const auto& a, const auto& b) { return a.second < b.second; });
    const double value = nth->first;
    // Quantisation is counted by itself.
    const double quantised = noise.variance(value, 1);
    const double measured = std::max(nth->second / kQuantileOverMean - quantised, 0.0);
    const double scale = 1 / (measured + quantised + 1e-14);
    aa += scale * scale, ab += scale * scale * value, bb += scale * scale * value * value;
    ar += scale * scale * measured, br += scale * scale * value * measured;
  }
  const double determinant = aa * bb - ab * ab;
  double read2 = 0, shot = 0;
  if (determinant > 1e-12 * aa * bb) {
    read2 = (ar * bb - br * ab) / determinant, shot = (aa * br - ab * ar) / determinant;
    if (read2 < 0) read2 = 0, shot = bb > 0 ? br / bb : 0;
    if (shot < 0) shot = 0, read2 = aa > 0 ? ar / aa : 0;
  } else if (aa > 0) {
    read2 = ar / aa;
  }
  // No sensor is better than a millionth of its white; zero would make weights infinite.
  noise.read = std::sqrt(std::max(read2, 1e-12)), noise.shot = std::max(shot, 0.0);
  return noise;
}

}  // namespace patina
