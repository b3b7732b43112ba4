#include "tests/bench/fourier_baseline.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cmath>
#include <random>

#include "engine/fourier/diffuse_transform.h"
#include "tests/fourier/rig.h"

// A race is fair where both run the same distance: the baseline's model is the solver's.
namespace patina::bench {
namespace {

/// A site with the measurements of a made-up lobe, from the point model of the engine, plus noise.
struct Site {
  test::Rig rig;
  SolverSetup setup;
  std::vector<float> diffuse, z, dc;
  SiteData data;

  Site(double xMm, double yMm, float sigma, unsigned seed) {
    constexpr float kNoise = 1e-4f;
    for (int k = 0; k < 3; ++k)
      for (int j = 0; j < 3; ++j)
        setup.normalRows[k][j] = static_cast<float>(rig.frame.screenFromWorld(j, k));
    for (int k = 0; k < 2; ++k) setup.halfExtent[k] = static_cast<float>(rig.frame.halfExtent[k]);
    std::vector<Eigen::Vector2d> frequencies = {{0, 0}};
    for (const int w : {1, 2, 4, 8, 16})
      for (const auto& direction :
           {Eigen::Vector2d(1, 0), Eigen::Vector2d(0, 1), Eigen::Vector2d(1, 1), Eigen::Vector2d(1, -1)})
        frequencies.push_back(w * direction);
    for (std::size_t f = 1; f < frequencies.size(); ++f)
      setup.frequency.push_back(frequencies[f].cast<float>());
    setup.maxIterations = 100;
    diffuse = DiffuseTransform::atPoint(rig.frame, {xMm, yMm}, frequencies, DiffuseMethod::Quadrature);
    SvbrdfParameters p;
    p.diffuse = {0.2f, 0.1f, 0.05f};
    p.specular = {0.05f, 0.06f, 0.04f};
    p.sigma = sigma;
    p.kurtosis = 1.4f;
    p.normal = Eigen::Vector3f(0.04f, -0.03f, 1).normalized();
    const SiteLobe lobe = siteLobe(rig.frame, rig.site(xMm, yMm), p, LobeMapping::ExactMoments);
    const Eigen::Vector3f n = normalOnScreen(rig.frame, p.normal);
    std::mt19937 random(seed);
    std::normal_distribution<float> noise(0, kNoise);
    for (std::size_t f = 0; f < frequencies.size(); ++f) {
      const float* v = diffuse.data() + f * 6;
      const std::complex<float> d(n.x() * v[0] + n.y() * v[2] + n.z() * v[4],
                                  n.x() * v[1] + n.y() * v[3] + n.z() * v[5]);
      const std::complex<float> s = lobe.transform(frequencies[f].cast<float>());
      float part[2][3];
      for (int c = 0; c < 3; ++c) {
        const auto value = p.diffuse[c] * d + p.specular[c] * s;
        part[0][c] = value.real() + noise(random), part[1][c] = value.imag() + noise(random);
      }
      if (f == 0) {
        dc.assign(part[0], part[0] + 3);
      } else {
        for (const auto& values : part) z.insert(z.end(), values, values + 3);
      }
    }
    data.geometry = rig.site(xMm, yMm);
    data.diffuse = diffuse.data(), data.z = z.data(), data.dc = dc.data();
    for (int c = 0; c < 3; ++c) data.weight[c] = data.dcWeight[c] = 1 / (kNoise * kNoise);
  }
};

TEST(FourierBaseline, HasTheSolversCost) {
  constexpr double kSinglePrecision = 1e-3;  // of a sum of some hundred squares of differences
  for (const float sigma : {0.03f, 0.1f, 0.25f}) {
    Site site(20, -25, sigma, 3);
    site.setup.maxIterations = 0;  // at the start: off the optimum, where every part of the model counts
    const LobeParameters start{std::log(1.3f * sigma), std::log(0.3f), 0.02f, -0.01f};
    SiteSolution solution;
    solveSites(site.setup, {&site.data, 1}, {&start, 1}, {&solution, 1});
    const double cost = baselineCost(site.setup, site.data, solution);
    EXPECT_GT(cost, 150) << "at the optimum, where half of the model is not felt";
    EXPECT_NEAR(cost, solution.cost, kSinglePrecision * cost) << sigma;
  }
}

TEST(FourierBaseline, FindsTheSameOptimum) {
  constexpr double kTolerance = 2e-3;  // both stop where a step gains less than 1e-5 of the cost
  constexpr double kLogSigma = 0.03;   // along sigma and gamma together the valley is shallow
  for (const float sigma : {0.04f, 0.12f}) {
    const Site site(-15, 10, sigma, 5);
    const LobeParameters start{std::log(0.1f), std::log(0.03f), 0, 0};
    SiteSolution ours;
    solveSites(site.setup, {&site.data, 1}, {&start, 1}, {&ours, 1});
    const BaselineSolution theirs = solveWithCeres(site.setup, site.data, start);
    EXPECT_TRUE(theirs.converged);
    EXPECT_NEAR(theirs.cost, ours.cost, kTolerance * ours.cost);
    EXPECT_NEAR(theirs.lobe.logSigma, ours.lobe.logSigma, kLogSigma);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(theirs.specular[c], ours.specular[c], 0.002);
  }
}

TEST(FourierBaseline, AutomaticDerivativesAreTheSolversOnEveryInstructionSet) {
  // The solver integrates the derivative of the integrand, Ceres differentiates the quadrature: they agree as
  // far as the rule is exact.
  constexpr double kValues = 5e-6, kBySlopes = 1e-3, kByWidths = 1.2e-2;
  for (const auto target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    for (const float sigma : {0.03f, 0.1f, 0.25f}) {
      const Site site(20, -25, sigma, 3);
      const LobeParameters at{std::log(1.3f * sigma), std::log(0.3f), 0.02f, -0.01f};
      const std::size_t rows = 2 * site.setup.frequency.size() + 1;
      std::vector<float> ours(rows * kModelColumns);
      std::vector<double> theirs(ours.size());
      modelColumns(site.setup, {&site.data, 1}, {&at, 1}, ours.data());
      baselineColumns(site.setup, site.data, at, theirs.data());
      for (std::size_t column = 0; column < kModelColumns; ++column) {
        double gap = 0, size = 0;
        for (std::size_t row = 0; row < rows; ++row) {
          gap += std::pow(ours[row * kModelColumns + column] - theirs[row * kModelColumns + column], 2);
          size += std::pow(theirs[row * kModelColumns + column], 2);
        }
        EXPECT_LT(std::sqrt(gap / size), column < 2                   ? kValues
                                         : column == 4 || column == 5 ? kByWidths
                                                                      : kBySlopes)
            << solverTarget() << " sigma " << sigma << " column " << column;
      }
    }
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

}  // namespace
}  // namespace patina::bench
