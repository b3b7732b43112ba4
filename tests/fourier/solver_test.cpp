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

  MadeUpSite(const SvbrdfParameters& p, double xMm, double yMm, float noise, unsigned seed) {
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
    const SiteLobe lobe = siteLobe(rig.frame, rig.site(xMm, yMm), p, LobeMapping::ExactMoments);
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
    data.geometry = rig.site(xMm, yMm);
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

TEST_F(EveryTarget, GradientMatchesDifferencesOfTheCost) {
  MadeUpSite site(gloss(), 10, 20, kNoise, 1);
  forEachTarget([&] {
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
