#include "engine/acquire/exposure.h"

#include <algorithm>
#include <cmath>

namespace patina {

double wholeRefreshes(double wantedS, double refreshHz, double leastS, double mostS) {
  const double wanted = std::clamp(wantedS, leastS, mostS);
  if (!(refreshHz > 0)) return wanted;
  // Rounding of the range's ends must not lose a period that just fits.
  constexpr double kSlack = 1e-9;
  const double low = std::max(1.0, std::ceil(leastS * refreshHz - kSlack));
  const double high = std::floor(mostS * refreshHz + kSlack);
  if (high < low) return mostS * refreshHz < 1 ? mostS : wanted;
  return std::clamp(std::round(wanted * refreshHz), low, high) / refreshHz;
}

double exposureFor(const Image& photo, const Image& mask, double takenS, double fill, double percentile,
                   double leastS, double mostS) {
  // Full scale but for what noise takes off it.
  constexpr double kClipped = 0.98;
  std::vector<float> brightest;
  for (int y = 0; y < photo.height(); ++y)
    for (int x = 0; x < photo.width(); ++x) {
      if (!mask.empty() && !(mask.at(x, y) > 0)) continue;
      const std::span<const float> rgb = photo.pixel(x, y);
      brightest.push_back(*std::ranges::max_element(rgb));
    }
  if (brightest.empty()) return std::clamp(takenS, leastS, mostS);
  const auto at = static_cast<std::ptrdiff_t>(percentile * static_cast<double>(brightest.size() - 1));
  std::nth_element(brightest.begin(), brightest.begin() + at, brightest.end());
  const double level = brightest[static_cast<std::size_t>(at)];
  if (level >= kClipped) return std::clamp(takenS / 4, leastS, mostS);
  if (!(level > 0)) return mostS;
  return std::clamp(takenS * fill / level, leastS, mostS);
}

Result<Image> mergeBracket(const std::vector<BracketPhoto>& bracket, double clipsAt, Image* clipped) {
  if (bracket.empty())
    return Error{ErrorCode::Invalid, "there are no exposures to merge", "", "photograph again"};
  const Image& first = bracket.front().photo;
  std::size_t shortest = 0;
  for (std::size_t i = 0; i < bracket.size(); ++i) {
    const Image& photo = bracket[i].photo;
    if (photo.width() != first.width() || photo.height() != first.height() ||
        photo.channels() != first.channels() || !(bracket[i].exposureS > 0))
      return Error{ErrorCode::Invalid, "the exposures of a bracket differ in size, or one has no time", "",
                   "photograph again"};
    if (bracket[i].exposureS < bracket[shortest].exposureS) shortest = i;
  }
  Image merged(first.width(), first.height(), first.channels());
  if (clipped) *clipped = Image(first.width(), first.height(), 1);
  for (int y = 0; y < first.height(); ++y)
    for (int x = 0; x < first.width(); ++x)
      for (int c = 0; c < first.channels(); ++c) {
        double light = 0, time = 0;
        for (const BracketPhoto& one : bracket) {
          const double value = one.photo.at(x, y, c);
          if (value >= clipsAt) continue;
          // Weight: the exposure, times the radiance value / exposure.
          light += value;
          time += one.exposureS;
        }
        if (time > 0) {
          merged.at(x, y, c) = static_cast<float>(light / time);
        } else {
          merged.at(x, y, c) =
              static_cast<float>(bracket[shortest].photo.at(x, y, c) / bracket[shortest].exposureS);
          if (clipped) clipped->at(x, y) = 1;
        }
      }
  return merged;
}

std::vector<double> bracketExposures(double longestS, double ratio, int steps, double leastS) {
  std::vector<double> exposures;
  double next = longestS;
  for (int i = 0; i < steps && next >= leastS; ++i, next /= ratio) exposures.push_back(next);
  if (exposures.empty()) exposures.push_back(leastS);
  return exposures;
}

}  // namespace patina
