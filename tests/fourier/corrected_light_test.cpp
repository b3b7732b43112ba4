// Emission and height that corrections know of, in the model, against brute-force integrals over the screen.
#include <gtest/gtest.h>

#include <random>

#include "engine/fourier/diffuse_transform.h"
#include "engine/fourier/emission_expansion.h"
#include "engine/fourier/photo_prediction.h"
#include "engine/fourier/solver.h"
#include "tests/fourier/brute_force.h"

namespace patina::test {
namespace {

const std::vector<Eigen::Vector2d> kFrequencies = {{0, 0}, {1, 0}, {0, 1},   {2, -2}, {3, 3},
                                                   {6, 0}, {0, 6}, {10, 10}, {20, 0}};

/// A panel that is 30 % darker in one corner than in the opposite one, and bulges in between.
double spatial(const Eigen::Vector2d& x, const Eigen::Vector2d&, double) {
  return std::log(1 + 0.15 * std::sin(0.6 * x.x() + 0.9 * x.y()) - 0.03 * x.squaredNorm() / 3.14);
}
/// A panel that loses 30 % more than its Gaussian says at a slope of one.
double angular(const Eigen::Vector2d& x, const Eigen::Vector2d& foot, double distance) {
  const double tangent2 = (x - foot).squaredNorm() / (distance * distance);
  return std::log(1 - 0.6 * tangent2 / (1 + tangent2));
}

SvbrdfParameters material(float sigma) {
  SvbrdfParameters p;
  p.sigma = sigma;
  p.kurtosis = 1.2f;
  p.normal = Eigen::Vector3f(0.03f, -0.05f, 1).normalized();
  return p;
}

double rmsOf(const std::vector<Complex>& truth, const SiteLobe& lobe) {
  double sum = 0;
  for (std::size_t f = 0; f < truth.size(); ++f)
    sum += std::norm(Complex(lobe.transform(kFrequencies[f].cast<float>())) - truth[f]);
  return std::sqrt(sum / static_cast<double>(truth.size())) / std::abs(truth[0]);
}

TEST(CorrectedLight, LobesSeeAnotherEmission) {
  // A tenth of what one photograph's noise of 0.5 % does to Z, and a quarter where the emission has a third
  // derivative of 0.15 a pattern unit; without the correction it is thirty times that.
  for (const auto& [name, emission, tolerance] :
       {std::tuple{"spatial", &spatial, 1.5e-3}, {"angular", &angular, 5e-4}}) {
    Rig rig;
    for (const float sigma : {0.04f, 0.08f, 0.12f, 0.2f}) {
      for (const auto& [x, y] : {std::pair{0.0, 0.0}, {50.0, 40.0}, {-45.0, 10.0}}) {
        const SvbrdfParameters p = material(sigma);
        const auto truth = bruteForce(rig, {x, y, 0}, p, kFrequencies, 500, *emission);
        rig.frame.logEmission = *emission;
        const SiteGeometry plain = rig.site(x, y);
        const EmissionExpansion expansion = expandEmission(rig.frame, plain, p);
        const SiteGeometry corrected = siteGeometry(rig.frame, {x, y, 0}, rig.cameraMm, &expansion);
        const double error = rmsOf(truth, siteLobe(rig.frame, corrected, p, LobeMapping::ExactMoments));
        const double without = rmsOf(truth, siteLobe(rig.frame, plain, p, LobeMapping::ExactMoments));
        EXPECT_GT(without, 10 * error) << name << " sigma " << sigma << " at " << x << ", " << y;
        EXPECT_LT(error, tolerance) << name << " sigma " << sigma << " at " << x << ", " << y;
      }
    }
  }
}

/// Sum over the lit rectangle of the Lambertian term, as in diffuse_transform_test but by directions.
Complex lambertian(const Rig& rig, const Eigen::Vector3d& pointMm, const Eigen::Vector3d& normal,
                   const Eigen::Vector2d& w, const decltype(ScreenFrame::logEmission)& logEmission) {
  constexpr int kSteps = 500;
  const Screen& screen = rig.screen;
  const double hx = screen.halfExtent().x(), hy = screen.halfExtent().y();
  const Eigen::Vector3d screenNormal = screen.worldFromScreen.col(2);
  const Eigen::Vector2d foot =
      (screen.worldFromScreen.leftCols<2>().transpose() * (pointMm - screen.originMm)) / screen.unitMm();
  Complex sum = 0;
  for (int j = 0; j < kSteps; ++j) {
    for (int i = 0; i < kSteps; ++i) {
      const Eigen::Vector2d x(hx * (2 * (i + 0.5) / kSteps - 1), hy * (2 * (j + 0.5) / kSteps - 1));
      const Eigen::Vector3d gap =
          (screen.originMm + screen.worldFromScreen * Eigen::Vector3d(x.x(), x.y(), 0) * screen.unitMm() -
           pointMm) /
          screen.unitMm();
      const double height = -gap.dot(screenNormal), length = gap.norm();
      const Eigen::Array2d q =
          ((x - foot) / height - screen.emission->mean).array() / screen.emission->sigma.array();
      const Eigen::Array2d window = x.array() / screen.windowSigma.array();
      double light = screen.emission->gain * std::exp(-0.5 * (q.square().sum() + window.square().sum()));
      if (logEmission) light *= std::exp(logEmission(x, foot, height));
      sum += gap.dot(normal) / length * (height / length) / (length * length) / std::numbers::pi * light *
             std::polar(1.0, -w.dot(x));
    }
  }
  return sum * (2 * hx / kSteps) * (2 * hy / kSteps);
}

double worstDiffuse(const Rig& rig, const DiffuseTransform& transform, const SheetShape& shape,
                    const std::vector<Eigen::Vector2d>& frequencies) {
  double worst = 0;
  const Eigen::Vector3d normal = Eigen::Vector3d(0.1, -0.15, 1).normalized(),
                        onScreen = rig.frame.screenFromWorld * normal;
  for (const Eigen::Vector2d& point :
       {Eigen::Vector2d(3, 2), Eigen::Vector2d(57, -41), Eigen::Vector2d(-55, 50)}) {
    std::vector<float> v(frequencies.size() * 6);
    transform.at(point, v.data());
    double dc = 0;
    for (std::size_t f = 0; f < frequencies.size(); ++f) {
      Complex value = 0;
      for (int axis = 0; axis < 3; ++axis)
        value += onScreen[axis] * Complex(v[(f * 3 + axis) * 2], v[(f * 3 + axis) * 2 + 1]);
      const Complex truth =
          lambertian(rig, shape.pointMm(point), normal, frequencies[f], rig.frame.logEmission);
      if (f == 0) dc = std::abs(truth);
      worst = std::max(worst, std::abs(value - truth) / dc);
    }
  }
  return worst;
}

const std::vector<Eigen::Vector2d> kDiffuseFrequencies = {{0, 0}, {1, 0}, {0, -1}, {2, 2}, {6, 0}, {20, 0}};

TEST(CorrectedLight, TheDiffuseTermSeesAnotherEmission) {
  for (const auto& emission : {&spatial, &angular}) {
    Rig rig;
    rig.frame.logEmission = *emission;
    const DiffuseTransform transform(rig.frame, {120, 120}, kDiffuseFrequencies, DiffuseMethod::Quadrature);
    // single precision of the table, and the midpoint rule's own error at 500 steps
    EXPECT_LT(worstDiffuse(rig, transform, {}, kDiffuseFrequencies), 3e-5);
  }
}

/// A sheet that arches by 4 mm from rim to rim, as paper does.
double arched(const Eigen::Vector2d& point) {
  return 2 - 4 * std::pow(point.x() / 60, 2) + 0.01 * point.y();
}
/// One that a table of nine nodes a side can't follow: ripples of half a millimetre, 15 mm long.
double rippled(const Eigen::Vector2d& point) {
  return arched(point) + 0.5 * std::sin(point.x() / 2.4) * std::cos(point.y() / 2.4);
}

TEST(CorrectedLight, TheDiffuseTermKnowsHeights) {
  const Rig rig;
  const SheetShape arch{&arched, rig.cameraMm}, ripples{&rippled, rig.cameraMm};
  const DiffuseTransform flat(rig.frame, {120, 120}, kDiffuseFrequencies, DiffuseMethod::Quadrature),
      bent(rig.frame, {120, 120}, kDiffuseFrequencies, DiffuseMethod::Quadrature, arch),
      rough(rig.frame, {120, 120}, kDiffuseFrequencies, DiffuseMethod::Quadrature, ripples);
  EXPECT_FALSE(bent.hasRest());
  EXPECT_TRUE(rough.hasRest());
  EXPECT_GT(worstDiffuse(rig, flat, arch, kDiffuseFrequencies), 5e-3);
  EXPECT_LT(worstDiffuse(rig, bent, arch, kDiffuseFrequencies), 3e-5);
  EXPECT_GT(worstDiffuse(rig, bent, ripples, kDiffuseFrequencies), 5e-4);
  // second order in what the table can't follow, up to a millimetre of 200
  EXPECT_LT(worstDiffuse(rig, rough, ripples, kDiffuseFrequencies), 1.5e-4);
  // A selection is the same transform.
  const std::vector<int> some = {0, 3, 5};
  const DiffuseTransform selected = rough.select(some);
  std::vector<float> all(kDiffuseFrequencies.size() * 6), part(some.size() * 6);
  rough.at({20, -7}, all.data());
  selected.at({20, -7}, part.data());
  for (std::size_t i = 0; i < some.size(); ++i)
    for (std::size_t k = 0; k < 6; ++k)
      EXPECT_NEAR(part[i * 6 + k], all[static_cast<std::size_t>(some[i]) * 6 + k], 1e-7 * std::abs(all[4]));
}

TEST(CorrectedLight, LobesKnowHeights) {
  const Rig rig;
  const SheetShape arch{&arched, rig.cameraMm};
  for (const auto& [x, y] : {std::pair{0.0, 0.0}, {45.0, 40.0}}) {
    const SvbrdfParameters p = material(0.05f);
    const Eigen::Vector3d point = arch.pointMm({x, y});
    EXPECT_NEAR(point.z(), arched({x, y}), 1e-12);
    // on the ray of the pixel that would see the plane there
    EXPECT_LT((point - rig.cameraMm).cross(Eigen::Vector3d(x, y, 0) - rig.cameraMm).norm(), 1e-9);
    const auto truth = bruteForce(rig, point, p, kFrequencies, 500);
    const SiteGeometry lifted = siteGeometry(rig.frame, point, rig.cameraMm);
    EXPECT_LT(rmsOf(truth, siteLobe(rig.frame, lifted, p, LobeMapping::ExactMoments)), 5e-4);
    EXPECT_GT(rmsOf(truth, siteLobe(rig.frame, rig.site(x, y), p, LobeMapping::ExactMoments)), 1e-3);
  }
}

/// Z of one site by brute force under another emission; the solver must find the site's parameters when it
/// knows of it.
TEST(CorrectedLight, TheSolverFindsWhatABruteForceSiteIsMadeOf) {
  Rig rig;
  const Eigen::Vector2d at(35, -30);
  SvbrdfParameters p = material(0.1f);
  p.diffuse = {0.2f, 0.1f, 0.05f};
  p.specular = {0.05f, 0.06f, 0.04f};
  std::vector<Eigen::Vector2d> frequencies = {{0, 0}};
  for (const int w : {1, 2, 3, 4, 6, 10})
    for (const auto& direction :
         {Eigen::Vector2d(1, 0), Eigen::Vector2d(0, 1), Eigen::Vector2d(1, 1), Eigen::Vector2d(1, -1)})
      frequencies.push_back(w * direction);
  const auto lobe = bruteForce(rig, {at.x(), at.y(), 0}, p, frequencies, 500, &spatial);
  std::vector<float> z, dc;
  for (std::size_t f = 0; f < frequencies.size(); ++f) {
    const Complex diffuse =
        lambertian(rig, {at.x(), at.y(), 0}, p.normal.cast<double>(), frequencies[f], &spatial);
    for (int part = 0; part < (f == 0 ? 1 : 2); ++part)
      for (int c = 0; c < 3; ++c) {
        const Complex value =
            static_cast<double>(p.diffuse[c]) * diffuse + static_cast<double>(p.specular[c]) * lobe[f];
        (f == 0 ? dc : z).push_back(static_cast<float>(part == 0 ? value.real() : value.imag()));
      }
  }
  SolverSetup setup;
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < 3; ++j) setup.normalRows[k][j] = static_cast<float>(rig.frame.screenFromWorld(j, k));
  for (int k = 0; k < 2; ++k) setup.halfExtent[k] = static_cast<float>(rig.frame.halfExtent[k]);
  for (std::size_t f = 1; f < frequencies.size(); ++f)
    setup.frequency.push_back(frequencies[f].cast<float>());
  setup.maxIterations = 200;
  setup.variant.skewedLight = true;
  struct Found {
    double sigma, specular, diffuse, tiltDeg;
  };
  const auto solve = [&](bool corrected) {
    rig.frame.logEmission = {};
    if (corrected) rig.frame.logEmission = &spatial;
    SiteSolution found;
    LobeParameters start{std::log(0.07f), -1, 0, 0};
    SvbrdfParameters sofar = material(0.07f);
    // As a fit goes about it: expanded at the first solution, then solved.
    for (int round = 0; round < 2; ++round) {
      SiteData data;
      data.geometry = rig.site(at.x(), at.y());
      if (corrected) {
        const EmissionExpansion expansion = expandEmission(rig.frame, data.geometry, sofar);
        data.geometry = siteGeometry(rig.frame, {at.x(), at.y(), 0}, rig.cameraMm, &expansion);
      }
      const auto diffuse = DiffuseTransform::atPoint(rig.frame, at, frequencies, DiffuseMethod::Quadrature);
      data.diffuse = diffuse.data();
      data.z = z.data();
      data.dc = dc.data();
      for (int c = 0; c < 3; ++c) data.weight[c] = data.dcWeight[c] = 1e10f;
      solveSites(setup, {&data, 1}, {&start, 1}, {&found, 1});
      start = found.lobe;
      sofar.sigma = std::exp(found.lobe.logSigma);
      sofar.kurtosis = 1 + std::exp(found.lobe.logKurtosis);
      sofar.normal = Eigen::Vector3f(found.lobe.slopeX, found.lobe.slopeY, 1).normalized();
    }
    const double tilt = std::acos(std::min(1.0f, sofar.normal.dot(p.normal))) * 180 / std::numbers::pi;
    return Found{sofar.sigma / p.sigma - 1.0, found.specular[0] / p.specular[0] - 1.0,
                 found.diffuse[0] - p.diffuse[0], tilt};
  };
  const Found with = solve(true), without = solve(false);
  EXPECT_LT(std::abs(with.sigma), 0.008);
  EXPECT_LT(std::abs(with.specular), 0.012);
  EXPECT_LT(std::abs(with.diffuse), 2e-3);
  EXPECT_LT(with.tiltDeg, 0.05);
  EXPECT_GT(std::abs(without.specular), 0.15);
}

}  // namespace
}  // namespace patina::test
