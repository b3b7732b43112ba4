// The lobe's Gaussians against a brute-force integral over the screen that shares no formula with them.
#include <gtest/gtest.h>

#include <complex>
#include <numbers>

#include "tests/fourier/brute_force.h"

namespace patina::test {
namespace {

const std::vector<Eigen::Vector2d> kFrequencies = {{0, 0}, {1, 0}, {0, 1},   {2, -2}, {3, 3},
                                                   {6, 0}, {0, 6}, {10, 10}, {20, 0}};

/// Root mean square error over frequencies, relative to the zero frequency.
double errorOf(LobeMapping mapping, float sigma, double xMm, double yMm, Eigen::Vector3f normal) {
  const Rig rig;
  SvbrdfParameters p;
  p.sigma = sigma;
  p.kurtosis = 1.2f;
  p.normal = normal.normalized();
  // A lobe that the rim cuts is another matter: such texels are marked, not measured.
  const Eigen::Vector2f mirror = mirrorOnScreen(rig.frame, rig.site(xMm, yMm), p.normal);
  EXPECT_LT(std::abs(mirror.x()), 2.9f);
  EXPECT_LT(std::abs(mirror.y()), 1.5f);
  const auto truth = bruteForce(rig, {xMm, yMm, 0}, p, kFrequencies, sigma < 0.04f ? 1400 : 500);
  const SiteLobe lobe = siteLobe(rig.frame, rig.site(xMm, yMm), p, mapping);
  double sum = 0;
  for (std::size_t f = 0; f < kFrequencies.size(); ++f)
    sum += std::norm(Complex(lobe.transform(kFrequencies[f].cast<float>())) - truth[f]);
  return std::sqrt(sum / static_cast<double>(kFrequencies.size())) / std::abs(truth[0]);
}

// A tenth of what one photograph's noise of 0.5 % does to Z: below it, the approximation can't be seen in one
// texel.
constexpr double kInvisible = 5e-4;

TEST(LobeKernel, MatchesBruteForceAtEveryWidth) {
  for (const float sigma : {0.02f, 0.05f, 0.1f, 0.2f, 0.3f}) {
    for (const auto& [x, y] : {std::pair{0.0, 0.0}, {55.0, 55.0}, {-50.0, 10.0}}) {
      EXPECT_LT(errorOf(LobeMapping::ExactMoments, sigma, x, y, {0.03f, -0.05f, 1}), kInvisible)
          << "sigma " << sigma << " at " << x << ", " << y;
    }
  }
}

TEST(LobeKernel, PaperMappingIsWithinItsKnownErrorAndWorse) {
  // The first-order map at the mirror point: a few percent for broad lobes. It must neither break nor be
  // mistaken for the exact one.
  for (const float sigma : {0.05f, 0.1f, 0.3f}) {
    const double paper = errorOf(LobeMapping::PaperAffine, sigma, 0, 0, {0.03f, -0.05f, 1});
    EXPECT_LT(paper, 0.03) << sigma;
    EXPECT_GT(paper, 5 * errorOf(LobeMapping::ExactMoments, sigma, 0, 0, {0.03f, -0.05f, 1})) << sigma;
  }
}

TEST(LobeKernel, StaysFiniteForNormalsThatMirrorNothing) {
  const Rig rig;
  for (const float sigma : {0.002f, 0.05f, 1.0f}) {
    for (float slope = -1.5f; slope <= 1.5f; slope += 0.25f) {
      SvbrdfParameters p;
      p.sigma = sigma;
      p.kurtosis = 4;
      p.normal = Eigen::Vector3f(slope, -slope, 1).normalized();
      for (const auto mapping : {LobeMapping::ExactMoments, LobeMapping::PaperAffine}) {
        const auto value = siteLobe(rig.frame, rig.site(40, -40), p, mapping).transform({3, 1});
        EXPECT_TRUE(std::isfinite(value.real()) && std::isfinite(value.imag())) << sigma << " " << slope;
      }
    }
  }
}

// The kernel's text again, in double, to look at derivatives that SiteLobe doesn't carry.
inline double vexp(double x) {
  return std::exp(x);
}
inline double vsqrt(double x) {
  return std::sqrt(x);
}
inline double vinv(double x) {
  return 1 / x;
}
inline double vrsqrt(double x) {
  return 1 / std::sqrt(x);
}
inline double vmax(double a, double b) {
  return a > b ? a : b;
}
inline double vmin(double a, double b) {
  return a < b ? a : b;
}
#include "engine/fourier/lobe_kernel.inc"

std::vector<double> numbersOf(const LobeMoments<double>& m) {
  std::vector<double> all = {m.mass, m.meanX, m.meanY, m.xx, m.xy, m.yy};
  all.insert(all.end(), m.third, m.third + 4);
  all.insert(all.end(), m.fourth, m.fourth + 5);
  return all;
}
std::vector<double> derivativesOf(const LobeMoments<double>& m, int p) {
  std::vector<double> all = {m.dMass[p], m.dMeanX[p], m.dMeanY[p], m.dXx[p], m.dXy[p], m.dYy[p]};
  all.insert(all.end(), m.dThird[p], m.dThird[p] + 4);
  all.insert(all.end(), m.dFourth[p], m.dFourth[p] + 5);
  return all;
}

template <int kTerms>
void expectDerivativesOfDifferences() {
  const Rig rig;
  float rows[3][3];
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < 3; ++j) rows[k][j] = static_cast<float>(rig.frame.screenFromWorld(j, k));
  const SiteGeometry g = rig.site(20, -30);
  const LobeShape shape = lobeShape({{0.3f, -0.2f}, 0, 1});
  const LobeSite<double> site{g.distance,   g.viewX,           g.viewY,           g.viewZ,     g.lightMeanX,
                              g.lightMeanY, g.lightPrecisionX, g.lightPrecisionY, g.lightPeak, 0.15,
                              shape.along,  shape.mixed,       shape.across};
  for (const double sigma : {0.03, 0.1, 0.25}) {
    auto momentsAt = [&](double logSigma, double sx, double sy) {
      return lobeMoments<kTerms>(site, normalFromSlopes(sx, sy, rows), std::exp(logSigma));
    };
    const double at[3] = {std::log(sigma), 0.04, -0.06};
    const auto here = momentsAt(at[0], at[1], at[2]);
    for (int p = 0; p < 3; ++p) {
      double up[3] = {at[0], at[1], at[2]}, down[3] = {at[0], at[1], at[2]};
      const double h = p == 0 ? 1e-4 : 1e-4 * sigma;
      up[p] += h;
      down[p] -= h;
      const auto high = numbersOf(momentsAt(up[0], up[1], up[2])),
                 low = numbersOf(momentsAt(down[0], down[1], down[2]));
      const auto derivative = derivativesOf(here, p);
      const auto value = numbersOf(here);
      // Scores are integrated, not the rule differentiated: they agree as far as the rule is exact. Moments
      // of order k are compared on the scale of width^k; the fourth ones come from the rule's last digits.
      const double width = std::sqrt(here.xx + here.yy) / (p == 0 ? 1 : sigma);
      const double lobe = std::sqrt(here.xx + here.yy);
      for (std::size_t i = 0; i < derivative.size(); ++i) {
        const double scale = i == 0   ? value[0] / (p == 0 ? 1 : sigma)
                             : i < 3  ? width
                             : i < 6  ? width * lobe
                             : i < 10 ? width * lobe * lobe
                                      : width * lobe * lobe * lobe;
        // the fourth cumulants' own effect is a twenty-fourth
        const double tolerance = i < 3 ? 2e-3 : i < 6 ? 1e-2 : i < 10 ? 2e-2 : 1e-1;
        EXPECT_NEAR(derivative[i], (high[i] - low[i]) / (2 * h), tolerance * scale)
            << "sigma " << sigma << " parameter " << p << " moment " << i;
      }
    }
  }
}

TEST(LobeKernel, DerivativesMatchDifferences) {
  expectDerivativesOfDifferences<kPlainLobe>();
}
TEST(LobeKernel, DerivativesMatchDifferencesUnderSkewedLight) {
  expectDerivativesOfDifferences<kSkewedLight>();
}
TEST(LobeKernel, DerivativesMatchDifferencesOfAStretchedLobe) {
  expectDerivativesOfDifferences<kShapedLobe>();
}

TEST(LobeKernel, TermsThatAreNoneChangeNothing) {
  const Rig rig;
  float rows[3][3];
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < 3; ++j) rows[k][j] = static_cast<float>(rig.frame.screenFromWorld(j, k));
  const SiteGeometry g = rig.site(20, -30);
  const LobeSite<double> site{g.distance,
                              g.viewX,
                              g.viewY,
                              g.viewZ,
                              g.lightMeanX,
                              g.lightMeanY,
                              g.lightPrecisionX,
                              g.lightPrecisionY,
                              g.lightPeak,
                              0,
                              1,
                              0,
                              1};
  const auto frame = normalFromSlopes(0.04, -0.06, rows);
  const auto plain = lobeMoments(site, frame, 0.1), shaped = lobeMoments<kShapedLobe>(site, frame, 0.1);
  const auto a = numbersOf(plain), b = numbersOf(shaped);
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(b[i], a[i], 1e-6 * std::abs(a[i])) << i;
  for (int p = 0; p < 3; ++p) {
    const auto c = derivativesOf(plain, p), d = derivativesOf(shaped, p);
    for (std::size_t i = 0; i < c.size(); ++i)
      EXPECT_NEAR(d[i], c[i], 1e-6 * std::abs(c[i]) + 1e-12) << p << " " << i;
  }
}

TEST(LobeKernel, StretchedAndThirdLobesMatchBruteForce) {
  const Rig rig;
  SvbrdfParameters p;
  p.kurtosis = 1.2f;
  p.normal = Eigen::Vector3f(0.06f, -0.05f, 1).normalized();
  for (const float sigma : {0.04f, 0.08f, 0.14f}) {
    p.sigma = sigma;
    for (const LobeTerms& terms : {LobeTerms{{0.3f, 0.0f}, 0, 1}, LobeTerms{{-0.2f, 0.35f}, 0, 1},
                                   LobeTerms{{0, 0}, 0.2f, 2.0f}, LobeTerms{{0.1f, -0.2f}, 0.15f, 1.8f}}) {
      const auto truth = bruteForce(rig, {20, 10, 0}, p, kFrequencies, 600, {}, terms);
      SiteGeometry site = rig.site(20, 10);
      const auto error = [&] {
        const SiteLobe lobe = siteLobe(rig.frame, site, p, LobeMapping::ExactMoments);
        double sum = 0;
        for (std::size_t f = 0; f < kFrequencies.size(); ++f)
          sum += std::norm(Complex(lobe.transform(kFrequencies[f].cast<float>())) - truth[f]);
        return std::sqrt(sum / static_cast<double>(kFrequencies.size())) / std::abs(truth[0]);
      };
      const double without = error();
      site.lobe = terms;
      EXPECT_LT(error(), kInvisible) << sigma << " " << terms.stretch[0] << " " << terms.thirdShare;
      EXPECT_GT(without, 10 * error()) << sigma << " " << terms.stretch[0] << " " << terms.thirdShare;
    }
  }
}

}  // namespace
}  // namespace patina::test
