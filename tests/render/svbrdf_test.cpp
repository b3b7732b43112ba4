#include "engine/surface/svbrdf.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;

Eigen::Vector3f direction(double thetaRad, double phiRad) {
  return Eigen::Vector3d(std::sin(thetaRad) * std::cos(phiRad), std::sin(thetaRad) * std::sin(phiRad),
                         std::cos(thetaRad))
      .cast<float>();
}

std::vector<SvbrdfParameters> catalogue() {
  std::vector<SvbrdfParameters> list;
  for (float sigma : {0.01f, 0.05f, 0.15f, 0.35f})
    for (float gamma : {1.0f, 1.3f, 2.0f}) {
      SvbrdfParameters p;
      p.diffuse = {0.3f, 0.2f, 0.1f};
      p.specular = {0.06f, 0.05f, 0.04f};
      p.sigma = sigma;
      p.kurtosis = gamma;
      list.push_back(p);
    }
  return list;
}

/// Of light from `toLight`, the part that is reflected: midpoint rule over the half-vector's slope, where the
/// lobe is smooth whatever its width, plus a cosine-weighted sum for the diffuse part. Red.
double reflected(const SvbrdfParameters& p, const Eigen::Vector3f& toLight) {
  SvbrdfParameters gloss = p;
  gloss.diffuse.setZero();
  const double widest = 6.5 * svbrdfLobeSigmas(p.sigma, p.kurtosis)[1],
               narrow = svbrdfLobeSigmas(p.sigma, p.kurtosis)[0];
  const int steps = static_cast<int>(std::ceil(2 * widest / (0.5 * narrow)));
  const double h = 2 * widest / steps;
  double sum = 0;
  for (int i = 0; i < steps; ++i)
    for (int j = 0; j < steps; ++j) {
      const Eigen::Vector3d half =
          Eigen::Vector3d(-widest + (i + 0.5) * h, -widest + (j + 0.5) * h, 1).normalized();
      const Eigen::Vector3d l = toLight.cast<double>().normalized();
      const double lh = half.dot(l);
      const Eigen::Vector3d v = 2 * lh * half - l;
      if (lh <= 0 || v.z() <= 0) continue;
      // d(half) = cos^3 dy, d(v) = 4 (l.h) d(half)
      const double solid = 4 * lh * std::pow(half.z(), 3) * h * h;
      sum += svbrdfBrdf(v.cast<float>(), toLight, gloss)[0] * v.z() * solid;
    }
  return sum + p.diffuse[0];
}

TEST(SvbrdfBrdf, LobeIsHalfOfTheTwoGaussians) {
  // Standard deviation of the mean of the two, per axis, is sigma.
  for (float gamma : {1.0f, 1.4f, 2.5f}) {
    const auto s = svbrdfLobeSigmas(0.1f, gamma);
    EXPECT_NEAR(0.5 * (s[0] * s[0] + s[1] * s[1]), 0.01, 1e-7);
    EXPECT_NEAR(s[1] / s[0], gamma * gamma, 1e-4);
  }
}

TEST(SvbrdfBrdf, IsReciprocal) {
  std::mt19937 bits(7);
  std::uniform_real_distribution<double> unit(0, 1);
  constexpr float kRounding =
      2e-3f;  // a lobe of 0.01 turns an error of 1e-7 in the slope into 1e-5 of its exponent's argument
  for (SvbrdfParameters p : catalogue()) {
    p.normal = direction(0.2, 1.0);
    for (int i = 0; i < 400; ++i) {
      const Eigen::Vector3f a = direction(1.5 * unit(bits), 2 * kPi * unit(bits)),
                            b = direction(1.5 * unit(bits), 2 * kPi * unit(bits));
      const Eigen::Array3f forward = svbrdfBrdf(a, b, p), backward = svbrdfBrdf(b, a, p);
      EXPECT_TRUE(((forward - backward).abs() <= kRounding * forward.max(backward) + 1e-6f).all())
          << "sigma " << p.sigma << ": " << forward.transpose() << " against " << backward.transpose();
    }
  }
}

TEST(SvbrdfBrdf, IsFiniteAndPositiveAtGrazing) {
  for (const SvbrdfParameters& p : catalogue())
    for (double l : {0.0, 1.0, 1.5, 1.5707, 1.57079, kPi / 2, 1.6})
      for (double v : {0.0, 1.0, 1.5, 1.5707, 1.57079, kPi / 2, 1.6})
        for (double turn : {0.0, 1.0, kPi}) {
          for (const Eigen::Array3f& value : {svbrdfBrdf(direction(l, 0), direction(v, turn), p),
                                              svbrdfBrdfTimesCos(direction(l, 0), direction(v, turn), p)}) {
            EXPECT_TRUE(value.isFinite().all()) << l << " " << v << " " << turn;
            EXPECT_TRUE((value >= 0).all());
          }
        }
}

TEST(SvbrdfBrdf, IsZeroBelowTheHorizon) {
  const SvbrdfParameters p = catalogue()[4];
  EXPECT_EQ(svbrdfBrdf(direction(1.7, 0), direction(0.2, 0), p).maxCoeff(), 0);
  EXPECT_EQ(svbrdfBrdf(direction(0.2, 0), direction(1.7, 0), p).maxCoeff(), 0);
}

TEST(SvbrdfBrdf, TimesCosIsTheBrdfTimesTheCosine) {
  for (const SvbrdfParameters& p : catalogue()) {
    const Eigen::Vector3f l = direction(0.7, 0.1), v = direction(0.8, 3.2);
    const Eigen::Array3f expected = svbrdfBrdf(l, v, p) * l.z(), got = svbrdfBrdfTimesCos(l, v, p);
    EXPECT_TRUE(((got - expected).abs() <= 1e-5f * expected).all());
  }
}

TEST(SvbrdfBrdf, SpecularIsTheAlbedoAtNormalIncidence) {
  for (const SvbrdfParameters& p : catalogue()) {
    if (svbrdfLobeSigmas(p.sigma, p.kurtosis)[1] > 0.2f)
      continue;  // a broad lobe meets other angles, and the horizon
    const double lobe = reflected(p, Eigen::Vector3f::UnitZ()) - p.diffuse[0];
    EXPECT_NEAR(lobe / p.specular[0], 1.0, 0.02) << "sigma " << p.sigma << " gamma " << p.kurtosis;
  }
}

TEST(SvbrdfBrdf, ReflectsNoMoreThanItReceives) {
  // A black base with the whole Fresnel reflection, and the usual mixture; light from above down to 75
  // degrees.
  for (SvbrdfParameters p : catalogue()) {
    if (p.sigma > 0.16f) continue;  // without shadowing a broad lobe gains energy towards grazing: documented
    p.diffuse = Eigen::Array3f::Constant(0.5f);
    p.specular = Eigen::Array3f::Constant(kSvbrdfF0);
    for (double theta : {0.0, 0.6, 1.0, 1.3}) {
      const double part = reflected(p, direction(theta, 0.3));
      EXPECT_LE(part, 1.0) << "sigma " << p.sigma << " gamma " << p.kurtosis << " theta " << theta;
      EXPECT_GT(part, 0.5);
    }
  }
}

}  // namespace
}  // namespace patina
