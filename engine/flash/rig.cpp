#include "engine/flash/rig.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/surface/svbrdf.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
/// The table of a tone curve: fine enough that linear interpolation over logarithms is good to 1e-6.
constexpr int kTable = 1024;
constexpr double kFirstLogValue = -14, kLastLogValue = 4;  // 1e-6 .. 50
constexpr double kLogValueStep = (kLastLogValue - kFirstLogValue) / (kTable - 1);
/// L = v here, so that the curve doesn't compete with the albedos' scale.
constexpr double kAnchor = 0.2;
/// Below, a normal nearly lies in the ray's plane; as svbrdfBrdf.
constexpr double kLeastCosine = 1e-4;
constexpr std::array<double, FlashLobe::kDeviations> kDeviationKnots = {0.5, 1, 2, 3, 5};

double atTable(const std::vector<double>& table, double first, double step, double x) {
  const double at = (x - first) / step;
  const int i = std::clamp(static_cast<int>(std::floor(at)), 0, static_cast<int>(table.size()) - 2);
  return table[i] + (at - i) * (table[i + 1] - table[i]);  // beyond the ends: straight on
}

}  // namespace

const char* flashEffectId(FlashEffect effect) {
  constexpr std::array<const char*, kFlashEffects> kIds = {
      "camera-response", "light-power", "near-light", "vignetting",     "stray-light",
      "black-level",     "anisotropy",  "third-lobe", "basis-deviation"};
  return kIds[static_cast<std::size_t>(effect)];
}

std::vector<FlashEffect> allFlashEffects() {
  std::vector<FlashEffect> all;
  for (int i = 0; i < kFlashEffects; ++i) all.push_back(static_cast<FlashEffect>(i));
  return all;
}

const std::array<double, ToneCurve::kKnots>& ToneCurve::knotValues() {
  static constexpr std::array<double, kKnots> kValues = {0.004, 0.03, 0.15, 0.5, 1.0};
  return kValues;
}

ToneCurve::ToneCurve(const std::array<double, kKnots>& logSlope) {
  identity_ = std::all_of(logSlope.begin(), logSlope.end(), [](double h) { return h == 0; });
  if (identity_) return;
  const auto slope = [&](double logValue) {
    const auto& knots = knotValues();
    int i = 0;
    while (i + 2 < kKnots && logValue > std::log(knots[i + 1])) ++i;
    const double a = std::log(knots[i]), b = std::log(knots[i + 1]);
    const double t = std::clamp((logValue - a) / (b - a), 0.0, 1.0);
    return std::exp((1 - t) * logSlope[i] + t * logSlope[i + 1]);
  };
  logLight_.resize(kTable);
  logLight_[0] = kFirstLogValue;
  for (int i = 1; i < kTable; ++i)
    logLight_[i] = logLight_[i - 1] + kLogValueStep * slope(kFirstLogValue + (i - 0.5) * kLogValueStep);
  const double shift =
      std::log(kAnchor) - atTable(logLight_, kFirstLogValue, kLogValueStep, std::log(kAnchor));
  for (double& value : logLight_) value += shift;
  firstLogLight_ = logLight_.front();
  logLightStep_ = (logLight_.back() - logLight_.front()) / (kTable - 1);
  logValue_.resize(kTable);
  int j = 0;
  for (int i = 0; i < kTable; ++i) {
    const double wanted = firstLogLight_ + i * logLightStep_;
    while (j + 2 < kTable && logLight_[j + 1] < wanted) ++j;
    logValue_[i] =
        kFirstLogValue + kLogValueStep * (j + (wanted - logLight_[j]) / (logLight_[j + 1] - logLight_[j]));
  }
}

double ToneCurve::value(double light) const {
  if (identity_) return light;
  const double size = std::abs(light);
  if (size < 1e-12) return light;
  return std::copysign(std::exp(atTable(logValue_, firstLogLight_, logLightStep_, std::log(size))), light);
}

double ToneCurve::light(double value) const {
  if (identity_) return value;
  const double size = std::abs(value);
  if (size < 1e-12) return value;
  return std::copysign(std::exp(atTable(logLight_, kFirstLogValue, kLogValueStep, std::log(size))), value);
}

double ToneCurve::slopeAt(double light) const {
  if (identity_) return 1;
  const double size = std::max(std::abs(light), 1e-9), step = 1e-3 * size;
  return (value(size + step) - value(size - step)) / (2 * step);
}

double FlashLobe::sigma() const {
  return std::exp(logSigma);
}
double FlashLobe::kurtosis() const {
  return std::exp(std::abs(logKurtosis));
}

FlashRay flashRay(const FlashPhoto& photo, const Eigen::Vector2d& pointMm) {
  const Eigen::Vector3d point(pointMm.x(), pointMm.y(), 0);
  FlashRay ray;
  const Eigen::Vector3d light = photo.lightPositionMm - point;
  ray.inverseSquare = 1 / light.squaredNorm();
  ray.toLight = light * std::sqrt(ray.inverseSquare);
  const Eigen::Vector3d camera = photo.camera ? photo.camera->positionMm() : photo.cameraPositionMm;
  ray.toView = (camera - point).normalized();
  ray.lightSlope = -light.head<2>() / photo.lightPositionMm.z();
  const Eigen::Vector3d axis = photo.camera
                                   ? Eigen::Vector3d(-photo.camera->cameraFromWorld.row(2).transpose())
                                   : Eigen::Vector3d(camera.normalized());
  const double along = std::max(axis.dot(ray.toView), 1e-3);
  ray.axisTan2 = std::max(0.0, 1 / (along * along) - 1);
  return ray;
}

double flashLobeTimesCos(const FlashLobe& lobe, const FlashRay& ray, const Eigen::Vector3d& normal) {
  const double nl = normal.dot(ray.toLight), nv = normal.dot(ray.toView);
  if (!(nl > 0) || !(nv > 0)) return 0;
  const Eigen::Vector3d sum = ray.toLight + ray.toView;
  const double along = sum.dot(normal), lengthSquared = sum.squaredNorm();
  const Eigen::Vector3d across = (sum - along * normal) / along;
  double slopeSquared = across.squaredNorm();
  if (!lobe.stretch.isZero(0)) {
    // The sample's x axis, laid into the tangent plane.
    const Eigen::Vector3d tangent = (Eigen::Vector3d::UnitX() - normal.x() * normal).normalized();
    const Eigen::Vector3d bitangent = normal.cross(tangent);
    const double u = across.dot(tangent), v = across.dot(bitangent);
    const double ratio = lobe.stretch.norm(), c = lobe.stretch.x() / ratio, s = lobe.stretch.y() / ratio;
    // exp of the traceless matrix -stretch: the wide axis counts less, the narrow one more.
    const double even = std::cosh(ratio), odd = -std::sinh(ratio);
    slopeSquared = even * (u * u + v * v) + odd * (c * (u * u - v * v) + 2 * s * u * v);
  }
  const double sigma = std::exp(lobe.logSigma), gamma = std::exp(lobe.logKurtosis), g2 = gamma * gamma;
  const double scale = std::sqrt(2 / (1 / g2 + g2));
  double density = 0;
  for (const double s : {scale * sigma / gamma, scale * sigma * gamma})
    density += 0.5 / (2 * kPi * s * s) * std::exp(-0.5 * slopeSquared / (s * s));
  if (lobe.thirdShare != 0) {
    const double s = sigma * std::exp(lobe.logThirdRatio);
    density += lobe.thirdShare * (1 / (2 * kPi * s * s) * std::exp(-0.5 * slopeSquared / (s * s)) - density);
  }
  double logFactor = 0;
  const double u = std::sqrt(slopeSquared) / sigma;
  for (int i = 0; i < FlashLobe::kDeviations; ++i) {
    if (lobe.deviation[i] == 0) continue;
    const double here = kDeviationKnots[i];
    const double before = i > 0 ? kDeviationKnots[i - 1] : 0;
    const bool last = i + 1 == FlashLobe::kDeviations;
    double weight = u <= here ? std::clamp((u - before) / (here - before), 0.0, 1.0)
                    : last    ? 1.0
                              : std::clamp(1 - (u - here) / (kDeviationKnots[i + 1] - here), 0.0, 1.0);
    logFactor += lobe.deviation[i] * weight;
  }
  if (logFactor != 0) density *= std::exp(logFactor);
  const double inverseCos2 = lengthSquared / (along * along);
  const double fresnel = svbrdfFresnelRatio(static_cast<float>(0.5 * std::sqrt(lengthSquared)));
  return density * inverseCos2 * inverseCos2 * fresnel / (4 * std::max(nv, kLeastCosine));
}

double flashRigFactor(const FlashRig& rig, int photo, const FlashRay& ray) {
  double logFactor = -rig.vignetting * ray.axisTan2 - rig.beamFallOff * ray.lightSlope.squaredNorm();
  if (!rig.logGain.empty()) logFactor += rig.logGain[photo];
  logFactor += rig.aim.dot(ray.lightSlope);
  if (!rig.photoAim.empty()) logFactor += rig.photoAim[photo].dot(ray.lightSlope);
  return logFactor == 0 ? 1 : std::exp(logFactor);
}

Eigen::Array3d flashLight(const FlashCapture& capture, const FlashRig& rig, int photo, const FlashRay& ray,
                          const FlashLobe& lobe, const FlashTexel& texel) {
  const Eigen::Vector3d normal = texel.normal();
  const double nl = std::max(0.0, normal.dot(ray.toLight)), nv = normal.dot(ray.toView);
  const Eigen::Array3d diffuse = texel.diffuse(), specular = texel.specular();
  Eigen::Array3d light = Eigen::Array3d::Zero();
  if (nv > 0) {
    light = (diffuse * (nl / kPi) + specular * flashLobeTimesCos(lobe, ray, normal)) *
            capture.photos[photo].lightIntensity.array() *
            (ray.inverseSquare * flashRigFactor(rig, photo, ray));
  }
  return light + rig.ambient * diffuse / kPi;
}

}  // namespace patina
