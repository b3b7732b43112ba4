#include "engine/fourier/photo_correction.h"

#include <Eigen/LU>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

namespace patina {
namespace {

// A float's exponent and its leading eight bits of mantissa number the table's steps.
constexpr int kShift = 15;
constexpr float kLeast = 0x1p-20f, kMost = 0x1p12f;
constexpr std::uint32_t keyOf(float x) {
  return std::bit_cast<std::uint32_t>(x) >> kShift;
}
constexpr std::uint32_t kFirst = keyOf(kLeast), kSteps = keyOf(kMost) - kFirst;

/// Value of a table's segment at x.
float between(const std::vector<float>& x, const std::vector<float>& y, std::size_t segment, float at) {
  const float width = x[segment + 1] - x[segment];
  const float share = width > 0 ? (at - x[segment]) / width : 0.0f;
  return y[segment] + share * (y[segment + 1] - y[segment]);
}

}  // namespace

ToneTable::ToneTable(std::function<float(float)> function) : function_(std::move(function)) {
  if (!function_) return;
  // -kMost .. -kLeast, then kLeast .. kMost
  for (std::uint32_t k = 0; k <= kSteps; ++k)
    argument_.push_back(-std::bit_cast<float>((kFirst + kSteps - k) << kShift));
  for (std::uint32_t k = 0; k <= kSteps; ++k)
    argument_.push_back(std::bit_cast<float>((kFirst + k) << kShift));
  value_.reserve(argument_.size());
  for (const float x : argument_) {
    const float y = function_(x);
    // Rounding may turn a step around; what searches the table needs it to ascend.
    value_.push_back(value_.empty() ? y : std::max(y, value_.back()));
  }
  // The inverse at the same steps: both sequences ascend, so one walk finds every segment.
  inverse_.reserve(argument_.size());
  std::size_t segment = 0;
  for (const float y : argument_) {
    while (segment + 2 < value_.size() && value_[segment + 1] < y) ++segment;
    const float rise = value_[segment + 1] - value_[segment];
    const float share = rise > 0 ? std::clamp((y - value_[segment]) / rise, 0.0f, 1.0f) : 0.0f;
    inverse_.push_back(argument_[segment] + share * (argument_[segment + 1] - argument_[segment]));
  }
}

namespace {

/// The table's segment that |x| < kMost lies in.
std::size_t segmentOf(float x) {
  const float size = std::abs(x);
  if (size < kLeast) return kSteps;  // through zero
  const std::size_t step = keyOf(size) - kFirst;
  return x > 0 ? kSteps + 1 + step : kSteps - 1 - step;
}

}  // namespace

float ToneTable::operator()(float x) const {
  if (!(std::abs(x) < kMost)) return function_(x);
  return between(argument_, value_, segmentOf(x), x);
}

ToneTable::Inverse ToneTable::inverse(float y) const {
  // Beyond the table, its last segment's value: no photograph is that bright.
  const float inside = std::clamp(y, -kMost * 0.999f, kMost * 0.999f);
  const std::size_t segment = segmentOf(inside);
  const float slope =
      (inverse_[segment + 1] - inverse_[segment]) / (argument_[segment + 1] - argument_[segment]);
  return {inverse_[segment] + slope * (inside - argument_[segment]), slope};
}

PhotoCorrection::PhotoCorrection(const FourierCorrections& corrections, const FourierCapture& capture)
    : linear_(corrections.linearFromPhoto),
      unmix_(corrections.unmix),
      mix_(corrections.unmix.inverse()),
      offset_(corrections.photoOffset),
      gain_(corrections.photoGain),
      saturation_(corrections.saturation),
      mixes_(corrections.unmix != Eigen::Matrix3f::Identity()) {
  // Photographs beyond the lists have none; a black one has no light that a gain could act on.
  const std::size_t count = capture.photos.size();
  if (!offset_.empty()) offset_.resize(count, Eigen::Array3f::Zero());
  if (!gain_.empty()) gain_.resize(count, 1.0f);
  for (std::size_t i = 0; i < gain_.size(); ++i)
    if (capture.photos[i].role == PhotoRole::Black) gain_[i] = 1;
  const auto none = [](const Eigen::Array3f& offset) { return (offset == 0).all(); };
  if (std::ranges::all_of(offset_, none)) offset_.clear();
  if (std::ranges::all_of(gain_, [](float gain) { return gain == 1; })) gain_.clear();
  active_ = !linear_.empty() || mixes_ || !offset_.empty() || !gain_.empty();
}

void PhotoCorrection::undo(int photo, float* rgb) const {
  Eigen::Map<Eigen::Array3f> value(rgb);
  if (!linear_.empty())
    for (int c = 0; c < 3; ++c) value[c] = linear_(value[c]);
  if (mixes_) value = (unmix_ * value.matrix()).array().eval();
  if (!offset_.empty()) value -= offset_[static_cast<std::size_t>(photo)];
  if (!gain_.empty()) value /= gain_[static_cast<std::size_t>(photo)];
}

PhotoCorrection::Recorded PhotoCorrection::record(int photo, const Eigen::Array3f& rgb,
                                                  const Eigen::Array3f& black) const {
  const float gain = gain_.empty() ? 1.0f : gain_[static_cast<std::size_t>(photo)];
  Recorded out{black + gain * (rgb - black), gain * Eigen::Matrix3f::Identity()};
  if (!offset_.empty()) out.value += offset_[static_cast<std::size_t>(photo)];
  if (mixes_) {
    out.value = (mix_ * out.value.matrix()).array().eval();
    out.derivative = gain * mix_;
  }
  if (!linear_.empty()) {
    for (int c = 0; c < 3; ++c) {
      const auto inverse = linear_.inverse(out.value[c]);
      out.value[c] = inverse.x;
      out.derivative.row(c) *= inverse.slope;
    }
  }
  return out;
}

}  // namespace patina
