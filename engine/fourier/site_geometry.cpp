#include "engine/fourier/site_geometry.h"

#include <algorithm>
#include <cmath>

namespace patina {

ScreenFrame::ScreenFrame(const Screen& screen)
    : unitMm(screen.unitMm()),
      screenFromWorld(screen.worldFromScreen.transpose()),
      originUnits(screen.originMm / screen.unitMm()),
      halfExtent(screen.halfExtent()),
      windowPrecision(screen.windowSigma.cwiseProduct(screen.windowSigma).cwiseInverse()) {
  if (screen.emission) {
    emissionMean = screen.emission->mean;
    emissionPrecision = screen.emission->sigma.cwiseProduct(screen.emission->sigma).cwiseInverse();
    emissionGain = screen.emission->gain;
  }
}

LobeShape lobeShape(const LobeTerms& terms) {
  // exp of a traceless symmetric matrix A: cosh |A| + sinh |A| / |A| A
  const double a = terms.stretch[0], b = terms.stretch[1], size = std::hypot(a, b);
  if (size == 0) return {};
  const double share = std::sinh(size) / size;
  return {static_cast<float>(std::cosh(size) - share * a), static_cast<float>(-share * b),
          static_cast<float>(std::cosh(size) + share * a)};
}

SiteGeometry siteGeometry(const ScreenFrame& frame, const Eigen::Vector3d& pointMm,
                          const Eigen::Vector3d& cameraMm, const EmissionExpansion* expansion) {
  const Eigen::Vector3d local = frame.screenFromWorld * (pointMm / frame.unitMm - frame.originUnits);
  const Eigen::Vector3d view = (frame.screenFromWorld * (cameraMm - pointMm)).normalized();
  SiteGeometry site;
  site.footX = static_cast<float>(local.x());
  site.footY = static_cast<float>(local.y());
  site.distance = static_cast<float>(local.z());
  site.viewX = static_cast<float>(view.x());
  site.viewY = static_cast<float>(view.y());
  site.viewZ = static_cast<float>(view.z());

  // Product of the window (mean -foot in x') and the emission Gaussian (mean d m, standard deviation d s).
  double peak = frame.emissionGain;
  double mean[2], precision[2];
  for (int k = 0; k < 2; ++k) {
    const double window = frame.windowPrecision[k];
    const double emission = frame.emissionPrecision[k] / (local.z() * local.z());
    const double windowMean = -local[k];
    const double emissionMean = local.z() * frame.emissionMean[k];
    precision[k] = window + emission;
    mean[k] = (window * windowMean + emission * emissionMean) / precision[k];
    const double gap = windowMean - emissionMean;
    peak *= std::exp(-0.5 * window * emission / precision[k] * gap * gap);
  }
  if (expansion) {
    // Completing the square of the exponent once more, now with a mixed term.
    constexpr double kLeastPrecision = 0.1, kMostSkew = 0.9;
    double centre[2], left[2], curve[2], linear[2];
    for (int k = 0; k < 2; ++k) {
      centre[k] = expansion->centre[k] - local[k];
      left[k] = std::max(precision[k] - expansion->curve[k], kLeastPrecision * precision[k]);
      curve[k] = precision[k] - left[k];
    }
    const double most = kMostSkew * std::sqrt(left[0] * left[1]);
    const double mixed = std::clamp(static_cast<double>(expansion->mixed), -most, most);
    for (int k = 0; k < 2; ++k)
      linear[k] = precision[k] * mean[k] + expansion->slope[k] - curve[k] * centre[k] - mixed * centre[1 - k];
    const double determinant = left[0] * left[1] - mixed * mixed;
    const double moved[2] = {(left[1] * linear[0] + mixed * linear[1]) / determinant,
                             (left[0] * linear[1] + mixed * linear[0]) / determinant};
    double exponent = expansion->value + mixed * (centre[0] * centre[1] - moved[0] * moved[1]);
    for (int k = 0; k < 2; ++k) {
      exponent += 0.5 * (left[k] * moved[k] * moved[k] - precision[k] * mean[k] * mean[k] +
                         curve[k] * centre[k] * centre[k]) -
                  expansion->slope[k] * centre[k];
      mean[k] = moved[k];
      precision[k] = left[k];
    }
    peak *= std::exp(exponent);
    site.lightPrecisionXY = static_cast<float>(-mixed);
  }
  site.lightMeanX = static_cast<float>(mean[0]);
  site.lightMeanY = static_cast<float>(mean[1]);
  site.lightPrecisionX = static_cast<float>(precision[0]);
  site.lightPrecisionY = static_cast<float>(precision[1]);
  site.lightPeak = static_cast<float>(peak);
  return site;
}

}  // namespace patina
