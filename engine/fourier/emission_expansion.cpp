#include "engine/fourier/emission_expansion.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/fourier/point_model.h"

namespace patina {
namespace {

constexpr double kReach = std::numbers::sqrt3;              // the rule's outer nodes, in standard deviations
constexpr double kSmallestHalf = 0.02, kLargestHalf = 2.0;  // pattern units; the screen is 2 pi wide

/// Where the lobe lies on the screen: mean, standard deviations and correlation.
struct Footprint {
  double mean[2], sd[2], correlation;
};

Footprint footprintOf(const ScreenFrame& frame, const SiteGeometry& site,
                      const SvbrdfParameters& parameters) {
  SvbrdfParameters lobeOf = parameters;
  lobeOf.sigma = std::clamp(parameters.sigma, 0.005f, 0.5f);  // a site that failed may say anything
  const SiteLobe lobe = siteLobe(frame, site, lobeOf, LobeMapping::ExactMoments);
  double mass = 0, mean[2] = {0, 0}, xx = 0, xy = 0, yy = 0;
  for (const auto& g : lobe.gaussian)
    mass += g.mass, mean[0] += static_cast<double>(g.mass) * g.meanX,
        mean[1] += static_cast<double>(g.mass) * g.meanY;
  const bool usable = mass > 0 && std::isfinite(mass) && std::isfinite(mean[0]) && std::isfinite(mean[1]);
  if (!usable) {
    const Eigen::Vector2f mirror = mirrorOnScreen(frame, site, parameters.normal);
    return {{mirror.x(), mirror.y()}, {0.1, 0.1}, 0};
  }
  for (auto& m : mean) m /= mass;
  for (const auto& g : lobe.gaussian) {
    const double share = g.mass / mass, x = g.meanX - mean[0], y = g.meanY - mean[1];
    xx += share * (g.xx + x * x), xy += share * (g.xy + x * y), yy += share * (g.yy + y * y);
  }
  const double sd[2] = {std::sqrt(std::max(xx, 1e-8)), std::sqrt(std::max(yy, 1e-8))};
  return {{mean[0], mean[1]}, {sd[0], sd[1]}, std::clamp(xy / (sd[0] * sd[1]), -0.95, 0.95)};
}

}  // namespace

EmissionExpansion expandEmission(const ScreenFrame& frame, const SiteGeometry& site,
                                 const SvbrdfParameters& parameters, LobeMapping mapping) {
  Footprint at = footprintOf(frame, site, parameters);
  // Beyond the lit area there is no light, and what the function says there means nothing.
  for (int k = 0; k < 2; ++k) {
    const double edge = frame.halfExtent[k],
                 half = std::clamp(kReach * at.sd[k], kSmallestHalf, kLargestHalf);
    const double low = std::clamp(at.mean[k] - half, -edge, edge - kSmallestHalf),
                 high = std::clamp(at.mean[k] + half, low + kSmallestHalf, edge);
    at.mean[k] = 0.5 * (low + high);
    at.sd[k] = 0.5 * (high - low) / kReach;
  }
  const double across = std::sqrt(1 - at.correlation * at.correlation);
  const Eigen::Vector2d foot(site.footX, site.footY);
  // Weighted least squares in units of the standard deviations: 1, u, v, u^2, v^2, u v.
  using Terms = Eigen::Matrix<double, 6, 1>;
  Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
  Terms right = Terms::Zero();
  const double mixed = mapping == LobeMapping::ExactMoments ? 1 : 0;
  for (int i = -1; i <= 1; ++i) {
    for (int j = -1; j <= 1; ++j) {
      const double u = kReach * i, v = at.correlation * u + across * kReach * j;
      const double weight = (i == 0 ? 4.0 : 1.0) * (j == 0 ? 4.0 : 1.0) / 36;
      const double value =
          frame.logEmission({at.mean[0] + at.sd[0] * u, at.mean[1] + at.sd[1] * v}, foot, site.distance);
      const Terms row{1, u, v, u * u, v * v, mixed * u * v};
      normal += weight * row * row.transpose();
      right += weight * value * row;
    }
  }
  normal(5, 5) += 1 - mixed;  // without it, it is zero
  const Terms found = normal.ldlt().solve(right);
  EmissionExpansion out;
  out.value = static_cast<float>(found[0]);
  for (int k = 0; k < 2; ++k) {
    out.centre[k] = static_cast<float>(at.mean[k]);
    out.slope[k] = static_cast<float>(found[1 + k] / at.sd[k]);
    out.curve[k] = static_cast<float>(2 * found[3 + k] / (at.sd[k] * at.sd[k]));
  }
  out.mixed = static_cast<float>(found[5] / (at.sd[0] * at.sd[1]));
  if (!found.allFinite()) return {};
  return out;
}

}  // namespace patina
