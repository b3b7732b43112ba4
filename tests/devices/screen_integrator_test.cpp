#include "devices/simulated/screen_integrator.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <numbers>

#include "devices/simulated/simulated_rig.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;

/// The reference: the rendering equation summed over small squares of the screen in millimetres and the
/// world's frame, in double, the BRDF written with angles. Shares no formula layout and no grid with the code
/// under test.
struct Reference {
  Screen screen;
  Eigen::Vector3d point, toView;
  SheetPoint material;

  struct Shown {
    Eigen::Vector2d frequency;
    int phase;  ///< -1: the window alone
  };

  /// Diffuse and specular radiance of each pattern, with `across` squares over the screen's width.
  std::vector<std::array<double, 2>> radiance(const std::vector<Shown>& patterns, int across) const {
    const int down = static_cast<int>(std::lround(across / screen.aspect()));
    const double side = screen.widthMm / across, sideY = screen.heightMm / down;
    const double g = material.kurtosis, c = std::sqrt(2 / (1 / (g * g) + g * g));
    std::vector<std::array<double, 2>> sums(patterns.size(), {0, 0});
    for (int j = 0; j < down; ++j)
      for (int i = 0; i < across; ++i) {
        const double xMm = -0.5 * screen.widthMm + (i + 0.5) * side,
                     yMm = -0.5 * screen.heightMm + (j + 0.5) * sideY;
        const double x = kPi * xMm / (screen.widthMm / 2), y = kPi * yMm / (screen.widthMm / 2);
        const Eigen::Vector3d from = screen.worldFromScreen * Eigen::Vector3d(xMm, yMm, 0) + screen.originMm;
        const double distance = (from - point).norm();
        const Eigen::Vector3d toLight = (from - point) / distance, half = (toLight + toView).normalized();
        const double cosLight = toLight.dot(material.normal), cosView = toView.dot(material.normal);
        const double cosScreen = -toLight.dot(screen.worldFromScreen.col(2));
        if (cosLight <= 0 || cosScreen <= 0) continue;
        double emitted = std::exp(-0.5 * std::pow(x / screen.windowSigma.x(), 2) -
                                  0.5 * std::pow(y / screen.windowSigma.y(), 2));
        if (screen.emission) {  // the screen point's place seen from the eye's foot, at unit height
          const Eigen::Vector3d aside = -toLight / cosScreen;
          const double qx = (-aside.dot(screen.worldFromScreen.col(0)) - screen.emission->mean.x()) /
                            screen.emission->sigma.x();
          const double qy = (-aside.dot(screen.worldFromScreen.col(1)) - screen.emission->mean.y()) /
                            screen.emission->sigma.y();
          emitted *= screen.emission->gain * std::exp(-0.5 * (qx * qx + qy * qy));
        }
        const double light = emitted * cosLight * cosScreen * side * sideY / (distance * distance);
        const double cosHalf = half.dot(material.normal),
                     tangent = std::tan(std::acos(std::min(1.0, cosHalf)));
        double slopes = 0;
        for (double s : {c * material.sigma / g, c * material.sigma * g})
          slopes += 0.5 * std::exp(-0.5 * std::pow(tangent / s, 2)) / (2 * kPi * s * s);
        const double schlick = 0.06 + 0.94 * std::pow(1 - toLight.dot(half), 5);
        const double lobe = slopes / std::pow(cosHalf, 4) * schlick / 0.06 / (4 * cosLight * cosView);
        for (std::size_t p = 0; p < patterns.size(); ++p) {
          const double phase =
              patterns[p].frequency.x() * x + patterns[p].frequency.y() * y + patterns[p].phase * kPi / 2;
          const double shown = patterns[p].phase < 0 ? 1.0 : std::max(0.0, std::sin(phase));
          sums[p][0] += shown * light / kPi;
          sums[p][1] += shown * light * lobe;
        }
      }
    return sums;
  }
};

const std::vector<Eigen::Vector2i> kFrequencies{{1, 0}, {0, 3}, {6, -6}, {20, 0}, {12, -5}, {40, 40}};

struct Scene {
  const char* name;
  double sigma, kurtosis;
  Eigen::Vector3d normal;
  Eigen::Vector2d at;
};

class IntegratorAgainstReference : public testing::TestWithParam<Scene> {};

// Of the window's response: a tenth of the smallest noise of the default sensor at full scale would be 4e-4.
constexpr double kTolerance = 4e-4;

TEST_P(IntegratorAgainstReference, AgreesForEveryPattern) {
  const Scene& scene = GetParam();
  const SimulatedRig rig = SimulatedRig::desk(64, 120, 120);
  Reference reference{rig.screen, Eigen::Vector3d(scene.at.x(), scene.at.y(), 0), {}, {}};
  reference.toView = (rig.camera.positionMm() - reference.point).normalized();
  reference.material.sigma = scene.sigma;
  reference.material.kurtosis = scene.kurtosis;
  reference.material.normal = scene.normal.normalized();
  reference.material.diffuse = reference.material.specular = Eigen::Array3d::Ones();

  ScreenIntegrator integrator(rig.screen, kFrequencies, IntegrationQuality{});
  const int level = integrator.finestLevel(reference.point, reference.toView, reference.material);
  ASSERT_GE(level, 0);
  ASSERT_TRUE(integrator.prepare(level, {}));
  const PointResponse got = integrator.respond(reference.point, reference.toView, reference.material);

  constexpr int kAcross = 2304;  // finer than and incommensurate with the cells under test
  std::vector<Reference::Shown> shown{{{0, 0}, -1}};
  for (std::size_t f = 0; f < kFrequencies.size(); ++f)
    shown.push_back({kFrequencies[f].cast<double>(), static_cast<int>(f) % 4});
  const auto expected = reference.radiance(shown, kAcross);
  const auto whole = expected[0];
  ASSERT_GT(whole[0], 0);
  const int window = integrator.patternCount() - 1;
  double worstDiffuse = 0, worstSpecular = 0;
  for (std::size_t p = 0; p < shown.size(); ++p) {
    const int column = p == 0 ? window : static_cast<int>(4 * (p - 1)) + shown[p].phase;
    EXPECT_NEAR(got.diffuse[column], expected[p][0], kTolerance * whole[0])
        << "diffuse, frequency " << shown[p].frequency.transpose();
    EXPECT_NEAR(got.specular[column], expected[p][1], kTolerance * whole[1])
        << "lobe, frequency " << shown[p].frequency.transpose();
    worstDiffuse = std::max(worstDiffuse, std::abs(got.diffuse[column] - expected[p][0]) / whole[0]);
    worstSpecular = std::max(worstSpecular, std::abs(got.specular[column] - expected[p][1]) / whole[1]);
  }
  RecordProperty("worstDiffuse", std::to_string(worstDiffuse));
  RecordProperty("worstSpecular", std::to_string(worstSpecular));
}

INSTANTIATE_TEST_SUITE_P(Materials, IntegratorAgainstReference,
                         testing::Values(Scene{"mirror", 0.02, 1.5, {0.02, -0.03, 1}, {10, -20}},
                                         Scene{"gloss", 0.05, 1.5, {-0.05, 0.04, 1}, {-40, 30}},
                                         Scene{"satin", 0.14, 1.2, {0.03, 0.02, 1}, {55, 55}},
                                         Scene{"broad", 0.32, 1.1, {0.1, -0.1, 1}, {-55, -50}},
                                         Scene{"tilted_off_screen", 0.06, 1.3, {0.25, -0.2, 1}, {0, 0}},
                                         Scene{"single_lobe", 0.09, 1.0, {0, 0, 1}, {0, 0}}),
                         [](const auto& info) { return std::string(info.param.name); });

TEST(ScreenIntegrator, PhasesSumToRectifiedPatterns) {
  // sin+ and -sin+ add up to |sin|; |sin w| and |cos w| add up to more than the window and less than sqrt(2)
  // of it.
  const SimulatedRig rig = SimulatedRig::desk(64, 120, 120);
  ScreenIntegrator integrator(rig.screen, kFrequencies, IntegrationQuality{});
  SheetPoint material;
  material.sigma = 0.05;
  material.diffuse = material.specular = Eigen::Array3d::Ones();
  const Eigen::Vector3d point(0, 0, 0), toView = rig.camera.positionMm().normalized();
  ASSERT_TRUE(integrator.prepare(integrator.finestLevel(point, toView, material), {}));
  const PointResponse got = integrator.respond(point, toView, material);
  for (const Eigen::ArrayXf* response : {&got.diffuse, &got.specular})
    for (std::size_t f = 0; f < kFrequencies.size(); ++f) {
      const float sum = response->segment(static_cast<Eigen::Index>(4 * f), 4).sum();
      const float window = (*response)[integrator.patternCount() - 1];
      EXPECT_GT(sum, window * 0.9999f);
      EXPECT_LT(sum, window * 1.4143f);
    }
}

TEST(ScreenIntegrator, SaysWhenALobeIsTooNarrow) {
  const SimulatedRig rig = SimulatedRig::desk(64, 120, 120);
  const ScreenIntegrator integrator(rig.screen, kFrequencies, IntegrationQuality{});
  SheetPoint material;
  material.specular = Eigen::Array3d::Ones();
  const Eigen::Vector3d toView = rig.camera.positionMm().normalized();
  material.sigma = 0.008;
  EXPECT_GE(integrator.finestLevel(Eigen::Vector3d::Zero(), toView, material), 0);
  material.sigma = 0.0005;
  EXPECT_EQ(integrator.finestLevel(Eigen::Vector3d::Zero(), toView, material), -1);
}

TEST(ScreenIntegrator, DarkBehindTheScreenAndBelowTheHorizon) {
  const SimulatedRig rig = SimulatedRig::desk(64, 120, 120);
  ScreenIntegrator integrator(rig.screen, kFrequencies, IntegrationQuality{});
  SheetPoint material;
  material.diffuse = material.specular = Eigen::Array3d::Ones();
  ASSERT_TRUE(integrator.prepare(
      integrator.finestLevel(Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ(), material), {}));
  const Eigen::Vector3d behind = rig.screen.originMm - 50 * rig.screen.worldFromScreen.col(2);
  EXPECT_EQ(integrator.respond(behind, Eigen::Vector3d::UnitZ(), material).diffuse.abs().maxCoeff(), 0);
  EXPECT_EQ(integrator.respond(behind, Eigen::Vector3d::UnitZ(), material).specular.abs().maxCoeff(), 0);
  material.normal = -Eigen::Vector3d::UnitZ();  // the camera looks at its back
  EXPECT_EQ(integrator.respond(Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ(), material)
                .diffuse.abs()
                .maxCoeff(),
            0);
}

}  // namespace
}  // namespace patina
