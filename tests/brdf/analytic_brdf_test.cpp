#include "engine/brdf/analytic_brdf.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>

// Laws that every analytic BRDF keeps, and values that are known in closed form.
namespace patina {
namespace {

using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;

Eigen::Vector3d direction(double thetaRad, double phiRad) {
  return {std::sin(thetaRad) * std::cos(phiRad), std::sin(thetaRad) * std::sin(phiRad), std::cos(thetaRad)};
}

BrdfPtr parse(const std::string& text) {
  Result<BrdfPtr> brdf = parseAnalyticBrdf(text);
  EXPECT_TRUE(brdf) << text << ": " << (brdf ? "" : brdf.error().sentence());
  return brdf ? *brdf : nullptr;
}

/// Each model with lobes wide and narrow, isotropic and not; the specular part alone reflects all that the
/// surface lets it (specular 1), the Lambertian part alone all of its.
const char* kSpecularOnly[] = {"blinn?diffuse=0&specular=1&exponent=1",
                               "blinn?diffuse=0&specular=1&exponent=300",
                               "beckmann?diffuse=0&specular=1&alpha=0.1",
                               "beckmann?diffuse=0&specular=1&alpha=0.9",
                               "beckmann?diffuse=0&specular=1&alphaX=0.6&alphaY=0.1",
                               "ggx?diffuse=0&specular=1&alpha=0.1",
                               "ggx?diffuse=0&specular=1&alpha=1",
                               "ggx-anisotropic?diffuse=0&specular=1&alphaX=0.1&alphaY=0.7",
                               "ward?diffuse=0&specular=1&alpha=0.1",
                               "ward?diffuse=0&specular=1&alphaX=0.5&alphaY=0.15"};

class AnalyticLaws : public testing::TestWithParam<const char*> {};

TEST_P(AnalyticLaws, Reciprocity) {
  const BrdfPtr brdf = parse(GetParam());
  std::mt19937 random(7);
  std::uniform_real_distribution<double> theta(0, kPi / 2), phi(-kPi, kPi);
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3d a = direction(theta(random), phi(random)),
                          b = direction(theta(random), phi(random));
    const Eigen::Array3d there = brdf->evaluate(a, b), back = brdf->evaluate(b, a);
    // Only the order of additions differs.
    EXPECT_LT((there - back).abs().maxCoeff(), 1e-9 * (1 + there.maxCoeff()))
        << a.transpose() << " | " << b.transpose();
  }
}

TEST_P(AnalyticLaws, ReflectAtMostWhatArrives) {
  const BrdfPtr brdf = parse(GetParam());
  // A white furnace: over half-vectors where lobes are narrow, so that the quadrature sees them. d(view) =
  // 4 (view . half) d(half).
  constexpr int kThetas = 400, kPhis = 256;
  constexpr double kQuadrature = 0.005;  // what the sums below err for alpha 1, where the albedo is known
  for (const double thetaDeg : {0.0, 30.0, 60.0, 80.0, 88.0}) {
    const Eigen::Vector3d toView = direction(thetaDeg * kPi / 180, 0.6);
    double albedo = 0;
    for (int i = 0; i < kThetas; ++i) {
      const double u = (i + 0.5) / kThetas;  // denser towards the normal
      const double theta = u * u * kPi / 2, step = 2 * u / kThetas * kPi / 2;
      for (int k = 0; k < kPhis; ++k) {
        const Eigen::Vector3d half = direction(theta, 2 * kPi * (k + 0.5) / kPhis);
        const double cosD = half.dot(toView);
        if (cosD <= 0) continue;
        const Eigen::Vector3d toLight = 2 * cosD * half - toView;
        if (toLight.z() <= 0) continue;
        albedo += brdf->evaluate(toLight, toView)[0] * toLight.z() * 4 * cosD * std::sin(theta) * step * 2 *
                  kPi / kPhis;
      }
    }
    EXPECT_LT(albedo, 1 + kQuadrature) << thetaDeg;
    EXPECT_GT(albedo, 0.05) << thetaDeg << ": a mirror of unit reflectance can't be this dark";
  }
}

TEST_P(AnalyticLaws, FiniteAndNotNegativeAtGrazing) {
  const BrdfPtr brdf = parse(GetParam());
  for (const double a : {kPi / 2, kPi / 2 - 1e-12, kPi / 2 - 1e-6, kPi / 2 - 1e-3, 1.2, 0.0}) {
    for (const double b : {kPi / 2, kPi / 2 - 1e-12, kPi / 2 - 1e-6, kPi / 2 - 1e-3, 1.2, 0.0}) {
      for (const double phi : {0.0, 1e-9, 0.3, kPi / 2, kPi - 1e-9, kPi}) {
        Eigen::Vector3d l = direction(a, 0.2), v = direction(b, 0.2 + phi);
        l.z() = std::max(l.z(), 0.0), v.z() = std::max(v.z(), 0.0);
        const Eigen::Array3d value = brdf->evaluate(l, v);
        EXPECT_TRUE(value.allFinite() && (value >= 0).all())
            << a << " " << b << " " << phi << ": " << value.transpose();
      }
    }
  }
}

TEST_P(AnalyticLaws, UnknownBelowTheSurface) {
  const BrdfPtr brdf = parse(GetParam());
  EXPECT_TRUE(brdf->evaluate(direction(1.6, 0), direction(0.3, 0)).isNaN().all());
  EXPECT_TRUE(brdf->evaluate(direction(0.3, 0), direction(1.6, 0)).isNaN().all());
}

TEST_P(AnalyticLaws, IsotropicMeansThatTurningChangesNothing) {
  const BrdfPtr brdf = parse(GetParam());
  double change = 0;
  for (const double turn : {0.4, 1.1, 2.9}) {
    for (const double phi : {0.3, 2.0, 3.0}) {
      const double still = brdf->evaluate(direction(0.5, 0.1), direction(0.7, 0.1 + phi))[0];
      const double turned = brdf->evaluate(direction(0.5, 0.1 + turn), direction(0.7, 0.1 + phi + turn))[0];
      change = std::max(change, std::abs(turned - still) / (1e-6 + std::abs(still)));
    }
  }
  if (brdf->isotropic()) {
    EXPECT_LT(change, 1e-9);
  } else {
    EXPECT_GT(change, 0.01);
  }
}

INSTANTIATE_TEST_SUITE_P(All, AnalyticLaws, testing::ValuesIn(kSpecularOnly),
                         [](const auto& info) { return "Model" + std::to_string(info.index); });

TEST(AnalyticBrdf, TheLawsSawEveryModelWithALobe) {
  for (const std::string& id : analyticBrdfModels()) {
    if (id == "lambert") continue;
    EXPECT_TRUE(std::any_of(std::begin(kSpecularOnly), std::end(kSpecularOnly), [&](const std::string& text) {
      return text.substr(0, text.find('?')) == id;
    })) << id;
  }
  EXPECT_EQ(analyticBrdfModels().size(), 6u);
}

TEST(AnalyticBrdf, LambertIsItsAlbedoOverPi) {
  const BrdfPtr brdf = parse("lambert?diffuse=0.3,0.6,0.9");
  const Eigen::Array3d value = brdf->evaluate(direction(0.2, 0), direction(1.1, 2));
  EXPECT_TRUE(value.isApprox(Eigen::Array3d(0.3, 0.6, 0.9) / kPi, 1e-12));
}

TEST(AnalyticBrdf, KnownValuesAtNormalIncidence) {
  // Light and view at the normal: D(0) F0 / 4; shadowing is 1 and the cosines are 1.
  const Eigen::Vector3d z = Eigen::Vector3d::UnitZ();
  const double f0 = 0.05;
  EXPECT_NEAR(parse("ggx?diffuse=0&specular=0.05&alpha=0.3")->evaluate(z, z)[0], f0 / (4 * kPi * 0.09),
              1e-12);
  EXPECT_NEAR(parse("beckmann?diffuse=0&specular=0.05&alpha=0.3")->evaluate(z, z)[0], f0 / (4 * kPi * 0.09),
              1e-12);
  EXPECT_NEAR(parse("blinn?diffuse=0&specular=0.05&exponent=20")->evaluate(z, z)[0], f0 * 22 / (2 * kPi) / 4,
              1e-12);
  // Ward: rho / (pi alphaX alphaY |l + v|^2).
  EXPECT_NEAR(parse("ward?diffuse=0&specular=0.05&alphaX=0.2&alphaY=0.4")->evaluate(z, z)[0],
              f0 / (kPi * 0.08 * 4), 1e-12);
}

TEST(AnalyticBrdf, GgxWithFullWidthIsKnownInClosedForm) {
  // alpha 1: D = 1 / pi for every half-vector and 4 cosL cosV / G2 = 2 (cosL + cosV).
  const Eigen::Vector3d l = direction(0.9, 0.3), v = direction(0.4, 2.5);
  const double cosD = (l + v).norm() / 2;
  const double fresnel = 0.04 + 0.96 * std::pow(1 - cosD, 5);
  EXPECT_NEAR(parse("ggx?diffuse=0&specular=0.04&alpha=1")->evaluate(l, v)[0],
              fresnel / kPi / (2 * (l.z() + v.z())), 1e-12);
}

TEST(AnalyticBrdf, WardReflectsItsAlbedoWhereTheLobeIsNarrow) {
  // Known by construction of the bounded variant, at normal incidence of a narrow lobe.
  const BrdfPtr brdf = parse("ward?diffuse=0&specular=0.7&alpha=0.05");
  double albedo = 0;
  constexpr int kSteps = 4000;
  for (int i = 0; i < kSteps; ++i) {
    const double theta = (i + 0.5) / kSteps * 0.6;  // beyond, nothing is left of the lobe
    albedo += brdf->evaluate(direction(theta, 0), Eigen::Vector3d::UnitZ())[0] * std::cos(theta) *
              std::sin(theta) * 2 * kPi * 0.6 / kSteps;
  }
  EXPECT_NEAR(albedo, 0.7, 0.01);  // terms of the order of alpha^2 remain
}

TEST(AnalyticBrdf, RefusesWhatItDoesNotKnowWithTheNearest) {
  const auto error = [](const std::string& text) {
    const Result<BrdfPtr> brdf = parseAnalyticBrdf(text);
    EXPECT_FALSE(brdf) << text;
    return brdf ? std::string() : brdf.error().sentence();
  };
  EXPECT_THAT(error("gxx"), HasSubstr("Try: ggx"));
  EXPECT_THAT(error("ggx?alhpa=0.2"), HasSubstr("Try: alpha"));
  EXPECT_THAT(error("ggx?alpha=0"), HasSubstr("alpha must be within"));
  EXPECT_THAT(error("ggx?alpha=2"), HasSubstr("alpha must be within"));
  EXPECT_THAT(error("ggx?alpha=nan"), HasSubstr("not a number"));
  EXPECT_THAT(error("ward?alphaX=0.2&alphaY=-1"), HasSubstr("alphaY"));
  EXPECT_THAT(error("blinn?exponent=0"), HasSubstr("exponent"));
  EXPECT_THAT(error("lambert?diffuse=1.5"), HasSubstr("diffuse"));
  EXPECT_THAT(error("lambert?diffuse=0.5,0.5"), HasSubstr("not a number"));
  EXPECT_THAT(error("lambert?specular=0.5"), HasSubstr("no parameter of lambert"));
  EXPECT_THAT(error(""), HasSubstr("no analytic model"));
  AnalyticBrdfParameters parameters;
  parameters.diffuse[1] = std::nan("");
  EXPECT_FALSE(makeAnalyticBrdf("lambert", parameters));
}

}  // namespace
}  // namespace patina
