#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "tests/fourier/rig.h"

namespace patina::test {

using Complex = std::complex<double>;

/// Integral over the lit rectangle, midpoint rule, of a microfacet lobe (density of half-vector slopes, unit
/// shadowing, Schlick F0 = 0.06) times cosine, solid angle, window and emission, times exp(-i w x).
/// Everything from directions; albedo 1. `logEmission`: of a factor on the emission, as FourierCorrections
/// has it. `terms`: what the lobe has beyond the standard model.
inline std::vector<Complex> bruteForce(const Rig& rig, const Eigen::Vector3d& pointMm,
                                       const SvbrdfParameters& p,
                                       const std::vector<Eigen::Vector2d>& frequencies, int steps,
                                       const decltype(ScreenFrame::logEmission)& logEmission = {},
                                       const LobeTerms& terms = {}) {
  const Screen& screen = rig.screen;
  const Eigen::Vector3d n = p.normal.cast<double>().normalized(),
                        toView = (rig.cameraMm - pointMm).normalized();
  const double gamma = p.kurtosis, c = std::sqrt(2 / (1 / (gamma * gamma) + gamma * gamma));
  const double sigmas[3] = {c * p.sigma / gamma, c * p.sigma * gamma,
                            static_cast<double>(p.sigma) * terms.thirdRatio};
  const double shares[3] = {0.5 * (1 - terms.thirdShare), 0.5 * (1 - terms.thirdShare), terms.thirdShare};
  // The direction that the lobe is stretched along, and by how much.
  const double angle = 0.5 * std::atan2(terms.stretch[1], terms.stretch[0]),
               ratio = std::exp(std::hypot(terms.stretch[0], terms.stretch[1]));
  const Eigen::Vector3d east = (Eigen::Vector3d::UnitX() - n.x() * n).normalized(), north = n.cross(east),
                        along = std::cos(angle) * east + std::sin(angle) * north, across = n.cross(along);
  std::vector<Complex> sum(frequencies.size());
  const double hx = screen.halfExtent().x(), hy = screen.halfExtent().y();
  const double cell = (2 * hx / steps) * (2 * hy / steps) * screen.unitMm() * screen.unitMm();  // mm^2
  const Eigen::Vector3d screenNormal = screen.worldFromScreen.col(2);
  for (int j = 0; j < steps; ++j) {
    for (int i = 0; i < steps; ++i) {
      const Eigen::Vector2d x(hx * (2 * (i + 0.5) / steps - 1), hy * (2 * (j + 0.5) / steps - 1));
      const Eigen::Vector3d onScreen =
          screen.originMm + screen.worldFromScreen * Eigen::Vector3d(x.x(), x.y(), 0) * screen.unitMm();
      const Eigen::Vector3d gap = onScreen - pointMm;
      const double distance = gap.norm();
      const Eigen::Vector3d toLight = gap / distance, half = (toLight + toView).normalized();
      const double nl = n.dot(toLight), nv = n.dot(toView), nh = n.dot(half);
      if (nl <= 0) continue;
      const double slopeAlong = half.dot(along) / nh, slopeAcross = half.dot(across) / nh;
      const double slope2 = slopeAlong * slopeAlong / ratio + slopeAcross * slopeAcross * ratio;
      double density = 0;
      for (int l = 0; l < 3; ++l)
        density += shares[l] * std::exp(-slope2 / (2 * sigmas[l] * sigmas[l])) /
                   (2 * std::numbers::pi * sigmas[l] * sigmas[l]);
      const double fresnel = (0.06 + 0.94 * std::pow(1 - toLight.dot(half), 5)) / 0.06;
      const double brdf = density / std::pow(nh, 4) * fresnel / (4 * nl * nv);
      // emission: what an eye at unit distance in front of the centre sees at the point with the same
      // direction
      const double height = -gap.dot(screenNormal) / screen.unitMm();
      const Eigen::Vector2d foot =
          (screen.worldFromScreen.leftCols<2>().transpose() * (pointMm - screen.originMm)) / screen.unitMm();
      const Eigen::Array2d q =
          ((x - foot) / height - screen.emission->mean).array() / screen.emission->sigma.array();
      const Eigen::Array2d w = x.array() / screen.windowSigma.array();
      double light = screen.emission->gain * std::exp(-0.5 * (q.square().sum() + w.square().sum()));
      if (logEmission) light *= std::exp(logEmission(x, foot, height));
      const double cosScreen = -toLight.dot(screenNormal);
      const double value = brdf * nl * light * cosScreen / (distance * distance) * cell;
      for (std::size_t f = 0; f < frequencies.size(); ++f)
        sum[f] += value * std::polar(1.0, -frequencies[f].dot(x));
    }
  }
  return sum;
}

}  // namespace patina::test
