#include "engine/fourier/point_model.h"

#include <cmath>
#include <numbers>

namespace patina {
namespace {

inline double vexp(double x) {
  return std::exp(x);
}
inline double vsqrt(double x) {
  return std::sqrt(x);
}
inline double vinv(double x) {
  return 1 / x;
}
inline double vrsqrt(double x) {
  return 1 / std::sqrt(x);
}
inline double vmax(double a, double b) {
  return a > b ? a : b;
}
inline double vmin(double a, double b) {
  return a < b ? a : b;
}

#include "engine/fourier/lobe_kernel.inc"

LobeSite<double> lobeSite(const SiteGeometry& site) {
  const LobeShape shape = lobeShape(site.lobe);
  return {site.distance,   site.viewX,           site.viewY,           site.viewZ,     site.lightMeanX,
          site.lightMeanY, site.lightPrecisionX, site.lightPrecisionY, site.lightPeak, site.lightPrecisionXY,
          shape.along,     shape.mixed,          shape.across};
}

}  // namespace

std::complex<float> SiteLobe::transform(const Eigen::Vector2f& w) const {
  std::complex<float> sum = 0;
  for (const auto& g : gaussian) {
    const float decay = 0.5f * (w.x() * w.x() * g.xx + 2 * w.x() * w.y() * g.xy + w.y() * w.y() * g.yy);
    if (decay > 25.0f) continue;  // 1e-11 of the peak
    const float x = w.x(), y = w.y();
    const float skew =
        (x * x * (x * g.third[0] + 3 * y * g.third[1]) + y * y * (3 * x * g.third[2] + y * g.third[3])) / 6;
    const float bend =
        std::clamp((x * x * x * (x * g.fourth[0] + 4 * y * g.fourth[1]) + 6 * x * x * y * y * g.fourth[2] +
                    y * y * y * (4 * x * g.fourth[3] + y * g.fourth[4])) /
                       24,
                   -kMostBend, kMostBend);
    // The tails beyond the rim count at the zero frequency and cancel at whole ones.
    const float lit = 1 - (1 - g.lit) * std::max(0.0f, 1 - w.norm());
    sum += std::polar(lit * g.mass * std::exp(-decay) * (1 + bend), skew - (x * g.meanX + y * g.meanY));
  }
  return sum;
}

SiteLobe siteLobe(const ScreenFrame& frame, const SiteGeometry& site, const SvbrdfParameters& parameters,
                  LobeMapping mapping) {
  float rows[3][3];
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < 3; ++j) rows[k][j] = static_cast<float>(frame.screenFromWorld(j, k));
  const Eigen::Vector3d n = parameters.normal.cast<double>();
  const double slopeX = n.x() / n.z(), slopeY = n.y() / n.z();
  const NormalFrame<double> normal = normalFromSlopes(slopeX, slopeY, rows);
  const double gamma = std::max(1.0, static_cast<double>(parameters.kurtosis));
  const double scale = parameters.sigma * std::sqrt(2 / (1 / (gamma * gamma) + gamma * gamma));
  SiteLobe lobe;
  const bool exact = mapping == LobeMapping::ExactMoments;
  const double thirdShare = exact ? site.lobe.thirdShare : 0;
  const bool shaped = site.lobe.stretched() || site.lightPrecisionXY != 0;
  for (int l = 0; l < (thirdShare > 0 ? 3 : 2); ++l) {
    const double width = l == 0   ? scale / gamma
                         : l == 1 ? scale * gamma
                                  : static_cast<double>(parameters.sigma) * site.lobe.thirdRatio;
    const double weight = l < 2 ? 0.5 * (1 - thirdShare) : thirdShare;
    const auto m = !exact   ? lobeMomentsPaper(lobeSite(site), slopeX, slopeY, width, rows)
                   : shaped ? lobeMoments<kShapedLobe>(lobeSite(site), normal, width)
                            : lobeMoments(lobeSite(site), normal, width);
    auto& g = lobe.gaussian[static_cast<std::size_t>(l)];
    g = {static_cast<float>(weight * m.mass),
         static_cast<float>(m.meanX + site.footX),
         static_cast<float>(m.meanY + site.footY),
         static_cast<float>(m.xx),
         static_cast<float>(m.xy),
         static_cast<float>(m.yy),
         1.0f,
         {},
         {}};
    for (int t = 0; t < 4; ++t) g.third[t] = static_cast<float>(m.third[t]);
    for (int t = 0; t < 5; ++t) g.fourth[t] = static_cast<float>(m.fourth[t]);
    if (mapping == LobeMapping::ExactMoments)
      g.lit = static_cast<float>(
          litFraction(m, static_cast<double>(site.footX), static_cast<double>(site.footY),
                      static_cast<float>(frame.halfExtent.x()), static_cast<float>(frame.halfExtent.y()))
              .value);
  }
  return lobe;
}

Eigen::Vector2f mirrorOnScreen(const ScreenFrame& frame, const SiteGeometry& site,
                               const Eigen::Vector3f& normal) {
  const Eigen::Vector3d local = frame.screenFromWorld * normal.cast<double>();
  const double n[3] = {local.x(), local.y(), local.z()};
  double x = 0, y = 0;
  mirrorPoint(lobeSite(site), n, x, y);
  return {static_cast<float>(x + site.footX), static_cast<float>(y + site.footY)};
}

float patternRadiance(const std::array<std::complex<float>, 2 + kEvenHarmonics>& harmonics, int phase) {
  // integral of f' sin(w x + k pi/2) = Im(i^k conj F(w))
  const std::complex<float> turned =
      std::conj(harmonics[1]) * std::array<std::complex<float>, 4>{{{1, 0}, {0, 1}, {-1, 0}, {0, -1}}}[phase];
  constexpr float kPi = std::numbers::pi_v<float>;
  float sum = harmonics[0].real() / kPi + 0.5f * turned.imag();
  for (int m = 1; m <= kEvenHarmonics; ++m) {
    const float sign = (m * phase) % 2 ? -1.0f : 1.0f;
    sum -= 2 / kPi * sign * harmonics[1 + m].real() / static_cast<float>(4 * m * m - 1);
  }
  return sum;
}

}  // namespace patina
