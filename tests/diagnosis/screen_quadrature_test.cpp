#include "engine/diagnosis/screen_quadrature.h"

#include <gtest/gtest.h>

#include <cmath>

#include "engine/fourier/diffuse_transform.h"
#include "tests/fourier/rig.h"

namespace patina::test {
namespace {

using namespace quadrature;

const std::vector<Eigen::Vector2i> kFrequencies = {{1, 0},  {0, 2},  {3, 3},  {6, -6},
                                                   {10, 0}, {0, 20}, {40, 40}};
const Eigen::Vector2d kSample(120, 120);

struct Columns {
  std::vector<float> data;
  int rows;
  Columns(const ScreenQuadrature& quad, const QuadratureSite& site, Want want)
      : data(static_cast<std::size_t>(kColumns * quad.rowCount())), rows(quad.rowCount()) {
    quad.evaluate(site, want, data.data());
  }
  float at(int column, int row) const { return data[static_cast<std::size_t>(column * rows + row)]; }
  double largest(int column) const {
    double most = 0;
    for (int r = 0; r < rows; ++r) most = std::max(most, std::abs(static_cast<double>(at(column, r))));
    return most;
  }
};

QuadratureSite siteOf(const Rig& rig, double x, double y, float sigma) {
  QuadratureSite site;
  site.geometry = rig.site(x, y);
  site.pointMm = {static_cast<float>(x), static_cast<float>(y)};
  site.slopeX = 0.03f;
  site.slopeY = -0.02f;
  site.sigma = sigma;
  site.kurtosis = 1.3f;
  return site;
}

/// Brute force over the screen: the integrand of docs/fourier_fit.md on a fine regular grid, in double
/// precision.
struct BruteForce {
  double diffuse = 0, specular = 0;
};
BruteForce bruteForce(const Rig& rig, const QuadratureSite& site, Eigen::Vector2i frequency, int phase) {
  constexpr int kAcross = 1400, kUp = 800;
  const ScreenFrame& frame = rig.frame;
  const SiteGeometry& g = site.geometry;
  const double d = g.distance;
  const Eigen::Vector3d view(g.viewX, g.viewY, g.viewZ);
  const Eigen::Vector3d n = frame.screenFromWorld * Eigen::Vector3d(site.slopeX, site.slopeY, 1).normalized();
  const double gamma = site.kurtosis, c = std::sqrt(2 / (1 / (gamma * gamma) + gamma * gamma));
  const double sigma[2] = {c * site.sigma / gamma, c * site.sigma * gamma};
  const double area = 4 * frame.halfExtent.x() * frame.halfExtent.y() / (kAcross * kUp);
  const Eigen::Vector3d up = frame.screenFromWorld.col(2);
  BruteForce sum;
  for (int j = 0; j < kUp; ++j) {
    for (int i = 0; i < kAcross; ++i) {
      const double x = ((i + 0.5) / kAcross * 2 - 1) * frame.halfExtent.x(),
                   y = ((j + 0.5) / kUp * 2 - 1) * frame.halfExtent.y();
      const double angle = frequency.x() * x + frequency.y() * y + phase * 1.5707963267948966;
      const double shown =
          std::max(0.0, std::sin(angle)) *
          std::exp(-0.5 * (frame.windowPrecision.x() * x * x + frame.windowPrecision.y() * y * y));
      const double lx = x - g.footX, ly = y - g.footY, length = std::sqrt(lx * lx + ly * ly + d * d);
      const double ex = lx / d - frame.emissionMean.x(), ey = ly / d - frame.emissionMean.y();
      const double light =
          shown * frame.emissionGain *
          std::exp(-0.5 * (frame.emissionPrecision.x() * ex * ex + frame.emissionPrecision.y() * ey * ey)) *
          d / (length * length * length) * area;
      const Eigen::Vector3d toLight(lx / length, ly / length, -d / length);
      if (up.dot(toLight) < site.horizonSine) continue;  // a hard edge
      sum.diffuse += light * std::max(0.0, n.dot(toLight)) / 3.141592653589793;
      const Eigen::Vector3d h = (toLight + view).normalized();
      const double nh = n.dot(h), slope2 = 1 / (nh * nh) - 1;
      double density = 0;
      for (const double s : sigma)
        density += 0.5 * std::exp(-0.5 * slope2 / (s * s)) / (6.283185307179586 * s * s);
      const double fresnel = (0.06 + 0.94 * std::pow(1 - h.dot(view), 5)) / 0.06;
      sum.specular += light * density * fresnel / (std::pow(nh, 4) * 4 * n.dot(view));
    }
  }
  return sum;
}

TEST(ScreenQuadrature, AgreesWithBruteForceOverTheScreen) {
  const Rig rig;
  const ScreenQuadrature quad(rig.frame, kSample, kFrequencies, {});
  for (const float sigma : {0.04f, 0.12f}) {
    const QuadratureSite site = siteOf(rig, 12, -20, sigma);
    const Columns got(quad, site, kPrediction);
    const double diffuseScale = got.largest(kDiffuse), specularScale = got.largest(kSpecularStart);
    for (const int f : {0, 2, 4}) {
      for (int phase = 0; phase < 2; ++phase) {
        const BruteForce want = bruteForce(rig, site, kFrequencies[static_cast<std::size_t>(f)], phase);
        // A thousandth: the rectified sine's kink limits both sides.
        EXPECT_NEAR(got.at(kDiffuse, 4 * f + phase), want.diffuse, 1e-3 * diffuseScale) << sigma << " " << f;
        EXPECT_NEAR(got.at(kSpecularStart, 4 * f + phase), want.specular, 1e-3 * specularScale)
            << sigma << " " << f;
      }
    }
  }
}

TEST(ScreenQuadrature, AHorizonCutsTheScreenAsSharplyAsTheNodesAllow) {
  const Rig rig;
  const ScreenQuadrature quad(rig.frame, kSample, kFrequencies, {});
  for (const float sigma : {0.04f, 0.12f}) {
    QuadratureSite site = siteOf(rig, 12, -20, sigma);
    const Columns whole(quad, site, kPrediction);
    site.horizonSine = 0.69f;  // 44 degrees: through the lobe
    const Columns got(quad, site, kPrediction);
    const double diffuseScale = whole.largest(kDiffuse), specularScale = whole.largest(kSpecularStart);
    double hidden = 0;
    for (const int f : {0, 2, 4}) {
      for (int phase = 0; phase < 2; ++phase) {
        const BruteForce want = bruteForce(rig, site, kFrequencies[static_cast<std::size_t>(f)], phase);
        EXPECT_NEAR(got.at(kDiffuse, 4 * f + phase), want.diffuse, 0.01 * diffuseScale) << sigma << " " << f;
        EXPECT_NEAR(got.at(kSpecularStart, 4 * f + phase), want.specular, 0.02 * specularScale)
            << sigma << " " << f;
        hidden = std::max(hidden, std::abs(whole.at(kSpecularStart, 4 * f + phase) - want.specular));
      }
    }
    EXPECT_GT(hidden, 0.1 * specularScale);  // else the test shows nothing
    // By the horizon's sine.
    const Columns all(quad, site, kEverything);
    QuadratureSite higher = site, lower = site;
    higher.horizonSine += 0.003f, lower.horizonSine -= 0.003f;
    const Columns a(quad, higher, kPrediction), b(quad, lower, kPrediction);
    const int column = kSpecularStart + kSpecularLight + kHorizonAt;
    for (int r = 0; r < all.rows; ++r)
      EXPECT_NEAR(all.at(column, r), (a.at(kSpecularStart, r) - b.at(kSpecularStart, r)) / 0.006,
                  0.05 * all.largest(column))
          << r;
  }
}

TEST(ScreenQuadrature, DerivativesAgreeWithDifferences) {
  const Rig rig;
  const ScreenQuadrature quad(rig.frame, kSample, kFrequencies, {});
  const QuadratureSite site = siteOf(rig, -15, 10, 0.09f);
  const Columns all(quad, site, kEverything);
  const auto check = [&](auto change, float step, int column, const char* name) {
    QuadratureSite up = site, down = site;
    change(up, step);
    change(down, -step);
    const Columns a(quad, up, kPrediction), b(quad, down, kPrediction);
    const int base = column < kSpecularStart ? static_cast<int>(kDiffuse) : kSpecularStart;
    for (int r = 0; r < all.rows;
         ++r)  // two hundredths: differences of floats over a step that must be small
      EXPECT_NEAR(all.at(column, r), (a.at(base, r) - b.at(base, r)) / (2 * step), 0.02 * all.largest(column))
          << name << " row " << r;
  };
  check([](QuadratureSite& s, float h) { s.slopeX += h; }, 0.004f, kSpecularStart + kSpecularSlopeX,
        "slope x");
  check([](QuadratureSite& s, float h) { s.slopeY += h; }, 0.004f, kSpecularStart + kSpecularSlopeY,
        "slope y");
  check([](QuadratureSite& s, float h) { s.slopeY += h; }, 0.01f, kDiffuseSlopeY, "diffuse, slope y");
  check([](QuadratureSite& s, float h) { s.sigma *= std::exp(h); }, 0.03f, kSpecularStart + kSpecularLogSigma,
        "log sigma");
  check([](QuadratureSite& s, float h) { s.stretch1 += h; }, 0.05f, kSpecularStart + kStretch1, "stretch 1");
  check([](QuadratureSite& s, float h) { s.stretch2 += h; }, 0.05f, kSpecularStart + kStretch2, "stretch 2");
  check([](QuadratureSite& s, float h) { s.fresnelPower += h; }, 0.2f, kSpecularStart + kFresnelPower,
        "Fresnel power");
  check([](QuadratureSite& s, float h) { s.freeForm[1] += h; }, 0.05f, kSpecularStart + kFreeForm + 1,
        "free form");
}

TEST(ScreenQuadrature, EffectsOfTheScreenAreTheDerivativesOfTheirStrength) {
  const Rig rig;
  const QuadratureSite site = siteOf(rig, 5, 15, 0.1f);
  const ScreenQuadrature quad(rig.frame, kSample, kFrequencies, {});
  const Columns all(quad, site, kEverything);
  const auto check = [&](auto change, float step, int light, bool shape, const char* name) {
    QuadratureState up, down;
    change(up, step);
    change(down, -step);
    const Columns a(ScreenQuadrature(rig.frame, kSample, kFrequencies, up), site, kPrediction);
    const Columns b(ScreenQuadrature(rig.frame, kSample, kFrequencies, down), site, kPrediction);
    for (int r = 0; r < all.rows; ++r) {
      const double specular = all.at(kSpecularStart + kSpecularLight + light, r) +
                              (shape ? all.at(kShapeStart + kShapeSpecular, r) : 0);
      EXPECT_NEAR(specular, (a.at(kSpecularStart, r) - b.at(kSpecularStart, r)) / (2 * step),
                  2e-3 * all.largest(kSpecularStart))
          << name << " row " << r;
      const double diffuse =
          all.at(kDiffuseLight + light, r) + (shape ? all.at(kShapeStart + kShapeDiffuse, r) : 0);
      EXPECT_NEAR(diffuse, (a.at(kDiffuse, r) - b.at(kDiffuse, r)) / (2 * step), 2e-3 * all.largest(kDiffuse))
          << name << " row " << r;
    }
  };
  check([](QuadratureState& s, float h) { s.angular[1] += h; }, 0.05f, kAngularAt + 1, false, "angular v^2");
  check([](QuadratureState& s, float h) { s.angular[4] += h; }, 0.05f, kAngularAt + 4, false, "angular bump");
  check([](QuadratureState& s, float h) { s.spatial[3] += h; }, 0.05f, kSpatialAt + 3, false, "spatial x y");
  check([](QuadratureState& s, float h) { s.screenGamma += h; }, 0.02f, kWindowAt, true, "gamma");
}

TEST(ScreenQuadrature, PhotographsOfTheFourPhasesSumToTwiceTheEvenPart) {
  // sin+(t) + sin+(t + pi) = |sin t|, whatever the material: the sum of all four stays within its range.
  const Rig rig;
  const ScreenQuadrature quad(rig.frame, kSample, kFrequencies, {});
  const QuadratureSite site = siteOf(rig, 0, 0, 0.06f);
  const Columns got(quad, site, kPrediction);
  const int window = got.rows - 1;
  for (std::size_t f = 0; f < kFrequencies.size(); ++f) {
    double sum = 0;
    for (int k = 0; k < 4; ++k) sum += got.at(kSpecularStart, static_cast<int>(4 * f) + k);
    EXPECT_GT(sum, 0.999 * got.at(kSpecularStart, window));
    EXPECT_LT(sum, 1.415 * got.at(kSpecularStart, window));
  }
}

}  // namespace
}  // namespace patina::test
