#include "engine/calibration/hdr_merge.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <limits>

namespace patina {
namespace {

constexpr int kReweightings = 3;    // the variance at the merged radiance settles at once
constexpr double kSafety = 3;       // a value within so many standard deviations of clipping may have clipped
constexpr double kMismatch = 0.03;  // between exposures: shutters are good to 1 or 2 %

struct Sample {
  double radiance = 0, relativeSd = 0;
  bool clipped = false, dark = false;
};

/// `photos` by exposure, shortest first.
Sample merge(const std::vector<const ExposedPhoto*>& photos, const MergeOptions& options, std::size_t at,
             double black) {
  Sample sample;
  const double edge = options.saturation - black;
  const double margin = kSafety * std::sqrt(options.shot * std::max(edge, 0.0) + options.read * options.read);
  const auto value = [&](const ExposedPhoto& photo) { return photo.image.samples()[at] - black; };
  double radiance = 0, time = 0;
  const ExposedPhoto* shortest = nullptr;  // of those that aren't clipped
  for (const ExposedPhoto* photo : photos) {
    if (value(*photo) >= edge) continue;
    if (!shortest) shortest = photo;
    radiance += value(*photo), time += photo->exposureS;
  }
  if (!shortest) {
    sample.clipped = true;
    sample.radiance = std::max(edge, value(*photos.front())) / photos.front()->exposureS;
    sample.relativeSd = std::numeric_limits<double>::infinity();
    return sample;
  }
  radiance /= time;
  double weights = 0;
  for (int pass = 0; pass < kReweightings; ++pass) {
    double sum = 0;
    weights = 0;
    for (const ExposedPhoto* photo : photos) {
      const double v = value(*photo), t = photo->exposureS, expected = radiance * t;
      // Near the edge only the values that noise made small are left, so they don't count; except where there
      // is no other.
      if (v >= edge || (expected > edge - margin && photo != shortest)) continue;
      const double w = t * t / (options.shot * std::max(expected, 0.0) + options.read * options.read);
      sum += w * v / t, weights += w;
    }
    radiance = sum / weights;
  }
  const double sd = 1 / std::sqrt(weights);
  sample.radiance = radiance;
  sample.relativeSd = sd / std::max(radiance, sd);
  sample.dark = radiance < options.darkSigmas * sd;
  return sample;
}

}  // namespace

Result<MergedRadiance> mergeExposures(const std::vector<ExposedPhoto>& photos, const MergeOptions& options,
                                      const JobContext& job) {
  const auto invalid = [](const std::string& what, const std::string& where, const std::string& tryThis) {
    return Error{ErrorCode::Invalid, what, where, tryThis};
  };
  if (photos.empty()) return invalid("there are no photographs to merge", "", "");
  const Image& first = photos[0].image;
  if (const Status usable = checkExposures(photos); !usable) return usable.error();
  if (!(options.read > 0 && options.shot >= 0 && options.saturation > 0))
    return invalid("noise and saturation must be positive", "merge options", "");
  std::vector<const ExposedPhoto*> ordered;
  for (const ExposedPhoto& photo : photos) ordered.push_back(&photo);
  std::stable_sort(ordered.begin(), ordered.end(),
                   [](const auto* a, const auto* b) { return a->exposureS < b->exposureS; });
  MergedRadiance result;
  result.radiance = Image(first.width(), first.height(), 3);
  result.relativeSd = Image(first.width(), first.height(), 3);
  std::atomic<std::size_t> clipped{0}, dark{0};
  tbb::parallel_for(tbb::blocked_range<int>(0, first.height()), [&](const tbb::blocked_range<int>& range) {
    if (job.cancelled()) return;
    std::size_t clippedHere = 0, darkHere = 0;
    for (int y = range.begin(); y < range.end(); ++y)
      for (int x = 0; x < first.width(); ++x)
        for (int c = 0; c < 3; ++c) {
          const std::size_t at = (static_cast<std::size_t>(y) * first.width() + x) * 3 + c;
          const Sample sample = merge(ordered, options, at, options.blackLevel[c]);
          result.radiance.samples()[at] = static_cast<float>(sample.radiance);
          result.relativeSd.samples()[at] = static_cast<float>(sample.relativeSd);
          clippedHere += sample.clipped, darkHere += sample.dark;
        }
    clipped += clippedHere, dark += darkHere;
  });
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "the merge was cancelled", "", ""};
  result.clipped = clipped, result.dark = dark;

  // Each exposure against the next longer one where both speak well; what sticks out from the chain is wrong.
  std::vector<double> chain{0};
  for (std::size_t j = 1; j < ordered.size(); ++j) {
    std::vector<double> ratio;
    const std::size_t step = std::max<std::size_t>(1, first.samples().size() / 30000);
    for (std::size_t at = 0; at < first.samples().size(); at += step) {
      const double black = options.blackLevel[static_cast<int>(at % 3)];
      const double a = ordered[j - 1]->image.samples()[at] - black,
                   b = ordered[j]->image.samples()[at] - black;
      // Judged by the longer one alone: choosing by the shorter one's own noise would favour its bright ones.
      const double expected = b * ordered[j - 1]->exposureS / ordered[j]->exposureS;
      if (b + black < 0.9 * options.saturation && a > 0 &&
          expected > 10 * std::sqrt(options.shot * std::max(expected, 0.0) + options.read * options.read))
        ratio.push_back(std::log(expected / a));
    }
    const auto middle = ratio.begin() + static_cast<std::ptrdiff_t>(ratio.size() / 2);
    if (ratio.size() >= 20) std::nth_element(ratio.begin(), middle, ratio.end());
    chain.push_back(chain.back() + (ratio.size() >= 20 ? *middle : 0));
  }
  std::vector<double> sorted = chain;
  std::sort(sorted.begin(), sorted.end());
  result.mismatch.assign(photos.size(), 0);
  for (std::size_t j = 0; j < ordered.size(); ++j) {
    const double off = std::expm1(chain[j] - sorted[sorted.size() / 2]);
    result.mismatch[static_cast<std::size_t>(ordered[j] - photos.data())] = off;
    if (std::abs(off) > kMismatch) {
      char text[200];
      std::snprintf(text, sizeof text,
                    "%.80s is %.1f %% %s than its exposure says: is the time right, did the light change?",
                    ordered[j]->name.c_str(), 100 * std::abs(off), off > 0 ? "brighter" : "darker");
      result.warnings.push_back(text);
    }
  }
  return result;
}

}  // namespace patina
