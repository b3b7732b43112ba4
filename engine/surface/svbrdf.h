#pragma once

#include <Eigen/Core>
#include <array>

#include "engine/surface/svbrdf_parameters.h"

namespace patina {

/// Schlick's reflectance at normal incidence that the specular albedo is quoted for. Source: frequency-domain
/// paper, section 5.2.
inline constexpr float kSvbrdfF0 = 0.06f;

/// The standard deviations of the lobe's two Gaussians over the half-vector's slope plane: c sigma / gamma
/// and c sigma gamma with c = sqrt(2 / (gamma^-2 + gamma^2)), so that their mean has standard deviation
/// sigma. Source: frequency-domain paper, App. C. sigma > 0, gamma >= 1; both dimensionless.
std::array<float, 2> svbrdfLobeSigmas(float sigma, float gamma);

/// Schlick's Fresnel factor over its value at normal incidence: 1 at cosThetaD = 1, 1 / F0 at grazing.
/// cosThetaD: cosine between light and half-vector, 0 to 1.
float svbrdfFresnelRatio(float cosThetaD);

/// The BRDF (1/sr, R G B, without the cosine) of the material at one point: Lambert plus a microfacet lobe
/// with two Gaussians over the half-vector's slope, Schlick's Fresnel and unit shadowing. Source:
/// frequency-domain paper, sections 5.1 and 5.2 and App. C; written as a density p of slopes:
///   f = diffuse / pi + specular p(y) (n.h)^-4 F(l.h) / F0 / (4 n.l n.v),  y the slope of the half-vector
///   against the normal,
/// of which the paper uses the first-order map onto the screen. The Fresnel factor is the paper's rendering
/// advice. toLight, toView: unit, in the frame that parameters.normal is given in. Below the horizon of the
/// normal: zero. Reciprocal to rounding. Finite everywhere: n.l n.v is taken as at least 1e-4, because
/// without shadowing the lobe grows without bound towards the horizon (both directions within 0.6 degrees of
/// it are affected; times the cosine it was finite anyway). Energy: reflects at most diffuse + specular F /
/// F0 in the narrow-lobe limit; specular <= F0 = 0.06 keeps that below one. Cost: about 30 ns. Thread-safe.
Eigen::Array3f svbrdfBrdf(const Eigen::Vector3f& toLight, const Eigen::Vector3f& toView,
                          const SvbrdfParameters& parameters);

/// The same times n.l (1/sr, R G B).
Eigen::Array3f svbrdfBrdfTimesCos(const Eigen::Vector3f& toLight, const Eigen::Vector3f& toView,
                                  const SvbrdfParameters& parameters);

}  // namespace patina
