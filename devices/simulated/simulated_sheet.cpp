#include "devices/simulated/simulated_sheet.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;

/// Uniform in [0, 1) from raw bits: the standard's distributions differ between libraries, and a sheet must
/// not.
double uniform(std::mt19937_64& bits) {
  return static_cast<double>(bits() >> 11) * 0x1.0p-53;
}

struct Scene {
  const char* name;
  const char* summary;
  SimulatedSheet sheet;
};

std::vector<Scene> scenes() {
  std::vector<Scene> list;

  SimulatedSheet laminate;
  laminate.name = "laminate";
  laminate.materials = {{{0.36, 0.20, 0.10}, {0.050, 0.050, 0.050}, 0.050, 1.45},
                        {{0.09, 0.13, 0.19}, {0.065, 0.060, 0.055}, 0.085, 1.25}};
  laminate.pattern = SheetPattern::Stripes;
  laminate.periodMm = 62;
  laminate.slopeRms = 0.045;
  laminate.seed = 11;
  list.push_back({"laminate", "glossy laminate, two materials in wavy bands, gently uneven", laminate});

  SimulatedSheet cardstock;
  cardstock.name = "cardstock";
  cardstock.materials = {{{0.62, 0.56, 0.46}, {0.040, 0.040, 0.040}, 0.160, 1.20},
                         {{0.42, 0.08, 0.07}, {0.080, 0.074, 0.068}, 0.115, 1.35}};
  cardstock.pattern = SheetPattern::Checker;
  cardstock.periodMm = 60;
  cardstock.slopeRms = 0.035;
  cardstock.reliefPeriodMm = 35;
  cardstock.seed = 23;
  list.push_back({"cardstock", "satin card with a printed checker", cardstock});

  SimulatedSheet mirror;
  mirror.name = "mirror-mix";
  mirror.materials = {{{0.48, 0.47, 0.44}, {0.030, 0.030, 0.030}, 0.130, 1.30},
                      {{0.04, 0.05, 0.07}, {0.060, 0.058, 0.052}, 0.020, 1.50},
                      {{0.06, 0.22, 0.13}, {0.055, 0.055, 0.055}, 0.045, 1.60}};
  mirror.pattern = SheetPattern::Spots;
  mirror.periodMm = 46;
  mirror.slopeRms = 0.035;
  mirror.reliefPeriodMm = 55;
  mirror.sigmaVariation = 0.15;
  mirror.seed = 37;
  list.push_back({"mirror-mix", "near-mirror foil and glossy paint on matte paper", mirror});
  return list;
}

}  // namespace

std::vector<std::string> SimulatedSheet::validate() const {
  std::vector<std::string> problems;
  const auto need = [&](bool good, const std::string& sentence) {
    if (!good) problems.push_back(sentence);
  };
  need(widthMm > 0 && heightMm > 0 && std::isfinite(widthMm) && std::isfinite(heightMm),
       "the sheet's width and height must be positive millimetres");
  need(!materials.empty(), "the sheet has no material");
  need(periodMm > 0 && reliefPeriodMm > 0,
       "the layout's and the relief's periods must be positive millimetres");
  need(slopeRms >= 0 && slopeRms < 0.5, "the relief's slope must lie in 0 to 0.5");
  need(std::abs(albedoVariation) < 1 && std::abs(sigmaVariation) < 1,
       "a relative variation must stay below 1");
  for (std::size_t i = 0; i < materials.size(); ++i) {
    const SheetMaterial& m = materials[i];
    const std::string which = "material " + std::to_string(i + 1) + ": ";
    need((m.diffuse >= 0).all() && (m.specular >= 0).all(), which + "albedos can't be negative");
    need(m.sigma > 0 && m.sigma < 2, which + "sigma must lie in 0 to 2");
    need(m.kurtosis >= 1 && m.kurtosis < 10, which + "kurtosis must lie in 1 to 10");
  }
  return problems;
}

SheetSampler::SheetSampler(const SimulatedSheet& sheet) : sheet_(sheet) {
  std::mt19937_64 bits(sheet.seed * 0x9E3779B97F4A7C15ull + 1);
  const auto waves = [&](int count, double shortestMm, double longestMm) {
    std::vector<Wave> made;
    for (int i = 0; i < count; ++i) {
      const double angle = 2 * kPi * (i + uniform(bits)) / count;  // spread, or all waves may run one way
      const double length = shortestMm * std::pow(longestMm / shortestMm, uniform(bits));
      made.push_back({Eigen::Vector2d(std::cos(angle), std::sin(angle)) * (2 * kPi / length),
                      2 * kPi * uniform(bits), 1.0 / std::sqrt(0.5 * count)});
    }
    return made;
  };
  relief_ = waves(7, sheet.reliefPeriodMm, 2.5 * sheet.reliefPeriodMm);
  // Each wave adds amplitude^2 |k|^2 / 2 to the mean squared slope; share it out equally. Half of it for each
  // axis.
  for (Wave& wave : relief_)
    wave.amplitude =
        sheet.slopeRms * std::sqrt(2.0 * 2.0 / static_cast<double>(relief_.size())) / wave.perMm.norm();
  tint_ = waves(5, 25, 90);
  wear_ = waves(5, 30, 90);
  edge_ = waves(4, 30, 110);
}

double SheetSampler::sum(const std::vector<Wave>& waves, double xMm, double yMm) {
  double total = 0;
  for (const Wave& w : waves)
    total += w.amplitude * std::sin(w.perMm.x() * xMm + w.perMm.y() * yMm + w.phase);
  return total;
}

int SheetSampler::materialAt(double xMm, double yMm) const {
  const int count = static_cast<int>(sheet_.materials.size());
  if (count < 2 || sheet_.pattern == SheetPattern::Uniform) return 0;
  const double period = sheet_.periodMm;
  const auto wrapped = [count](long long index) {
    return static_cast<int>(((index % count) + count) % count);
  };
  switch (sheet_.pattern) {
    case SheetPattern::Stripes: {
      const double along = 0.94 * xMm + 0.34 * yMm + 0.10 * period * sum(edge_, xMm, yMm);
      return wrapped(std::llround(std::floor(along * count / period)));
    }
    case SheetPattern::Checker: {
      const double half = 0.5 * period;
      return wrapped(std::llround(std::floor(xMm / half + 0.2) + std::floor(yMm / half + 0.3)));
    }
    case SheetPattern::Spots: {
      const double u = xMm / period, v = yMm / period;
      const double du = u - std::round(u), dv = v - std::round(v);
      const double radius = 0.36 + 0.03 * sum(edge_, xMm, yMm);
      if (du * du + dv * dv > radius * radius) return 0;
      const long long island = std::llround(std::round(u)) + std::llround(std::round(v));
      return count == 2 ? 1 : 1 + static_cast<int>(((island % (count - 1)) + (count - 1)) % (count - 1));
    }
    case SheetPattern::Uniform:
      break;
  }
  return 0;
}

SheetPoint SheetSampler::at(double xMm, double yMm) const {
  SheetPoint point;
  point.material = materialAt(xMm, yMm);
  const SheetMaterial& material = sheet_.materials[static_cast<std::size_t>(point.material)];
  // The sums have unit standard deviation; clamped at 2.2 of it so that a relative variation of 0.4 stays
  // positive.
  const double tint = std::clamp(sum(tint_, xMm, yMm), -2.2, 2.2),
               wear = std::clamp(sum(wear_, xMm, yMm), -2.2, 2.2);
  point.diffuse = material.diffuse * std::max(0.0, 1 + 0.5 * sheet_.albedoVariation * tint);
  point.specular = material.specular;
  point.sigma = material.sigma * std::max(0.05, 1 + 0.5 * sheet_.sigmaVariation * wear);
  point.kurtosis = material.kurtosis;
  Eigen::Vector2d gradient = Eigen::Vector2d::Zero();
  for (const Wave& w : relief_)
    gradient += w.amplitude * std::cos(w.perMm.x() * xMm + w.perMm.y() * yMm + w.phase) * w.perMm;
  point.normal = Eigen::Vector3d(-gradient.x(), -gradient.y(), 1).normalized();
  return point;
}

std::vector<std::string> simulatedSceneNames() {
  std::vector<std::string> names;
  for (const Scene& scene : scenes()) names.emplace_back(scene.name);
  return names;
}

std::string simulatedSceneSummary(const std::string& name) {
  for (const Scene& scene : scenes())
    if (name == scene.name) return scene.summary;
  return {};
}

SimulatedSheet simulatedScene(const std::string& name) {
  for (const Scene& scene : scenes())
    if (name == scene.name) return scene.sheet;
  SimulatedSheet none;
  none.name = name;
  none.materials.clear();
  return none;
}

}  // namespace patina
