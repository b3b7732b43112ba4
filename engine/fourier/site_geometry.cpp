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
    // Completing the square of the exponent once more.
    double exponent = expansion->value;
    for (int k = 0; k < 2; ++k) {
      constexpr double kLeastPrecision = 0.1;
      const double centre = expansion->centre[k] - local[k], slope = expansion->slope[k];
      const double left = std::max(precision[k] - expansion->curve[k], kLeastPrecision * precision[k]);
      const double curve = precision[k] - left;
      const double moved = (precision[k] * mean[k] + slope - curve * centre) / left;
      exponent += 0.5 * (left * moved * moved - precision[k] * mean[k] * mean[k] + curve * centre * centre) -
                  slope * centre;
      mean[k] = moved;
      precision[k] = left;
    }
    peak *= std::exp(exponent);
  }
  site.lightMeanX = static_cast<float>(mean[0]);
  site.lightMeanY = static_cast<float>(mean[1]);
  site.lightPrecisionX = static_cast<float>(precision[0]);
  site.lightPrecisionY = static_cast<float>(precision[1]);
  site.lightPeak = static_cast<float>(peak);
  return site;
}

}  // namespace patina
