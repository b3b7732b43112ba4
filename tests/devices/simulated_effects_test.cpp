#include "devices/simulated/simulated_effects.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "devices/simulated/light_kernel.h"
#include "devices/simulated/sheet_form.h"
#include "devices/simulated/simulated_rig.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;

SimulatedSheet plain() {
  SimulatedSheet sheet;
  sheet.slopeRms = sheet.albedoVariation = sheet.sigmaVariation = 0;
  return sheet;
}

SimulatedCaptureOptions quick() {
  SimulatedCaptureOptions options;
  options.fitted = {{1, 0}, {0, 4}, {6, 6}};
  options.heldOut = {{2, -3}};
  options.samplesPerPixelSide = 1;
  return options;
}

// ---- the description ----

TEST(SimulatedEffects, NothingIsOnByDefaultAndEveryStrengthSwitchesItsEffectOn) {
  EXPECT_TRUE(SimulatedEffects{}.none());
  EXPECT_GE(simulatedEffectFields().size(), 60u);
  for (const SimulatedEffectField& field : simulatedEffectFields()) {
    SimulatedEffects effects;
    EXPECT_EQ(field.get(effects), field.none) << field.id << "." << field.name;
    field.of(effects) =
        0.5 * (field.least + field.most) != field.none ? 0.5 * (field.least + field.most) : field.most;
    const std::vector<std::string> expected =
        field.strength ? std::vector{std::string(field.id)} : std::vector<std::string>{};
    EXPECT_EQ(effects.ids(), expected) << field.id << "." << field.name;
    field.of(effects) = field.most * 2 + 1;
    EXPECT_FALSE(effects.validate().empty()) << field.id << "." << field.name;
  }
}

TEST(SimulatedEffects, GoesToAFileAndBack) {
  SimulatedEffects effects;
  for (const SimulatedEffectField& field : simulatedEffectFields())
    field.of(effects) = std::min(field.most, field.none + 0.3 * (field.most - field.none));
  effects.anisotropy.material = effects.thirdLobe.material = 1;
  effects.sheen.material = effects.retroreflection.material = effects.clearcoat.material = 0;
  const auto back = simulatedEffectsFromJson(simulatedEffectsJson(effects).dump(), "effects.json");
  ASSERT_TRUE(back.ok()) << back.error().sentence();
  for (const SimulatedEffectField& field : simulatedEffectFields())
    EXPECT_EQ(field.get(*back), field.get(effects)) << field.id << "." << field.name;
}

TEST(SimulatedEffects, SaysWhatIsWrongWithAFile) {
  const auto sentence = [](const char* text) {
    const auto read = simulatedEffectsFromJson(text, "effects.json");
    return read ? std::string("no error") : read.error().sentence();
  };
  EXPECT_THAT(sentence("[1]"), testing::HasSubstr("not a JSON object"));
  EXPECT_THAT(sentence(R"({"anisotrophy": {}})"), testing::HasSubstr("did you mean anisotropy?"));
  EXPECT_THAT(sentence(R"({"anisotropy": {"ration": 2}})"), testing::HasSubstr("did you mean ratio?"));
  EXPECT_THAT(sentence(R"({"anisotropy": {"ratio": -2}})"), testing::HasSubstr("0.05 to 20"));
  EXPECT_THAT(sentence(R"({"anisotropy": {"ratio": "2"}})"), testing::HasSubstr("not a number"));
  EXPECT_EQ(sentence("{}"), "no error");
}

TEST(SimulateCapture, AMaterialThatTheSheetHasNotIsRefused) {
  SimulatedCaptureOptions options = quick();
  options.effects.anisotropy = {1.5, 0, 1};
  const auto exposed = exposeSheet(SimulatedRig::desk(8, 120, 120), plain(), options, {});
  ASSERT_FALSE(exposed.ok());
  EXPECT_THAT(exposed.error().sentence(), testing::HasSubstr("anisotropy.material"));
}

// ---- between screen and sheet, against a sum over the screen that shares nothing with the integrator ----

/// The rendering equation summed over squares of the screen, in world coordinates and double, with the
/// effects written out anew.
struct Reference {
  Screen screen;
  Eigen::Vector3d point = Eigen::Vector3d(18, -12, 0), toView = Eigen::Vector3d::UnitZ();
  SheetPoint material;
  SimulatedEffects effects;

  static double step(double t) {
    t = std::clamp(t, 0.0, 1.0);
    return t * t * (3 - 2 * t);
  }

  double emission(double tx, double ty) const {
    const auto& e = *screen.emission;
    const auto& a = effects.emissionAngular;
    const auto gauss = [&](double wider) {
      const double x = (tx - e.mean.x() - a.tiltX) / (wider * e.sigma.x()),
                   y = (ty - e.mean.y() - a.tiltY) / (wider * e.sigma.y());
      return std::exp(-(x * x + y * y) / 2);
    };
    const double theta = std::atan(std::hypot(tx, ty)), r4 = std::pow(std::hypot(tx, ty), 4);
    return e.gain *
           ((1 - a.skirt - a.cosine) * gauss(1) + a.skirt * gauss(a.skirtWidth) +
            a.cosine * std::pow(std::cos(theta), a.cosinePower)) *
           (1 + a.beyond * r4 / (r4 + std::pow(a.beyondTan, 4)));
  }

  /// BRDF for albedos one, without the cosine: of the diffuse, specular and white terms together.
  double brdf(const Eigen::Vector3d& toLight) const {
    const Eigen::Vector3d n = material.normal, half = (toLight + toView).normalized();
    const double nl = toLight.dot(n), nv = toView.dot(n), nh = half.dot(n), lh = toLight.dot(half);
    const double tan2 = (1 - nh * nh) / (nh * nh);
    const double angle = effects.anisotropy.angleDeg * kPi / 180;
    const Eigen::Vector3d u0(std::cos(angle), std::sin(angle), 0), u = (u0 - u0.dot(n) * n).normalized(),
                                                                   v = n.cross(u);
    const double hu = half.dot(u) / nh, hv = half.dot(v) / nh, stretch = std::sqrt(effects.anisotropy.ratio);
    const auto gauss = [&](double s) {
      return std::exp(-0.5 * (std::pow(hu / (s * stretch), 2) + std::pow(hv * stretch / s, 2))) /
             (2 * kPi * s * s);
    };
    const double g = material.kurtosis, c = std::sqrt(2 / (1 / (g * g) + g * g));
    const double share = effects.thirdLobe.share, tails = effects.thirdLobe.ggx,
                 a2 = 2 * material.sigma * material.sigma;
    double slopes = 0.5 * (gauss(c * material.sigma / g) + gauss(c * material.sigma * g));
    slopes = (1 - tails) * slopes + tails * a2 / (kPi * (a2 + tan2) * (a2 + tan2));
    slopes = (1 - share) * slopes + (share > 0 ? share * gauss(effects.thirdLobe.sigma) : 0);
    const auto schlick = [&](double f0, double power) {
      return (f0 + (1 - f0) * std::pow(1 - lh, power)) / f0;
    };
    double value = 1 / kPi + slopes / std::pow(nh, 4) * schlick(effects.fresnel.f0, effects.fresnel.power) /
                                 (4 * nl * nv);
    if (effects.clearcoat.weight > 0) {
      const auto passes = [&](double cosine) {
        return 1 - effects.clearcoat.weight * (0.04 + 0.96 * std::pow(1 - cosine, 5));
      };
      const double s = effects.clearcoat.sigma;
      value *= passes(nl) * passes(nv);
      value += effects.clearcoat.weight * 0.04 * std::exp(-0.5 * tan2 / (s * s)) / (2 * kPi * s * s) /
               std::pow(nh, 4) * schlick(0.04, 5) / (4 * nl * nv);
    }
    if (effects.sheen.albedo > 0) {
      const double r = effects.sheen.width,
                   d = (2 + 1 / r) * std::pow(std::sqrt(1 - nh * nh), 1 / r) / (2 * kPi);
      value += effects.sheen.albedo * d / (4 * (nl + nv - nl * nv));
    }
    value += effects.sheen.grazing * std::pow(1 - lh, 5);
    if (effects.retroreflection.albedo > 0) {
      const double w = effects.retroreflection.widthDeg * kPi / 180;
      value +=
          effects.retroreflection.albedo * std::exp(-(1 - toLight.dot(toView)) / (w * w)) / (2 * kPi * w * w);
    }
    return value;
  }

  double arrives(const Eigen::Vector3d& toLight) const {
    const auto& s = effects.selfShadowing;
    if (s.horizonDeg == 0) return 1;
    double hidden = 1 - step((std::asin(toLight.z()) * 180 / kPi - s.horizonDeg) / s.softDeg + 0.5);
    if (s.sectorDeg < 360) {
      const double a = s.azimuthDeg * kPi / 180;
      const Eigen::Vector2d to(std::cos(a), std::sin(a)), flat = toLight.head<2>().normalized();
      const double aside = std::acos(std::clamp(flat.dot(to), -1.0, 1.0)) * 180 / kPi;
      hidden *= step((s.sectorDeg / 2 - aside) / s.softDeg + 0.5);
    }
    return 1 - hidden;
  }

  struct Shown {
    Eigen::Vector2d frequency;
    int phase;  ///< -1: the window alone
  };
  std::vector<double> radiance(const std::vector<Shown>& patterns, int across) const {
    const int down = static_cast<int>(std::lround(across / screen.aspect()));
    const double side = screen.widthMm / across, sideY = screen.heightMm / down;
    std::vector<double> sums(patterns.size(), 0);
    for (int j = 0; j < down; ++j)
      for (int i = 0; i < across; ++i) {
        const double xMm = -0.5 * screen.widthMm + (i + 0.5) * side,
                     yMm = -0.5 * screen.heightMm + (j + 0.5) * sideY;
        const double x = kPi * xMm / (screen.widthMm / 2), y = kPi * yMm / (screen.widthMm / 2);
        const Eigen::Vector3d from = screen.worldFromScreen * Eigen::Vector3d(xMm, yMm, 0) + screen.originMm;
        const Eigen::Vector3d aside = from - point, toLight = aside.normalized();
        const double cosLight = toLight.dot(material.normal),
                     cosScreen = -toLight.dot(screen.worldFromScreen.col(2));
        if (cosLight <= 0 || cosScreen <= 0) continue;
        const Eigen::Vector3d seen = screen.worldFromScreen.transpose() * aside / (aside.norm() * cosScreen);
        double light = emission(seen.x(), seen.y()) * arrives(toLight) * brdf(toLight) * cosLight *
                       cosScreen * side * sideY / aside.squaredNorm();
        const auto& spatial = effects.emissionSpatial;
        const double g = spatial.gradientAngleDeg * kPi / 180;
        light *= 1 - spatial.edges * (xMm * xMm + yMm * yMm) * 4 /
                         (screen.widthMm * screen.widthMm + screen.heightMm * screen.heightMm);
        light *= 1 + spatial.gradient * (xMm * std::cos(g) + yMm * std::sin(g)) * 2 / screen.widthMm;
        const double window = std::exp(-0.5 * std::pow(x / screen.windowSigma.x(), 2) -
                                       0.5 * std::pow(y / screen.windowSigma.y(), 2));
        for (std::size_t p = 0; p < patterns.size(); ++p) {
          double value = window;
          if (patterns[p].phase >= 0)
            value *= std::max(0.0, std::sin(patterns[p].frequency.x() * x + patterns[p].frequency.y() * y +
                                            patterns[p].phase * kPi / 2));
          sums[p] +=
              light *
              (effects.screenResponse.gamma == 1 ? value : std::pow(value, effects.screenResponse.gamma));
        }
      }
    return sums;
  }
};

struct Case {
  const char* name;
  const char* effects;
  double sigma = 0.12, kurtosis = 1.3;
};

class EffectAgainstReference : public testing::TestWithParam<Case> {};

// Of the window's response. The smallest changes asked for are five times as large.
constexpr double kTolerance = 6e-4;

TEST_P(EffectAgainstReference, AgreesForEveryPatternAndDiffersFromNone) {
  const Case& c = GetParam();
  const auto effects = simulatedEffectsFromJson(c.effects, c.name);
  ASSERT_TRUE(effects.ok()) << effects.error().sentence();
  const SimulatedRig rig = SimulatedRig::desk(64, 120, 120);
  Reference reference;
  reference.screen = trueScreen(rig.screen, *effects);
  reference.effects = *effects;
  reference.toView = (rig.camera.positionMm() - reference.point).normalized();
  reference.material.sigma = c.sigma;
  reference.material.kurtosis = c.kurtosis;
  reference.material.normal = Eigen::Vector3d(0.03, -0.05, 1).normalized();
  reference.material.diffuse = reference.material.specular = Eigen::Array3d::Ones();
  const std::vector<Eigen::Vector2i> frequencies{{1, 0}, {0, 3}, {6, -6}};
  const auto response = [&](const SimulatedEffects& on, const Screen& screen) {
    ScreenIntegrator integrator(screen, frequencies, IntegrationQuality{}, on);
    const int level = integrator.finestLevel(reference.point, reference.toView, reference.material);
    EXPECT_GE(level, 0);
    EXPECT_TRUE(integrator.prepare(level, {}));
    const PointResponse got = integrator.respond(reference.point, reference.toView, reference.material);
    Eigen::ArrayXf all = got.diffuse + got.specular;
    if (got.white.size() > 0) all += got.white;
    return all;
  };
  const Eigen::ArrayXf got = response(*effects, reference.screen), without = response({}, rig.screen);
  constexpr int kAcross = 1100;  // incommensurate with the cells under test
  std::vector<Reference::Shown> shown{{{0, 0}, -1}};
  for (const Eigen::Vector2i& frequency : frequencies)
    for (const int phase : {0, 3}) shown.push_back({frequency.cast<double>(), phase});
  const std::vector<double> expected = reference.radiance(shown, kAcross);
  const double whole = expected[0];
  double difference = 0;
  for (std::size_t p = 0; p < shown.size(); ++p) {
    const int column = p == 0 ? 12 : static_cast<int>(4 * ((p - 1) / 2)) + shown[p].phase;
    EXPECT_NEAR(got[column], expected[p], kTolerance * whole)
        << shown[p].frequency.transpose() << " phase " << shown[p].phase;
    difference = std::max(difference, std::abs(without[column] - expected[p]));
  }
  EXPECT_GT(difference, 5 * kTolerance * whole) << "the effect shows";
}

INSTANTIATE_TEST_SUITE_P(
    Effects, EffectAgainstReference,
    testing::Values(
        Case{"anisotropy", R"({"anisotropy": {"ratio": 1.6, "angleDeg": 35}})"},
        Case{"third_lobe", R"({"third-lobe": {"share": 0.3, "sigma": 0.45}})"},
        Case{"ggx_tails", R"({"third-lobe": {"ggx": 0.8}})", 0.08, 1.2},
        Case{"steeper_fresnel", R"({"fresnel": {"power": 3.2}})"},
        Case{"fresnel_of_metal", R"({"fresnel": {"f0": 0.5}})"},
        Case{"sheen", R"({"sheen": {"albedo": 1, "width": 1}})"},
        Case{"grazing_sheen", R"({"sheen": {"grazing": 20}})"},
        Case{"retroreflection", R"({"retroreflection": {"albedo": 0.8, "widthDeg": 40}})"},
        Case{"clearcoat", R"({"clearcoat": {"weight": 1, "sigma": 0.04}})"},
        Case{"horizon", R"({"self-shadowing": {"horizonDeg": 45}})"},
        Case{"horizon_of_one_side",
             R"({"self-shadowing": {"horizonDeg": 55, "sectorDeg": 60, "azimuthDeg": 70}})"},
        Case{"skirt", R"({"emission-angular": {"skirt": 1, "skirtWidth": 3}})"},
        Case{"cosine_panel", R"({"emission-angular": {"cosine": 0.6, "cosinePower": 3}})"},
        Case{"beyond_a_cone", R"({"emission-angular": {"beyond": -0.4, "beyondTan": 0.5}})"},
        Case{"tilted_emission", R"({"emission-angular": {"tiltX": 0.2, "tiltY": -0.1}})"},
        Case{"dark_corners", R"({"emission-spatial": {"edges": 0.5}})"},
        Case{"gradient", R"({"emission-spatial": {"gradient": 0.3, "gradientAngleDeg": 30}})"},
        Case{"panel_gamma", R"({"screen-response": {"gamma": 1.3}})"},
        Case{"panel_gamma_below_one", R"({"screen-response": {"gamma": 0.8}})"},
        Case{
            "screen_elsewhere",
            R"({"screen-pose": {"tiltXDeg": 3, "tiltYDeg": -2, "turnDeg": 4, "shiftXMm": 8, "alongNormalMm": 15}})"}),
    [](const auto& info) { return std::string(info.param.name); });

TEST(SurfaceParts, SharesAddUpToOne) {
  SheetPoint material;
  material.specular = Eigen::Array3d::Ones();
  for (const char* text : {"{}", R"({"third-lobe": {"share": 0.25}})", R"({"third-lobe": {"ggx": 0.7}})",
                           R"({"third-lobe": {"share": 0.2, "ggx": 0.5}})"}) {
    double sum = 0;
    for (const SurfacePart& part :
         surfaceParts(material, simulatedEffectsFromJson(text, "").value()).specular)
      sum += part.weight;
    EXPECT_NEAR(sum, 1, 1e-12) << text;
  }
}

TEST(SurfaceParts, OnlyTheMaterialThatIsNamedHasTheEffect) {
  SimulatedEffects effects;
  effects.anisotropy = {2, 0, 1};
  SheetPoint first, second;
  first.specular = second.specular = Eigen::Array3d::Ones();
  second.material = 1;
  const SurfacePart a = surfaceParts(first, effects).specular[0],
                    b = surfaceParts(second, effects).specular[0];
  EXPECT_EQ(a.sigmaAlong, a.sigmaAcross);
  EXPECT_NEAR(b.sigmaAlong / b.sigmaAcross, 2, 1e-12);
  EXPECT_NEAR(b.sigmaAlong * b.sigmaAcross, a.sigmaAlong * a.sigmaAcross, 1e-15)
      << "the geometric mean stays";
}

}  // namespace
}  // namespace patina
