#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "devices/simulated/simulated_effects.h"

namespace patina {

/// Mean of |sin| over a cell as a function of sin at its centre. Away from a zero crossing |sin| is a sine
/// again and its mean is exactly sinc sinc |sin|; across one, the cell's mean of |u| for u linear in the cell
/// (error below (w h)^3 / 6).
class RectifiedMean {
 public:
  /// phaseX, phaseY: how far the sine's argument moves across a cell, radians.
  RectifiedMean(double phaseX, double phaseY) {
    const double a = std::abs(phaseX), b = std::abs(phaseY);
    attenuation_ = static_cast<float>(sinc(0.5 * a) * sinc(0.5 * b));
    const double reach = 0.5 * (a + b);
    edge_ = static_cast<float>(std::sin(std::min(reach, 0.5 * std::numbers::pi)));
    for (int i = 0; i <= kSamples; ++i)
      bump_[static_cast<std::size_t>(i)] = static_cast<float>(meanAbs(reach * i / kSamples, a, b));
    toIndex_ = edge_ > 0 ? kSamples / edge_ : 0.0f;
  }
  float operator()(float sine) const {
    const float size = std::abs(sine);
    if (size >= edge_) return attenuation_ * size;
    const float position = size * toIndex_;
    const int index = std::min(static_cast<int>(position), kSamples - 1);
    const float t = position - static_cast<float>(index);
    return bump_[static_cast<std::size_t>(index)] * (1 - t) + bump_[static_cast<std::size_t>(index) + 1] * t;
  }

 private:
  static double sinc(double x) { return std::abs(x) < 1e-6 ? 1.0 : std::sin(x) / x; }
  /// Mean of |d + a r + b s| for r, s uniform in -1/2 to 1/2.
  static double meanAbs(double d, double a, double b) {
    if (a < b) std::swap(a, b);
    const auto once = [](double u) { return 0.5 * u * std::abs(u); };       // antiderivative of |u|
    const auto twice = [](double u) { return u * u * std::abs(u) / 6.0; };  // and its own
    if (a < 1e-9) return std::abs(d);
    if (b < 1e-6 * a)
      return (once(d + 0.5 * a) - once(d - 0.5 * a)) / a;  // below that the difference loses its digits
    return (twice(d + 0.5 * (a + b)) - twice(d + 0.5 * (a - b)) - twice(d - 0.5 * (a - b)) +
            twice(d - 0.5 * (a + b))) /
           (a * b);
  }
  static constexpr int kSamples = 128;
  float attenuation_ = 1, edge_ = 0, toIndex_ = 0;
  std::array<float, kSamples + 1> bump_{};
};

/// What the panel shows where a value in 0 to 1 is asked for: the value to the power gamma. A table, as it is
/// asked some hundred million times; its linear steps are wrong by less than 1e-4 above a hundredth.
class ShownValue {
 public:
  explicit ShownValue(double gamma) {
    if (gamma == 1) return;
    table_.resize(kSteps + 2);
    for (int i = 0; i <= kSteps + 1; ++i)
      table_[static_cast<std::size_t>(i)] =
          static_cast<float>(std::pow(static_cast<double>(i) / kSteps, gamma));
  }
  float operator()(float asked) const {
    const float position = std::clamp(asked, 0.0f, 1.0f) * kSteps;
    const auto index = static_cast<std::size_t>(position);
    const float t = position - static_cast<float>(index);
    return table_[index] * (1 - t) + table_[index + 1] * t;
  }

 private:
  static constexpr int kSteps = 4096;
  std::vector<float> table_;
};

/// The backlight at a place of the screen over that at its centre. half: the screen's half extent.
inline double backlight(const SimulatedEffects& effects, const Eigen::Vector2d& half, double x, double y) {
  const SimulatedEffects::EmissionSpatial& effect = effects.emissionSpatial;
  const double angle = effect.gradientAngleDeg * std::numbers::pi / 180;
  const double corner = (x * x + y * y) / half.squaredNorm();
  const double along = (x * std::cos(angle) + y * std::sin(angle)) / half.x();
  return (1 - effect.edges * corner) * (1 + effect.gradient * along);
}

}  // namespace patina
