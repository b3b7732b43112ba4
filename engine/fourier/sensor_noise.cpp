#include "engine/fourier/sensor_noise.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "engine/fourier/measurement_store.h"
#include "engine/fourier/measurements.h"

namespace patina {
namespace {

constexpr std::size_t kMostSamples = 60'000;  // a group: enough for 1 % of a standard deviation in each bin
constexpr std::size_t kFewestSamples = 200;
constexpr int kBins = 24;
constexpr double kSigmaOverMad = 1.4826;  // of a normal distribution

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

NoiseSamples::NoiseSamples(const std::vector<Eigen::Vector2i>& frequencies, std::size_t siteCount)
    : stride_(std::max<std::size_t>(1, siteCount * 3 / kMostSamples)) {
  for (const auto& frequency : frequencies)
    perFrequency_.push_back(
        {frequency.cast<double>().norm(), std::vector<Sample>((siteCount * 3 + stride_ - 1) / stride_)});
}

void NoiseSamples::add(const SiteBlock& block, const std::vector<std::int32_t>& pixelCount) {
  const std::size_t first = (block.run().first * 3 + stride_ - 1) / stride_;
  for (std::size_t k = first; k * stride_ < block.run().end() * 3; ++k) {
    const std::size_t site = k * stride_ / 3, channel = k * stride_ % 3;
    const float scale = std::sqrt(static_cast<float>(pixelCount[site]));
    const float* sums = block.even(site) + channel;
    for (auto& group : perFrequency_) {
      group.samples[k] = {(sums[0] - sums[3]) * scale, sums[0] + sums[3], true};
      sums += 6;
    }
  }
}

void NoiseSamples::drop(std::size_t site, int frequency) {
  for (std::size_t k = (site * 3 + stride_ - 1) / stride_; k * stride_ < site * 3 + 3; ++k)
    perFrequency_[static_cast<std::size_t>(frequency)].samples[k].kept = false;
}

NoiseModel NoiseSamples::estimate(double fullScale) const {
  double highest = 0;
  for (const auto& group : perFrequency_) highest = std::max(highest, group.frequency);
  std::vector<Sample> samples;
  for (const auto& group : perFrequency_)
    if (group.frequency > 0.6 * highest)
      std::ranges::copy_if(group.samples, std::back_inserter(samples), &Sample::kept);
  NoiseModel fallback{1e-4 * fullScale, 1e-3 * fullScale};
  if (samples.size() < kFewestSamples) return fallback;
  std::ranges::sort(samples, {}, &Sample::brightness);

  // Weighted least squares of variance against brightness; a bin's variance estimate is known to a fixed
  // relative error, so weights are one over its square, iterated from the values themselves to the fitted
  // ones.
  std::vector<double> brightness, variance;
  for (int b = 0; b < kBins; ++b) {
    const std::size_t from = samples.size() * b / kBins, to = samples.size() * (b + 1) / kBins;
    std::vector<double> differences;
    double sum = 0;
    for (std::size_t i = from; i < to; ++i) {
      differences.push_back(std::abs(samples[i].difference));
      sum += samples[i].brightness;
    }
    const double sigma = kSigmaOverMad * median(differences);
    brightness.push_back(sum / static_cast<double>(to - from));
    variance.push_back(sigma * sigma);
  }
  double slope = 0, offset = 0;
  std::vector<double> expected = variance;
  for (int iteration = 0; iteration < 5; ++iteration) {
    double s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
    for (std::size_t i = 0; i < brightness.size(); ++i) {
      const double w = 1 / std::max(expected[i] * expected[i], 1e-30);
      s += w, sx += w * brightness[i], sy += w * variance[i], sxx += w * brightness[i] * brightness[i],
          sxy += w * brightness[i] * variance[i];
    }
    const double det = s * sxx - sx * sx;
    slope = det > 1e-12 * s * sxx ? (s * sxy - sx * sy) / det : 0;
    offset = (sy - slope * sx) / s;
    if (offset < 0) offset = 0, slope = sxy / sxx;  // neither can be negative
    if (slope < 0) slope = 0, offset = sy / s;
    for (std::size_t i = 0; i < brightness.size(); ++i) expected[i] = slope * brightness[i] + offset;
  }
  NoiseModel noise{slope, std::sqrt(offset / 4)};
  // A noiseless capture (a rendering) still has quantisation; never weight by infinity.
  noise.read = std::max(noise.read, 1e-6 * fullScale);
  return noise;
}

}  // namespace patina
