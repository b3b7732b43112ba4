#include "engine/surface/svbrdf.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace patina {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
constexpr float kLeastCosineProduct = 1e-4f;  ///< see svbrdfBrdf

/// p(y) (n.h)^-4 F / F0: what multiplies specular / (4 n.l n.v).
float lobe(const Eigen::Vector3f& toLight, const Eigen::Vector3f& toView,
           const SvbrdfParameters& parameters) {
  const Eigen::Vector3f sum = toLight + toView;
  const float along = sum.dot(parameters.normal);  // |sum| n.h; positive above the horizon
  const float lengthSquared = sum.squaredNorm();
  // |sum|^2 - along^2 loses its digits near the mirror direction, where a narrow lobe needs them most.
  const float slopeSquared = (sum - along * parameters.normal).squaredNorm() / (along * along);
  const auto sigmas = svbrdfLobeSigmas(parameters.sigma, parameters.kurtosis);
  float density = 0;
  for (float s : sigmas) density += 0.5f / (2 * kPi * s * s) * std::exp(-0.5f * slopeSquared / (s * s));
  const float inverseCos2 = lengthSquared / (along * along);
  return density * inverseCos2 * inverseCos2 * svbrdfFresnelRatio(0.5f * std::sqrt(lengthSquared));
}

}  // namespace

std::array<float, 2> svbrdfLobeSigmas(float sigma, float gamma) {
  const float g2 = gamma * gamma, c = std::sqrt(2 / (1 / g2 + g2));
  return {c * sigma / gamma, c * sigma * gamma};
}

float svbrdfFresnelRatio(float cosThetaD) {
  const float m = std::clamp(1 - cosThetaD, 0.0f, 1.0f), m2 = m * m;
  return 1 + (1 - kSvbrdfF0) / kSvbrdfF0 * m2 * m2 * m;
}

Eigen::Array3f svbrdfBrdf(const Eigen::Vector3f& toLight, const Eigen::Vector3f& toView,
                          const SvbrdfParameters& parameters) {
  const float nl = parameters.normal.dot(toLight), nv = parameters.normal.dot(toView);
  if (!(nl > 0) || !(nv > 0)) return Eigen::Array3f::Zero();
  return parameters.diffuse / kPi + parameters.specular * (lobe(toLight, toView, parameters) /
                                                           (4 * std::max(nl * nv, kLeastCosineProduct)));
}

Eigen::Array3f svbrdfBrdfTimesCos(const Eigen::Vector3f& toLight, const Eigen::Vector3f& toView,
                                  const SvbrdfParameters& parameters) {
  const float nl = parameters.normal.dot(toLight), nv = parameters.normal.dot(toView);
  if (!(nl > 0) || !(nv > 0)) return Eigen::Array3f::Zero();
  return parameters.diffuse * (nl / kPi) +
         parameters.specular *
             (lobe(toLight, toView, parameters) * nl / (4 * std::max(nl * nv, kLeastCosineProduct)));
}

}  // namespace patina
