#pragma once

#include <Eigen/Core>
#include <array>
#include <complex>

#include "engine/fourier/fit.h"
#include "engine/fourier/site_geometry.h"

namespace patina {

/// The specular lobe of one site as the fit sees it: two Gaussians on the screen for unit albedo, each
/// weighted one half already, and a third where SiteGeometry::lobe has one (else without mass). Frame:
/// pattern coordinates x (not relative to the foot).
struct SiteLobe {
  struct Gaussian {
    float mass = 0, meanX = 0, meanY = 0, xx = 1, xy = 0, yy = 1;
    float lit = 1;                                  ///< share of the mass on the lit area
    std::array<float, 4> third = {0, 0, 0, 0};      ///< cumulants xxx, xxy, xyy, yyy
    std::array<float, 5> fourth = {0, 0, 0, 0, 0};  ///< cumulants xxxx, xxxy, xxyy, xyyy, yyyy
  };
  std::array<Gaussian, 3> gaussian;

  /// Transform at `frequency` (equation 11's second sum, unit albedo).
  std::complex<float> transform(const Eigen::Vector2f& frequency) const;
};

/// Evaluates the lobe's Gaussians in double precision, with the same text as the solver.
SiteLobe siteLobe(const ScreenFrame& frame, const SiteGeometry& site, const SvbrdfParameters& parameters,
                  LobeMapping mapping);

/// Where the mirror direction meets the screen, pattern coordinates (clamped to a cone of 80 degrees about
/// the perpendicular).
Eigen::Vector2f mirrorOnScreen(const ScreenFrame& frame, const SiteGeometry& site,
                               const Eigen::Vector3f& normal);

/// The normal (world) in the screen's frame.
inline Eigen::Vector3f normalOnScreen(const ScreenFrame& frame, const Eigen::Vector3f& normal) {
  return (frame.screenFromWorld * normal.cast<double>()).cast<float>();
}

/// Radiance of the photograph with pattern w(x) max(0, sin(frequency . x + phase pi/2)), black level not
/// included, given the transform of f' at multiples 0, 1, 2, 4, 6, ... of the frequency: the half-wave
/// rectified sine's Fourier series
///   max(0, sin t) = 1/pi + sin(t)/2 - 2/pi sum_m cos(2 m t) / (4 m^2 - 1).
/// `harmonics[0]` is F(0), [1] F(w), [1 + m] F(2 m w).
inline constexpr int kEvenHarmonics = 8;
float patternRadiance(const std::array<std::complex<float>, 2 + kEvenHarmonics>& harmonics, int phase);

}  // namespace patina
