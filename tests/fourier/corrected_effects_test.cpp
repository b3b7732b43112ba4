// Captures that the simulator makes with an effect that nobody declares, fitted with the effect known and
// without: known, the maps are those of a capture that hasn't got it.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "devices/simulated/simulated_rig.h"
#include "engine/fourier/corrections.h"
#include "engine/fourier/fit_access.h"
#include "tests/base/temp_folder.h"

namespace patina::test {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

class CorrectedEffects : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TempFolder();
    base_ = fitOf(simulated("base", {}), {});
  }
  static void TearDownTestSuite() {
    base_ = {};
    delete folder_;
    folder_ = nullptr;
  }
  using Fit = std::shared_ptr<const FourierFit>;

  static FourierCapture simulated(const std::string& name, const SimulatedEffects& effects) {
    const SimulatedSheet sheet = simulatedScene("laminate");
    SimulatedCaptureOptions options;
    options.samplesPerPixelSide = 1;
    options.effects = effects;
    const auto report = simulateCapture(
        folder_->path() / name, SimulatedRig::desk(40, sheet.widthMm, sheet.heightMm), sheet, options, {});
    EXPECT_TRUE(report.ok()) << report.error().sentence();
    auto capture = readFourierCapture(folder_->path() / name);
    EXPECT_TRUE(capture.ok());
    return *capture;
  }
  static Fit fitOf(const FourierCapture& capture, FourierCorrections corrections) {
    FourierFitOptions options;
    options.corrections = std::make_shared<const FourierCorrections>(std::move(corrections));
    const auto fit = fitFourier(capture, options, {});
    EXPECT_TRUE(fit.ok()) << fit.error().sentence();
    return *fit;
  }
  static double excess(const Fit& fit) { return fit->stats().holdoutRms / fit->stats().noiseFloorHoldout; }

  /// How far a fit's sites are from the base fit's: medians, so that the few in a wrong minimum don't count.
  struct Gaps {
    double sigma, specular, diffuse, tiltDeg;
    double biasDeg;  ///< mean of the normals' slopes
  };
  template <typename Expected>
  static Gaps gapsOf(const Fit& fit, Expected expectedNormal) {
    const FourierFitState &a = fitState(*base_), &b = fitState(*fit);
    std::vector<double> gaps[4];
    Eigen::Vector2d bias = Eigen::Vector2d::Zero();
    for (std::size_t s = 0; s < a.sites.size(); ++s) {
      if (a.siteStatus[s] != TexelStatus::Converged) continue;
      const SvbrdfParameters &p = a.sites[s], &q = b.sites[s];
      gaps[0].push_back(std::abs(std::log(q.sigma / p.sigma)));
      gaps[1].push_back(std::abs(std::log(q.specular[1] / p.specular[1])));
      gaps[2].push_back(std::abs(q.diffuse[1] - p.diffuse[1]));
      const Eigen::Vector3f expected = expectedNormal(s, p.normal);
      gaps[3].push_back(std::acos(std::min(1.0f, q.normal.dot(expected))) / kDegree);
      bias += (q.normal.head<2>() / q.normal.z() - expected.head<2>() / expected.z()).cast<double>();
    }
    const auto median = [](std::vector<double>& values) {
      std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                       values.end());
      return values[values.size() / 2];
    };
    return {median(gaps[0]), median(gaps[1]), median(gaps[2]), median(gaps[3]),
            bias.norm() / static_cast<double>(gaps[0].size()) / kDegree};
  }
  static Gaps gapsOf(const Fit& fit) {
    return gapsOf(fit, [](std::size_t, const Eigen::Vector3f& normal) { return normal; });
  }
  static std::shared_ptr<const std::vector<SvbrdfParameters>> sitesOf(const Fit& fit) {
    return std::make_shared<const std::vector<SvbrdfParameters>>(fitState(*fit).sites);
  }
  static inline TempFolder* folder_ = nullptr;
  static inline Fit base_;
};

TEST_F(CorrectedEffects, AnUnevenScreen) {
  SimulatedEffects effects;
  effects.emissionSpatial = {.edges = 0.2, .gradient = 0.15, .gradientAngleDeg = 30};
  const FourierCapture capture = simulated("emission", effects);
  const Fit silent = fitOf(capture, {});
  const Eigen::Vector2d half = capture.screen.halfExtent();
  FourierCorrections corrections;
  corrections.logEmission = [=](const Eigen::Vector2d& x, const Eigen::Vector2d&, double) {
    const double along = (x.x() * std::cos(30 * kDegree) + x.y() * std::sin(30 * kDegree)) / half.x();
    return std::log((1 - 0.2 * x.squaredNorm() / half.squaredNorm()) * (1 + 0.15 * along));
  };
  const Gaps without = gapsOf(silent);
  for (const bool warm : {true, false}) {
    corrections.sites = warm ? sitesOf(silent) : nullptr;
    const Fit known = fitOf(capture, corrections);
    const Gaps with = gapsOf(known);
    EXPECT_LT(excess(known), 1.02 * excess(base_));
    EXPECT_LT(with.specular, 0.3 * without.specular);
    EXPECT_LT(with.tiltDeg, 0.5 * without.tiltDeg);
  }
}

TEST_F(CorrectedEffects, ABentSheet) {
  constexpr double kBendMm = 2, kAngleDeg = 20;
  SimulatedEffects effects;
  effects.sampleHeight = {.bendMm = kBendMm, .bendAngleDeg = kAngleDeg};
  const FourierCapture capture = simulated("height", effects);
  const double half = 0.5 * std::max(capture.sampleWidthMm, capture.sampleHeightMm);
  const Eigen::Vector2d direction(std::cos(kAngleDeg * kDegree), std::sin(kAngleDeg * kDegree));
  const auto height = [=](const Eigen::Vector2d& at) {
    return kBendMm * std::pow(at.dot(direction) / half, 2);
  };
  const auto gradient = [=](const Eigen::Vector2d& at) -> Eigen::Vector2d {
    return 2 * kBendMm * at.dot(direction) / (half * half) * direction;
  };
  const Eigen::Vector3d eye = capture.camera.positionMm();
  const auto seen = [=](const Eigen::Vector2d& plane) {
    const Eigen::Vector3d flat(plane.x(), plane.y(), 0);
    Eigen::Vector3d point = flat;
    for (int step = 0; step < 8; ++step) point = flat + (eye - flat) * (height(point.head<2>()) / eye.z());
    return point;
  };
  const Fit silent = fitOf(capture, {});
  FourierCorrections corrections;
  corrections.heightMm = [=](const Eigen::Vector2d& plane) { return seen(plane).z(); };
  corrections.sites = sitesOf(silent);
  const Fit known = fitOf(capture, corrections);
  const auto& points = fitState(*base_).measurements.sites.pointMm;
  const auto bent = [&](std::size_t s, const Eigen::Vector3f& normal) -> Eigen::Vector3f {
    const Eigen::Vector2f slope =
        normal.head<2>() / normal.z() - gradient(seen(points[s].cast<double>()).head<2>()).cast<float>();
    return Eigen::Vector3f(slope.x(), slope.y(), 1).normalized();
  };
  const Gaps without = gapsOf(silent, bent), with = gapsOf(known, bent);
  // Each pixel sees another place of the sheet than in the base capture, and that place's own relief: only
  // the mean can be compared.
  EXPECT_LT(with.biasDeg, 0.3 * without.biasDeg);
  EXPECT_LT(excess(known), 1.02 * excess(base_));
}

TEST_F(CorrectedEffects, ABrushedSheet) {
  constexpr double kRatio = 1.3, kAngleDeg = 25;
  SimulatedEffects effects;
  effects.anisotropy = {.ratio = kRatio, .angleDeg = kAngleDeg};
  const FourierCapture capture = simulated("anisotropy", effects);
  const Fit silent = fitOf(capture, {});
  FourierCorrections corrections;
  LobeTerms terms;
  terms.stretch[0] = static_cast<float>(std::log(kRatio) * std::cos(2 * kAngleDeg * kDegree));
  terms.stretch[1] = static_cast<float>(std::log(kRatio) * std::sin(2 * kAngleDeg * kDegree));
  corrections.lobeTerms = std::make_shared<const std::vector<LobeTerms>>(1, terms);
  for (const bool warm : {true, false}) {
    corrections.sites = warm ? sitesOf(silent) : nullptr;
    const Fit known = fitOf(capture, corrections);
    EXPECT_GT(excess(silent), 1.05 * excess(base_));
    EXPECT_LT(excess(known), 1.02 * excess(base_));
    EXPECT_LT(gapsOf(known).sigma, 0.03);
  }
}

TEST_F(CorrectedEffects, ABroadThirdLobe) {
  constexpr float kShare = 0.2f, kSigma = 0.25f;
  SimulatedEffects effects;
  effects.thirdLobe = {.share = kShare, .sigma = kSigma};
  const FourierCapture capture = simulated("third", effects);
  const Fit silent = fitOf(capture, {});
  FourierCorrections corrections;
  std::vector<LobeTerms> terms;
  for (const SvbrdfParameters& p : fitState(*base_).sites)
    terms.push_back({{0, 0}, kShare, kSigma / p.sigma});
  corrections.lobeTerms = std::make_shared<const std::vector<LobeTerms>>(std::move(terms));
  corrections.sites = sitesOf(silent);
  const Fit known = fitOf(capture, corrections);
  const Gaps without = gapsOf(silent), with = gapsOf(known);
  EXPECT_LT(with.specular, 0.5 * without.specular);
  EXPECT_LT(excess(known), 1.02 * excess(base_));
  // One element too few is no list of sites.
  FourierFitOptions options;
  corrections.lobeTerms = std::make_shared<const std::vector<LobeTerms>>(2);
  options.corrections = std::make_shared<const FourierCorrections>(corrections);
  const auto refused = fitFourier(capture, options, {});
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, ErrorCode::Invalid);
}

}  // namespace
}  // namespace patina::test
