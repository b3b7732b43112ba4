#pragma once

#include <array>

namespace patina {

/// The grids of cubic splines over a screen, each half as coarse as the one before. In pattern units; the
/// screen is 2 pi wide.
inline constexpr double kCoarsestSpacing = 0.25;
/// Spacing 0.0039: about a pixel of a full-HD screen; finer patterns don't exist there.
inline constexpr int kFinestLevel = 6;

inline double spacingOf(int level) {
  return kCoarsestSpacing / static_cast<double>(1 << level);
}

/// The four cubic B-splines that touch a point at `t` in 0..1 between nodes 1 and 2 of the four.
inline std::array<float, 4> cubicBasis(double t) {
  const double s = 1 - t;
  return {static_cast<float>(s * s * s / 6), static_cast<float>((3 * t * t * t - 6 * t * t + 4) / 6),
          static_cast<float>((3 * s * s * s - 6 * s * s + 4) / 6), static_cast<float>(t * t * t / 6)};
}

}  // namespace patina
