#include "engine/calibration/screen_response.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "engine/calibration/monotone.h"

namespace patina {
namespace {

constexpr std::size_t kFewestValues = 5;
constexpr double kEndsWithin = 0.02;      // of 0 and 1: nearer than that is black and white
constexpr double kChannelsDiffer = 0.02;  // of full white, between the channels' curves
constexpr double kScattered = 0.01;       // of full white, about the curve

}  // namespace

std::vector<double> greyRamp(int count) {
  std::vector<double> values;
  for (int i = 0; i < count; ++i) {
    const double t = count > 1 ? static_cast<double>(i) / (count - 1) : 0;
    // Steps grow from a third of the mean one to 5/3 of it.
    values.push_back(t * (1 + 2 * t) / 3);
  }
  return values;
}

Eigen::Vector3d meanLight(const Image& photo, const PixelRegion& region) {
  PixelRegion r = region;
  if (r.whole()) r = {0, 0, photo.width(), photo.height()};
  r = {std::max(r.x0, 0), std::max(r.y0, 0), std::min(r.x1, photo.width()), std::min(r.y1, photo.height())};
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (int c = 0; c < 3; ++c) {
    std::vector<float> values;
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x) values.push_back(photo.at(x, y, std::min(c, photo.channels() - 1)));
    std::sort(values.begin(), values.end());
    const std::size_t cut = values.size() / 20;
    double sum = 0;
    for (std::size_t i = cut; i + cut < values.size(); ++i) sum += values[i];
    if (values.size() > 2 * cut) mean[c] = sum / static_cast<double>(values.size() - 2 * cut);
  }
  return mean;
}

double ScreenCurve::lightOf(double sent) const {
  return monotoneCubic(value, light, std::clamp(sent, 0.0, 1.0));
}

double ScreenCurve::valueFor(double wantedLight) const {
  // The curve doesn't fall: bisection, to a millionth of the range.
  const double wanted = std::clamp(wantedLight, 0.0, 1.0);
  double low = 0, high = 1;
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (low + high);
    (lightOf(middle) < wanted ? low : high) = middle;
  }
  return high;
}

std::vector<double> ScreenCurve::inverseTable(int entries) const {
  std::vector<double> table;
  for (int i = 0; i < entries; ++i)
    table.push_back(valueFor(static_cast<double>(i) / std::max(1, entries - 1)));
  if (!table.empty()) table.front() = 0;
  return table;
}

Result<ScreenCurve> fitScreenResponse(const std::vector<GreySample>& samples) {
  const auto invalid = [](const std::string& what, const std::string& tryThis) {
    return Error{ErrorCode::Invalid, what, "screen response", tryThis};
  };
  std::map<double, std::pair<Eigen::Vector3d, int>> byValue;
  for (const GreySample& sample : samples) {
    if (!(sample.value >= 0 && sample.value <= 1) || !sample.light.allFinite())
      return invalid("a grey value isn't between 0 and 1, or its light is no number",
                     "values as shares of full white");
    auto [at, added] = byValue.emplace(sample.value, std::pair(sample.light, 1));
    if (!added) at->second.first += sample.light, ++at->second.second;
  }
  if (byValue.size() < kFewestValues)
    return invalid("there are " + std::to_string(byValue.size()) + " grey values, and a curve needs five",
                   "a ramp of 17 or more");
  if (byValue.begin()->first > kEndsWithin || byValue.rbegin()->first < 1 - kEndsWithin)
    return invalid("the ramp doesn't reach from black to white", "a ramp from 0 to 1");
  std::vector<double> value, weight;
  std::vector<Eigen::Vector3d> light;
  for (const auto& [v, sum] : byValue) {
    value.push_back(v);
    light.push_back(sum.first / sum.second);
    weight.push_back(sum.second);
  }
  const Eigen::Vector3d black = light.front(), range = light.back() - black;
  if (!(range.minCoeff() > 0) || !(range.minCoeff() > 0.01 * light.back().maxCoeff()))
    return invalid("white isn't brighter than black in the photographs",
                   "was the ramp on the screen that was photographed? Is the region on it?");
  ScreenCurve response;
  response.value = value;
  std::vector<double> mean;
  for (const Eigen::Vector3d& l : light) {
    const Eigen::Vector3d relative = (l - black).cwiseQuotient(range);
    mean.push_back(relative.mean());
    response.channelSpread = std::max(response.channelSpread, relative.maxCoeff() - relative.minCoeff());
  }
  response.light = isotonic(mean, weight);
  double sum = 0, largest = 0;
  for (std::size_t i = 0; i < mean.size(); ++i) {
    const double off = std::abs(mean[i] - response.light[i]);
    sum += off * off, largest = std::max(largest, off);
  }
  response.residual = std::sqrt(sum / static_cast<double>(mean.size()));
  // The ends are black and white by definition.
  const double first = response.light.front(), last = response.light.back();
  for (double& l : response.light) l = (l - first) / (last - first);
  response.value.front() = 0, response.value.back() = 1;
  response.blackShare = black.cwiseQuotient(light.back()).mean();
  double top = 0, bottom = 0;
  for (std::size_t i = 1; i + 1 < value.size(); ++i) {
    if (!(response.light[i] > 0.003)) continue;
    // Weighted by light: the dark end's logarithms are noise.
    const double lv = std::log(value[i]), ll = std::log(response.light[i]), w = response.light[i];
    top += w * lv * ll, bottom += w * lv * lv;
  }
  if (bottom > 0) response.exponent = top / bottom;
  char text[200];
  if (response.channelSpread > kChannelsDiffer) {
    std::snprintf(text, sizeof text,
                  "the channels' curves differ by %.1f %% of white: greys change colour on this screen; "
                  "prefer threshold frames",
                  100 * response.channelSpread);
    response.warnings.push_back(text);
  }
  if (largest > kScattered) {
    std::snprintf(
        text, sizeof text,
        "the light doesn't always rise with the value (%.1f %% of white): dynamic contrast, or flicker?",
        100 * largest);
    response.warnings.push_back(text);
  }
  return response;
}

int whiteFrames(double value, int frames) {
  int white = 0;
  for (int frame = 0; frame < frames; ++frame) white += value > (frame + 0.5) / frames;
  return white;
}

Image thresholdedFrame(const Image& pattern, int frame, int frames) {
  Image shown(pattern.width(), pattern.height(), 1);
  const double threshold = (frame + 0.5) / frames;
  for (int y = 0; y < pattern.height(); ++y)
    for (int x = 0; x < pattern.width(); ++x) shown.at(x, y) = pattern.at(x, y) > threshold ? 1.0f : 0.0f;
  return shown;
}

}  // namespace patina
