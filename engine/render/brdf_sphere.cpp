#include "engine/render/brdf_sphere.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace patina {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;

float smoothStep(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.0f, 1.0f);
  return t * t * (3 - 2 * t);
}

/// 1 inside a rectangle round `centre`, seen from the sphere, 0 outside, soft over `edge`.
float softBox(const Eigen::Vector3f& direction, const Eigen::Vector3f& centre, float halfWidth,
              float halfHeight, float edge) {
  const float depth = direction.dot(centre);
  if (depth <= 0) return 0;
  const Eigen::Vector3f right = centre.cross(Eigen::Vector3f::UnitY()).normalized(), up = right.cross(centre);
  const float x = std::abs(direction.dot(right)) / depth, y = std::abs(direction.dot(up)) / depth;
  return (1 - smoothStep(halfWidth - edge, halfWidth + edge, x)) *
         (1 - smoothStep(halfHeight - edge, halfHeight + edge, y));
}

/// Points that fill the unit square evenly (additive recurrence with the plastic number), turned by an offset
/// a pixel.
struct SquarePoint {
  float u, v;
};
SquarePoint squarePoint(int index, float shift) {
  const float u = 0.5f + 0.7548776662f * static_cast<float>(index) + shift;
  const float v = 0.5f + 0.5698402910f * static_cast<float>(index) + 0.618034f * shift;
  return {u - std::floor(u), v - std::floor(v)};
}

/// Irradiance of the studio on a surface of the given normal, over pi: what a white Lambertian surface sends
/// back. From the first nine spherical harmonics of the room. Source: Ramamoorthi and Hanrahan 2001: within 1
/// % on average, and smooth where samples would leave a pattern.
class StudioIrradiance {
 public:
  StudioIrradiance() {
    constexpr int kRings = 64,
                  kTurns = 128;  // the room's coefficients, by the midpoint rule: 8192 evaluations, once
    for (int i = 0; i < kRings; ++i)
      for (int j = 0; j < kTurns; ++j) {
        const float z = -1 + (static_cast<float>(i) + 0.5f) * 2 / kRings;
        const float turn = (static_cast<float>(j) + 0.5f) * 2 * kPi / kTurns, r = std::sqrt(1 - z * z);
        const Eigen::Vector3f direction(r * std::cos(turn), r * std::sin(turn), z);
        coefficients_ += basis(direction) * (studioRadiance(direction) * 4 * kPi / (kRings * kTurns));
      }
    // Lambert's cosine damps the orders by pi, 2 pi / 3, pi / 4; over pi.
    coefficients_.segment<3>(1) *= 2.0f / 3;
    coefficients_.segment<5>(4) *= 0.25f;
  }
  float operator()(const Eigen::Vector3f& normal) const {
    return std::max(0.0f, (coefficients_ * basis(normal)).sum());
  }

 private:
  using Nine = Eigen::Array<float, 9, 1>;
  static Nine basis(const Eigen::Vector3f& d) {
    Nine y;
    y << 0.282095f, 0.488603f * d.y(), 0.488603f * d.z(), 0.488603f * d.x(), 1.092548f * d.x() * d.y(),
        1.092548f * d.y() * d.z(), 0.315392f * (3 * d.z() * d.z() - 1), 1.092548f * d.x() * d.z(),
        0.546274f * (d.x() * d.x() - d.y() * d.y());
    return y;
  }
  Nine coefficients_ = Nine::Zero();
};

}  // namespace

float studioRadiance(const Eigen::Vector3f& direction) {
  const float sky = 0.16f + 0.14f * smoothStep(-0.6f, 0.9f, direction.y());
  static const Eigen::Vector3f key = Eigen::Vector3f(-0.75f, 0.55f, 0.5f).normalized();
  static const Eigen::Vector3f rim = Eigen::Vector3f(0.95f, 0.15f, 0.05f).normalized();
  return sky + 6.0f * softBox(direction, key, 0.34f, 0.5f, 0.02f) +
         2.2f * softBox(direction, rim, 0.16f, 0.7f, 0.02f);
}

Image brdfSphere(const SvbrdfParameters& parameters, int size, const SphereLighting& lighting, int samples,
                 float background) {
  size = std::max(1, size);
  samples = std::max(1, samples);
  Image picture(size, size, 3, background);
  const Eigen::Vector3f toView = Eigen::Vector3f::UnitZ(), toLight = lighting.toLight.normalized();
  const auto sigmas = svbrdfLobeSigmas(parameters.sigma, parameters.kurtosis);
  const float radius = 0.46f * static_cast<float>(size), pixel = 1 / radius;

  static const StudioIrradiance diffuseLight;
  const auto shade = [&](const Eigen::Vector3f& normal, float shift) {
    SvbrdfParameters here = parameters;
    here.normal = normal;
    Eigen::Array3f radiance = svbrdfBrdfTimesCos(toLight, toView, here) * lighting.lightIrradiance;
    if (!lighting.studio) return radiance;
    const Eigen::Vector3f tangent = normal.unitOrthogonal(), bitangent = normal.cross(tangent);
    const float nv = std::max(normal.dot(toView), 1e-3f);  // the very rim of the sphere
    const Eigen::Vector2f viewSlope(toView.dot(tangent) / nv, toView.dot(bitangent) / nv);
    float specular = 0;
    for (int s = 0; s < samples; ++s) {
      const SquarePoint p = squarePoint(s, shift);
      const float turn = 2 * kPi * p.v;
      const float slope =
          sigmas[static_cast<std::size_t>(s % 2)] * std::sqrt(-2 * std::log(1 - 0.9999f * p.u));
      const Eigen::Vector2f y(slope * std::cos(turn), slope * std::sin(turn));
      const Eigen::Vector3f half = (normal + y.x() * tangent + y.y() * bitangent).normalized();
      const float hv = half.dot(toView);
      const Eigen::Vector3f reflected = 2 * hv * half - toView;
      if (hv <= 0 || reflected.dot(normal) <= 0) continue;
      specular += std::max(0.0f, 1 + y.dot(viewSlope)) * svbrdfFresnelRatio(hv) * studioRadiance(reflected);
    }
    return Eigen::Array3f(radiance + parameters.diffuse * diffuseLight(normal) +
                          parameters.specular * (specular / static_cast<float>(samples)));
  };

  tbb::parallel_for(0, size, [&](int py) {
    for (int px = 0; px < size; ++px) {
      float x = (static_cast<float>(px) + 0.5f - 0.5f * static_cast<float>(size)) * pixel;
      float y = (0.5f * static_cast<float>(size) - static_cast<float>(py) - 0.5f) * pixel;
      const float r = std::sqrt(x * x + y * y);
      const float covered = std::clamp((1 - r) / pixel + 0.5f, 0.0f, 1.0f);
      if (covered <= 0) continue;
      if (r > 0.998f) {  // the rim's own pixels: the last normal that still faces the eye
        x *= 0.998f / r;
        y *= 0.998f / r;
      }
      const Eigen::Vector3f normal(x, y, std::sqrt(std::max(1e-6f, 1 - x * x - y * y)));
      // Neighbouring pixels take different points, so that what is left of the sampling looks like grain, not
      // like rings.
      const float shift = 0.25f * static_cast<float>((px & 1) + 2 * (py & 1));
      const Eigen::Array3f radiance = shade(normal, shift);
      for (int c = 0; c < 3; ++c) picture.at(px, py, c) = covered * radiance[c] + (1 - covered) * background;
    }
  });
  return picture;
}

}  // namespace patina
