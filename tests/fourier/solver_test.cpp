// The SIMD solver, for every instruction set that this machine has.
#include "engine/fourier/solver.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <random>

#include "engine/fourier/diffuse_transform.h"
#include "tests/fourier/rig.h"

namespace patina::test {
namespace {

/// One made-up texel: measurements from SiteLobe and DiffuseTransform (tested against brute force elsewhere)
/// plus noise. Here the search is under test, not the model.
struct MadeUpSite {
  Rig rig;
  SolverSetup setup;
  std::vector<float> diffuse, z, dc;
  SiteData data;

  MadeUpSite(const SvbrdfParameters& p, double xMm, double yMm, float noise, unsigned seed,
             const LobeTerms& terms = {}, float skew = 0) {
    for (int k = 0; k < 3; ++k)
      for (int j = 0; j < 3; ++j)
        setup.normalRows[k][j] = static_cast<float>(rig.frame.screenFromWorld(j, k));
    for (int k = 0; k < 2; ++k) setup.halfExtent[k] = static_cast<float>(rig.frame.halfExtent[k]);
    std::vector<Eigen::Vector2d> frequencies = {{0, 0}};
    for (const int w : {1, 2, 3, 4, 6, 10, 20, 40})
      for (const auto& direction :
           {Eigen::Vector2d(1, 0), Eigen::Vector2d(0, 1), Eigen::Vector2d(1, 1), Eigen::Vector2d(1, -1)})
        frequencies.push_back(w * direction);
    for (std::size_t f = 1; f < frequencies.size(); ++f)
      setup.frequency.push_back(frequencies[f].cast<float>());
    setup.maxIterations = 100;
    diffuse = DiffuseTransform::atPoint(rig.frame, {xMm, yMm}, frequencies, DiffuseMethod::Quadrature);
    data.geometry = rig.site(xMm, yMm);
    data.geometry.lobe = terms;
    data.geometry.lightPrecisionXY = skew;
    setup.variant = {skew != 0, terms.stretched(), terms.thirdShare > 0};
    const SiteLobe lobe = siteLobe(rig.frame, data.geometry, p, LobeMapping::ExactMoments);
    const Eigen::Vector3f n = normalOnScreen(rig.frame, p.normal);
    std::mt19937 random(seed);
    std::normal_distribution<float> normal(0, noise);
    for (std::size_t f = 0; f < frequencies.size(); ++f) {
      const float* v = diffuse.data() + f * 6;
      const std::complex<float> d(n.x() * v[0] + n.y() * v[2] + n.z() * v[4],
                                  n.x() * v[1] + n.y() * v[3] + n.z() * v[5]);
      const std::complex<float> s = lobe.transform(frequencies[f].cast<float>());
      float re[3], im[3];
      for (int c = 0; c < 3; ++c) {
        const auto value = p.diffuse[c] * d + p.specular[c] * s;
        re[c] = value.real() + normal(random);
        im[c] = value.imag() + normal(random);
      }
      if (f == 0) {
        dc.assign(re, re + 3);
      } else {
        z.insert(z.end(), re, re + 3);
        z.insert(z.end(), im, im + 3);
      }
    }
    data.diffuse = diffuse.data();
    data.z = z.data();
    data.dc = dc.data();
    for (int c = 0; c < 3; ++c) data.weight[c] = data.dcWeight[c] = 1 / (noise * noise);
  }
};

SvbrdfParameters gloss() {
  SvbrdfParameters p;
  p.diffuse = {0.2f, 0.1f, 0.05f};
  p.specular = {0.05f, 0.06f, 0.04f};
  p.sigma = 0.06f;
  p.kurtosis = 1.4f;
  p.normal = Eigen::Vector3f(0.04f, -0.03f, 1).normalized();
  return p;
}

class EveryTarget : public testing::Test {
 protected:
  template <typename Check>
  void forEachTarget(Check check) {
    int count = 0;
    for (const auto target : hwy::SupportedAndGeneratedTargets()) {
      hwy::SetSupportedTargetsForTest(target);
      hwy::GetChosenTarget().Update(hwy::SupportedTargets());
      SCOPED_TRACE(solverTarget());
      check();
      ++count;
    }
    hwy::SetSupportedTargetsForTest(0);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    EXPECT_GE(count, 1);
  }
};

constexpr float kNoise = 1e-4f;  // of a zero frequency of about 0.05: half a percent, as one exposure has

void expectGradientOfDifferences(const MadeUpSite& site) {
  const LobeParameters at{std::log(0.08f), -0.7f, 0.05f,
                          -0.02f};  // off the optimum, where the slope is steep
  const auto here = evaluateSite(site.setup, site.data, at);
  // Steps wide enough for single precision; variable projection: the albedos follow, so the envelope
  // theorem makes half the cost's slope the gradient. 2 % holds the difference's own error and the score
  // quadrature's.
  const float steps[4] = {4e-3f, 1e-2f, 3e-4f, 3e-4f};
  float scale = 0;
  for (int i = 0; i < 4; ++i) scale = std::max(scale, std::abs(here.gradient[i]) * steps[i]);
  for (int i = 0; i < 4; ++i) {
    LobeParameters up = at, down = at;
    float* fields[2][4] = {{&up.logSigma, &up.logKurtosis, &up.slopeX, &up.slopeY},
                           {&down.logSigma, &down.logKurtosis, &down.slopeX, &down.slopeY}};
    *fields[0][i] += steps[i];
    *fields[1][i] -= steps[i];
    const float difference =
        (evaluateSite(site.setup, site.data, up).cost - evaluateSite(site.setup, site.data, down).cost) / 2;
    EXPECT_NEAR(2 * here.gradient[i] * steps[i], difference, 0.02f * 2 * scale) << i;
  }
}

TEST_F(EveryTarget, GradientMatchesDifferencesOfTheCost) {
  const MadeUpSite site(gloss(), 10, 20, kNoise, 1);
  forEachTarget([&] { expectGradientOfDifferences(site); });
}

const LobeTerms kTerms{{0.25f, -0.15f}, 0.2f, 2.5f};

TEST_F(EveryTarget, GradientMatchesDifferencesWithTerms) {
  for (const auto& [terms, skew] : {std::pair{LobeTerms{}, 0.15f},
                                    {LobeTerms{{0.3f, 0.2f}, 0, 1}, 0.0f},
                                    {LobeTerms{{0, 0}, 0.2f, 2.5f}, 0.0f},
                                    {kTerms, 0.1f}}) {
    const MadeUpSite site(gloss(), 10, 20, kNoise, 1, terms, skew);
    forEachTarget([&] { expectGradientOfDifferences(site); });
  }
}

TEST_F(EveryTarget, LobesWithTermsAreFound) {
  const SvbrdfParameters p = gloss();
  // One draw of this noise moves the diffuse albedo by a thousandth (its standard deviation); of twelve draws
  // the root mean square is known to a fifth.
  constexpr int kDraws = 12;
  std::vector<MadeUpSite> sites;
  for (unsigned seed = 1; seed <= kDraws; ++seed) sites.emplace_back(p, 10, 20, 1e-6f, seed, kTerms, 0.1f);
  const LobeParameters start{std::log(0.03f), std::log(0.03f), 0, 0};
  forEachTarget([&] {
    double sigma = 0, specular = 0, diffuse = 0;
    for (const MadeUpSite& site : sites) {
      SiteData data = site.data;  // the copies' arrays lie elsewhere
      data.diffuse = site.diffuse.data(), data.z = site.z.data(), data.dc = site.dc.data();
      SiteSolution found;
      solveSites(site.setup, {&data, 1}, {&start, 1}, {&found, 1});
      EXPECT_EQ(found.outcome, SolveOutcome::Converged);
      sigma += std::pow(std::exp(found.lobe.logSigma) / p.sigma - 1, 2) / kDraws;
      specular += std::pow(found.specular[1] / p.specular[1] - 1, 2) / kDraws;
      diffuse += std::pow(found.diffuse[1] / p.diffuse[1] - 1, 2) / kDraws;
      EXPECT_NEAR(found.lobe.slopeX, p.normal.x() / p.normal.z(), 1e-4);
      EXPECT_NEAR(found.lobe.slopeY, p.normal.y() / p.normal.z(), 1e-4);
    }
    EXPECT_LT(std::sqrt(sigma), 4e-4);
    EXPECT_LT(std::sqrt(specular), 4e-4);
    EXPECT_LT(std::sqrt(diffuse), 1.5e-3);
  });
}

TEST_F(EveryTarget, RecoversGlossFromEveryStart) {
  MadeUpSite site(gloss(), -30, 15, kNoise, 2);
  forEachTarget([&] {
    for (const float sigma : {0.03f, 0.1f}) {
      const LobeParameters start{std::log(sigma), std::log(0.03f), 0, 0};
      SiteSolution found;
      solveSites(site.setup, {&site.data, 1}, {&start, 1}, {&found, 1});
      EXPECT_EQ(found.outcome, SolveOutcome::Converged);
      // 65 complex-free measurements a channel at 1e-3 noise: chi-square of 195 - 10, five sigma either way
      EXPECT_NEAR(found.dataCost, 185, 5 * std::sqrt(2 * 195.0));
      EXPECT_NEAR(std::exp(found.lobe.logSigma), 0.06f, 0.002f);
      EXPECT_NEAR(found.lobe.slopeX, 0.04f, 0.001f);
      EXPECT_NEAR(found.lobe.slopeY, -0.03f, 0.001f);
      EXPECT_NEAR(found.specular[1], 0.06f, 0.003f);
      EXPECT_NEAR(found.diffuse[0], 0.2f, 0.02f);
    }
  });
}

TEST_F(EveryTarget, AlbedosAreNeverNegative) {
  SvbrdfParameters p = gloss();
  p.diffuse.setZero();
  p.specular = {0.05f, 0, 0};
  MadeUpSite site(p, 0, 0, 5 * kNoise, 3);
  forEachTarget([&] {
    const LobeParameters start{std::log(0.1f), std::log(0.03f), 0, 0};
    SiteSolution found;
    solveSites(site.setup, {&site.data, 1}, {&start, 1}, {&found, 1});
    for (int c = 0; c < 3; ++c) {
      EXPECT_GE(found.diffuse[c], 0);
      EXPECT_GE(found.specular[c], 0);
    }
    EXPECT_TRUE(std::isfinite(found.cost));
  });
}

TEST_F(EveryTarget, AnyNumberOfSitesGivesWhatEachAloneGives) {
  MadeUpSite a(gloss(), 10, 0, kNoise, 4);
  SvbrdfParameters p = gloss();
  p.sigma = 0.15f;
  MadeUpSite b(p, -10, 30, kNoise, 5);
  forEachTarget([&] {
    std::vector<SiteData> data;
    for (int i = 0; i < 2 * solverLanes() + 3; ++i) data.push_back(i % 3 ? a.data : b.data);
    const std::vector<LobeParameters> start(data.size(), {std::log(0.1f), std::log(0.03f), 0, 0});
    std::vector<SiteSolution> all(data.size());
    solveSites(a.setup, data, start, all);
    for (std::size_t i = 0; i < data.size(); ++i) {
      SiteSolution alone;
      solveSites(a.setup, {&data[i], 1}, {&start[i], 1}, {&alone, 1});
      EXPECT_EQ(alone.cost, all[i].cost) << i;  // lanes don't see each other
    }
  });
}

TEST_F(EveryTarget, ModelColumnsAreTheModelAndItsDerivatives) {
  MadeUpSite site(gloss(), 20, -10, kNoise, 8);
  const LobeParameters at{std::log(0.08f), -0.7f, 0.05f, -0.02f};
  const std::size_t rows = 2 * site.setup.frequency.size() + 1;
  forEachTarget([&] {
    const auto columnsAt = [&](const LobeParameters& p) {
      std::vector<float> out(rows * kModelColumns);
      modelColumns(site.setup, {&site.data, 1}, {&p, 1}, out.data());
      return out;
    };
    const std::vector<float> here = columnsAt(at);
    // the value: SiteLobe's, which shares the kernel's text in double precision but not the sums over
    // frequencies
    SvbrdfParameters p;
    p.sigma = std::exp(at.logSigma);
    p.kurtosis = 1 + std::exp(at.logKurtosis);
    p.normal = Eigen::Vector3f(at.slopeX, at.slopeY, 1).normalized();
    const SiteLobe lobe = siteLobe(site.rig.frame, site.data.geometry, p, LobeMapping::ExactMoments);
    const float dc = here[(rows - 1) * kModelColumns + 1];
    for (std::size_t f = 0; f < site.setup.frequency.size(); ++f) {
      const auto value = lobe.transform(site.setup.frequency[f]);
      EXPECT_NEAR(here[2 * f * kModelColumns + 1], value.real(), 2e-5f * dc) << f;
      EXPECT_NEAR(here[(2 * f + 1) * kModelColumns + 1], value.imag(), 2e-5f * dc) << f;
    }
    const float steps[4] = {4e-3f, 1e-2f, 3e-4f, 3e-4f};
    for (int i = 0; i < 4; ++i) {
      LobeParameters up = at, down = at;
      float* fields[2][4] = {{&up.logSigma, &up.logKurtosis, &up.slopeX, &up.slopeY},
                             {&down.logSigma, &down.logKurtosis, &down.slopeX, &down.slopeY}};
      *fields[0][i] += steps[i];
      *fields[1][i] -= steps[i];
      const std::vector<float> high = columnsAt(up), low = columnsAt(down);
      float largest = 0;
      for (std::size_t row = 0; row < rows; ++row)
        largest = std::max(largest, std::abs(here[row * kModelColumns + 4 + static_cast<std::size_t>(i)]));
      for (std::size_t row = 0; row < rows; ++row) {
        const std::size_t to = row * kModelColumns + 1;
        const float difference = (high[to] - low[to]) / (2 * steps[i]);
        EXPECT_NEAR(here[row * kModelColumns + 4 + static_cast<std::size_t>(i)], difference, 0.03f * largest)
            << "row " << row << ", parameter " << i;
      }
    }
  });
}

// What a Laplace approximation promises: estimates from many noisy copies of one site scatter as far as the
// standard deviations say. 400 copies know a spread to 3.5 %; the rest of the margin is for what isn't
// Gaussian.
TEST_F(EveryTarget, StandardDeviationsAreTheScatterOfEstimates) {
  constexpr int kCopies = 400;
  std::vector<MadeUpSite> sites;
  sites.reserve(kCopies);
  for (int i = 0; i < kCopies; ++i)
    sites.emplace_back(gloss(), 5, 5, kNoise, 100u + static_cast<unsigned>(i));
  forEachTarget([&] {
    std::vector<SiteData> data;
    for (const MadeUpSite& site : sites) data.push_back(site.data);
    const std::vector<LobeParameters> start(data.size(), {std::log(0.05f), -1, 0.03f, -0.02f});
    std::vector<SiteSolution> found(data.size());
    solveSites(sites[0].setup, data, start, found);
    refitAlbedos(sites[0].setup, data, found);
    auto check = [&](const char* what, auto value, auto variance) {
      double sum = 0, square = 0, promised = 0;
      for (const SiteSolution& s : found) sum += value(s), promised += variance(s);
      const double mean = sum / kCopies;
      for (const SiteSolution& s : found) square += (value(s) - mean) * (value(s) - mean);
      EXPECT_NEAR(std::sqrt(square / (kCopies - 1)) / std::sqrt(promised / kCopies), 1, 0.15) << what;
    };
    constexpr int kDiagonal[4] = {0, 4, 7, 9};
    check(
        "log sigma", [](const SiteSolution& s) { return s.lobe.logSigma; },
        [&](const SiteSolution& s) { return s.lobeCovariance[kDiagonal[0]]; });
    check(
        "log(gamma - 1)", [](const SiteSolution& s) { return s.lobe.logKurtosis; },
        [&](const SiteSolution& s) { return s.lobeCovariance[kDiagonal[1]]; });
    check(
        "slope x", [](const SiteSolution& s) { return s.lobe.slopeX; },
        [&](const SiteSolution& s) { return s.lobeCovariance[kDiagonal[2]]; });
    check(
        "slope y", [](const SiteSolution& s) { return s.lobe.slopeY; },
        [&](const SiteSolution& s) { return s.lobeCovariance[kDiagonal[3]]; });
    for (int c = 0; c < 3; ++c) {
      check(
          "diffuse", [c](const SiteSolution& s) { return s.diffuse[c]; },
          [c](const SiteSolution& s) { return s.diffuseSd[c] * s.diffuseSd[c]; });
      check(
          "specular", [c](const SiteSolution& s) { return s.specular[c]; },
          [c](const SiteSolution& s) { return s.specularSd[c] * s.specularSd[c]; });
    }
  });
}

// What a saturated photograph spoilt may be anything: it must not be looked at, and the rest must still
// suffice.
TEST_F(EveryTarget, SpoiltComponentsAreLeftOut) {
  MadeUpSite clean(gloss(), 10, 10, kNoise, 9), spoilt(gloss(), 10, 10, kNoise, 9),
      other(gloss(), 10, 10, kNoise, 9);
  const std::vector<std::uint16_t> rows = {0, 5, 17, 18};
  for (const auto row : rows) {
    for (std::size_t c = 0; c < 3; ++c) {
      spoilt.z[row * 3u + c] = std::numeric_limits<float>::quiet_NaN();
      other.z[row * 3u + c] = 7;
    }
  }
  spoilt.data.dropped = other.data.dropped = rows;
  forEachTarget([&] {
    const LobeParameters start{std::log(0.1f), -3, 0, 0};
    SiteSolution found[3];
    const MadeUpSite* sites[3] = {&clean, &spoilt, &other};
    for (int i = 0; i < 3; ++i) solveSites(clean.setup, {&sites[i]->data, 1}, {&start, 1}, {&found[i], 1});
    EXPECT_EQ(found[1].outcome, SolveOutcome::Converged);
    EXPECT_EQ(found[1].cost, found[2].cost);
    EXPECT_NEAR(std::exp(found[1].lobe.logSigma), 0.06f, 0.002f);
    EXPECT_LT(found[1].dataCost, found[0].dataCost);  // twelve terms fewer
    EXPECT_GT(found[1].lobeCovariance[0], found[0].lobeCovariance[0]);
  });
}

TEST_F(EveryTarget, NonsenseFailsInsteadOfSpreading) {
  MadeUpSite good(gloss(), 0, 0, kNoise, 6), bad(gloss(), 0, 0, kNoise, 7);
  bad.z[5] = std::numeric_limits<float>::quiet_NaN();
  forEachTarget([&] {
    const SiteData data[2] = {bad.data, good.data};
    const LobeParameters start[2] = {{std::log(0.1f), -3, 0, 0}, {std::log(0.1f), -3, 0, 0}};
    SiteSolution found[2];
    solveSites(good.setup, data, start, found);
    EXPECT_EQ(found[0].outcome, SolveOutcome::Failed);
    EXPECT_EQ(found[1].outcome, SolveOutcome::Converged);
  });
}

}  // namespace
}  // namespace patina::test
