#include "tests/results/closing_loop_draw.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "devices/simulated/sheet_form.h"

namespace patina::test {
namespace {

constexpr double kPi = std::numbers::pi;

/// Uniform numbers from raw bits: the standard's distributions differ between libraries, and a release's draw
/// must be the same everywhere.
class Dice {
 public:
  Dice(std::uint64_t seed, std::uint64_t what) : bits_(seed * 0x9E3779B97F4A7C15ull + what) {
    for (int i = 0; i < 4; ++i) bits_();
  }
  double unit() { return static_cast<double>(bits_() >> 11) * 0x1.0p-53; }
  double between(double low, double high) { return low + (high - low) * unit(); }
  /// Uniform in the logarithm.
  double scale(double low, double high) { return low * std::pow(high / low, unit()); }
  int count(int low, int high) {
    return low + std::min(high - low, static_cast<int>((high - low + 1) * unit()));
  }
  bool chance(double probability) { return unit() < probability; }
  double sign() { return chance(0.5) ? 1 : -1; }

 private:
  std::mt19937_64 bits_;
};

/// How an effect is drawn: which of its fields says how strong it is, over which ranges. A range is of the
/// distance from "none", uniform in its logarithm; `both`: either sign of it.
struct Variant {
  const char* id;
  const char* field;
  double weakLow, weakHigh;      ///< 0: never weak
  double strongLow, strongHigh;  ///< 0: never strong
  double most;                   ///< that one meets: no factor goes beyond it
  bool both = false;
  std::function<void(SimulatedEffects&, Dice&, const SimulatedSheet&)> shape = {};
};

int anyMaterial(Dice& dice, const SimulatedSheet& sheet) {
  const int count = static_cast<int>(sheet.materials.size());
  return count < 2 || dice.chance(0.6) ? -1 : dice.count(0, count - 1);
}

/// Ranges: the weak ones are those at which a score over all points was known to name the effect. Where
/// strong begins depends on the material (what a glossy sheet shows plainly, a matte one hides): the strong
/// ranges are starting points, and the program that asks for strong captures raises the factor until a fit
/// says so.
const std::vector<Variant>& variants() {
  static const std::vector<Variant> list = {
      // The amount is the change at the screen's most oblique corner, seen from the sample's centre.
      {"emission-angular", "skirt", 0.08, 0.14, 0, 0, 0.5, false},
      {"emission-angular", "cosine", 0.08, 0.14, 0, 0, 0.5, true},
      {"emission-angular", "beyond", 0.08, 0.14, 0, 0, 0.5, true},
      {"emission-spatial", "edges", 0.018, 0.03, 0.3, 0.6, 0.9, false},
      // A weak gradient is a tilt of all normals; it is drawn strong only.
      {"emission-spatial", "gradient", 0, 0, 0.25, 0.5, 0.8, false,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet&) {
         e.emissionSpatial.gradientAngleDeg = d.between(0, 360);
       }},
      {"screen-response", "gamma", 0.009, 0.015, 0.12, 0.3, 0.6, true},
      {"screen-drift", "warmUp", 0.008, 0.02, 0.04, 0.12, 0.4, false,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet&) {
         e.screenDrift.warmUpPhotos = d.scale(15, 60);
       }},
      {"screen-drift", "linear", 0.008, 0.02, 0.04, 0.12, 0.4, true},
      {"flicker", "sd", 0.004, 0.008, 0.008, 0.02, 0.08, false},
      {"screen-pose", "tiltXDeg", 0.8, 1.5, 4, 7, 10, true},
      {"screen-pose", "tiltYDeg", 0.8, 1.5, 4, 7, 10, true},
      {"screen-pose", "alongNormalMm", 4, 8, 15, 30, 50, true},
      {"sample-height", "bendMm", 2, 4, 0, 0, 12, true,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet&) {
         e.sampleHeight.bendAngleDeg = d.between(0, 180);
       }},
      {"sample-height", "wavesMm", 1, 2, 0, 0, 5, false,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet&) {
         e.sampleHeight.waveLengthMm = d.between(80, 140);
       }},
      {"anisotropy", "ratio", 0.045, 0.08, 0.15, 0.6, 1.5, false,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet& s) {
         e.anisotropy.angleDeg = d.between(0, 180);
         e.anisotropy.material = anyMaterial(d, s);
       }},
      {"third-lobe", "share", 0.09, 0.14, 0, 0, 0.6, false,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet& s) {
         double widest = 0;
         for (const SheetMaterial& material : s.materials)
           widest = std::max(widest, material.sigma * material.kurtosis);
         e.thirdLobe.sigma = std::min(0.7, widest * d.between(2, 3.5));
       }},
      {"third-lobe", "ggx", 0.25, 0.5, 0.6, 1, 1, false},
      {"fresnel", "power", 0.4, 0.8, 0, 0, 2.5, true},
      {"sheen", "albedo", 0.4, 0.9, 0, 0, 1, false,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet&) { e.sheen.width = d.between(0.7, 1); }},
      {"sheen", "grazing", 0.5, 1, 0, 0, 10, false},
      {"clearcoat", "weight", 0.08, 0.2, 0.3, 0.8, 1.5, false,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet& s) {
         e.clearcoat.sigma = d.between(0.025, 0.04);
         e.clearcoat.material = anyMaterial(d, s);
       }},
      {"subsurface", "radiusMm", 12, 20, 0, 0, 40, false},
      {"self-shadowing", "horizonDeg", 38, 44, 40, 50, 60, false,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet&) {
         if (d.chance(0.3)) {
           e.selfShadowing.sectorDeg = d.between(90, 200);
           e.selfShadowing.azimuthDeg = 90 + d.between(-40, 40);  // where the screen stands
         }
       }},
      {"glare", "share", 0.02, 0.04, 0.1, 0.3, 0.6, false,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet&) { e.glare.radiusPx = d.between(2.5, 7); }},
      {"defocus", "sigmaPx", 0.45, 0.65, 0.7, 1.4, 3, false},
      {"camera-response", "gamma", 0.008, 0.015, 0.06, 0.15, 0.4, true},
      {"camera-response", "compression", 0.01, 0.03, 0.1, 0.4, 2, false},
      {"black-level", "offset", 0.003, 0.006, 0.006, 0.02, 0.1, false},
      {"ambient-drift", "perPhoto", 3e-5, 8e-5, 8e-5, 3e-4, 1e-3, false,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet&) {
         e.ambientDrift.onSheet = d.chance(0.3) ? 1 : 0;
       }},
      {"ambient-drift", "sd", 1e-3, 2e-3, 2e-3, 6e-3, 0.02, false,
       [](SimulatedEffects& e, Dice& d, const SimulatedSheet&) {
         e.ambientDrift.onSheet = d.chance(0.3) ? 1 : 0;
       }},
      {"stray-light", "share", 0.01, 0.02, 0, 0, 0.3, false},
      {"saturation", "level", 0.15, 0.25, 0.2, 0.4, 0.6, false},
  };
  return list;
}

const SimulatedEffectField& fieldOf(const Variant& variant) {
  for (const SimulatedEffectField& field : simulatedEffectFields())
    if (field.id == variant.id && field.name == variant.field) return field;
  throw std::logic_error(std::string("no such field: ") + variant.id + "." + variant.field);
}

/// Changes the emission by `change` at the corner of the screen that is seen most obliquely from the sample's
/// centre, by the given field; by `beyond` where that one can't.
void changeEmission(DrawnCapture& drawn, const std::string& field, double change, Dice& dice) {
  const Screen& screen = drawn.rig.screen;
  const Eigen::Vector3d at = screen.worldFromScreen.transpose() * -screen.originMm;
  double corner = 0, kept = 1;
  for (const double x : {-0.5, 0.5})
    for (const double y : {-0.5, 0.5}) {
      const Eigen::Array2d slope((x * screen.widthMm - at.x()) / at.z(),
                                 (y * screen.heightMm - at.y()) / at.z());
      if (slope.matrix().norm() < corner) continue;
      corner = slope.matrix().norm();
      const ScreenEmission& e = *screen.emission;
      kept = std::exp(-0.5 * ((slope - e.mean.array()) / e.sigma.array()).square().sum());
    }
  SimulatedEffects::EmissionAngular& effect = drawn.options.effects.emissionAngular;
  if (field == "skirt") {
    effect.skirtWidth = dice.between(1.7, 3);
    const double wide = std::pow(kept, 1 / (effect.skirtWidth * effect.skirtWidth));
    effect.skirt = change * kept / (wide - kept);
    if (effect.skirt > 0 && effect.skirt <= 1) return;
    effect.skirt = 0;
  } else if (field == "cosine") {
    effect.cosinePower = change > 0 ? dice.between(0, 1) : dice.between(4, 8);
    const double other = std::pow(1 + corner * corner, -0.5 * effect.cosinePower);
    effect.cosine = change * kept / (other - kept);
    if (effect.cosine > 0 && effect.cosine <= 1) return;
    effect.cosine = 0;
  }
  effect.beyondTan = dice.between(0.5, 0.9);
  effect.beyond = std::max(-0.9, change * (1 + std::pow(effect.beyondTan / corner, 4)));
}

void drawSheet(DrawnCapture& drawn, Dice& dice) {
  SimulatedSheet& sheet = drawn.sheet;
  const int count = dice.count(1, 3);
  sheet.materials.clear();
  for (int i = 0; i < count; ++i) {
    SheetMaterial material;
    const double grey = dice.scale(0.03, 0.6);
    const double lobe = dice.between(0.025, 0.08);
    for (int c = 0; c < 3; ++c) {
      material.diffuse[c] = std::min(0.85, grey * dice.scale(0.6, 1.6));
      material.specular[c] = lobe * dice.between(0.9, 1.1);
    }
    material.sigma = dice.scale(0.04, 0.25);
    material.kurtosis = dice.between(1.05, 1.55);
    sheet.materials.push_back(material);
  }
  constexpr SheetPattern kPatterns[] = {SheetPattern::Stripes, SheetPattern::Checker, SheetPattern::Spots};
  sheet.pattern = count == 1 ? SheetPattern::Uniform : kPatterns[dice.count(0, 2)];
  sheet.periodMm = dice.between(45, 90);
  sheet.slopeRms = dice.between(0.01, 0.06);
  sheet.reliefPeriodMm = dice.between(35, 70);
  sheet.albedoVariation = dice.between(0, 0.25);
  sheet.sigmaVariation = dice.between(0, 0.15);
  sheet.seed = drawn.seed * 7 + 3;
  sheet.name = "drawn-" + std::to_string(drawn.seed);
}

void drawRig(DrawnCapture& drawn, Dice& dice, int pixels) {
  const auto place = [](double aroundDeg, double upDeg, double distanceMm) {
    const double a = aroundDeg * kPi / 180, u = upDeg * kPi / 180;
    return Eigen::Vector3d(distanceMm * std::cos(u) * std::sin(a), distanceMm * std::cos(u) * std::cos(a),
                           distanceMm * std::sin(u));
  };
  const int side = dice.count(40, 64);
  const double up = dice.between(42, 54);
  const Eigen::Vector3d screen = place(dice.between(-5, 5), up, dice.between(220, 300));
  Eigen::Vector3d camera = place(dice.between(-6, 6), up + dice.between(-4, 4), dice.between(380, 520));
  camera.y() = -camera.y();
  drawn.rig = SimulatedRig::placed(pixels > 0 ? pixels : side, drawn.sheet.widthMm, drawn.sheet.heightMm,
                                   camera, screen, dice.between(-2, 2));
  ScreenEmission& emission = *drawn.rig.screen.emission;
  emission.sigma = {dice.between(1.3, 2.0), dice.between(1.1, 1.7)};
  emission.mean = {dice.between(-0.05, 0.05), dice.between(-0.1, 0.1)};
  drawn.rig.noise = {dice.scale(1e-5, 5e-5), dice.scale(1e-4, 4e-4)};
  drawn.rig.blackLevel = dice.between(0.0005, 0.002);
}

/// Draws the strength of an effect, or takes the one given.
void drawEffect(DrawnCapture& drawn, const std::string& id, DrawStrength strength, const double* given,
                double factor, Dice& dice) {
  std::vector<const Variant*> candidates;
  for (const Variant& variant : variants())
    if (variant.id == id &&
        (given || (strength == DrawStrength::Weak ? variant.weakHigh : variant.strongHigh) > 0))
      candidates.push_back(&variant);
  if (candidates.empty()) return;
  const Variant& variant =
      *candidates[static_cast<std::size_t>(dice.count(0, static_cast<int>(candidates.size()) - 1))];
  const SimulatedEffectField& field = fieldOf(variant);
  SimulatedEffects& effects = drawn.options.effects;
  if (variant.shape) variant.shape(effects, dice, drawn.sheet);
  const bool strong = strength == DrawStrength::Strong;
  const double amount =
      std::min(variant.most, factor * (strong ? dice.scale(variant.strongLow, variant.strongHigh)
                                              : dice.scale(variant.weakLow, variant.weakHigh)));
  const double sign = variant.both ? dice.sign() : 1;
  double value = 0;
  if (given)
    value = *given;
  else if (field.id == "saturation")
    value = 1 - amount;
  else if (field.none == 1)  // powers and ratios: the same distance up and down
    value = std::pow(1 + amount, sign);
  else
    value = field.none + sign * amount;
  if (field.id == "emission-angular" && !given) {
    changeEmission(drawn, std::string(field.name), sign * amount, dice);
    value = sign * amount;
  } else {
    value = field.of(effects) = std::clamp(value, field.least, field.most);
  }
  if (drawn.strengthField.empty()) {
    drawn.strengthField = std::string(field.id) + "." + std::string(field.name);
    drawn.strength = value;
  }
}

/// The finest lobe that the simulator's grid resolves is about 0.012 across the usual screen.
void keepResolvable(DrawnCapture& drawn) {
  const SimulatedEffects& effects = drawn.options.effects;
  double factor = 1;
  if (effects.thirdLobe.ggx > 0) factor = 1.7;
  if (effects.anisotropy.ratio != 1)
    factor *= std::sqrt(std::max(effects.anisotropy.ratio, 1 / effects.anisotropy.ratio));
  for (SheetMaterial& material : drawn.sheet.materials)
    material.sigma = std::max(material.sigma, 0.035 * factor);
}

DrawnCapture draw(std::uint64_t seed, const std::vector<std::string>& effects, DrawStrength strength,
                  const double* given, int pixels, double factor) {
  DrawnCapture drawn;
  drawn.seed = seed;
  drawn.effects = effects;
  Dice sheet(seed, 1), rig(seed, 2), effect(seed, 3);
  drawSheet(drawn, sheet);
  drawRig(drawn, rig, pixels);
  for (const std::string& id : effects) drawEffect(drawn, id, strength, given, factor, effect);
  keepResolvable(drawn);
  drawn.options.writeTruth = true;
  char text[200];
  double low = 1, high = 0;
  for (const SheetMaterial& material : drawn.sheet.materials)
    low = std::min(low, material.sigma), high = std::max(high, material.sigma);
  std::snprintf(text, sizeof text, "%zu material(s), sigma %.3f to %.3f, %d pixels, %s",
                drawn.sheet.materials.size(), low, high, drawn.rig.camera.width,
                simulatedEffectsJson(drawn.options.effects).dump().c_str());
  drawn.summary = text;
  return drawn;
}

}  // namespace

std::vector<std::string> drawnEffects(DrawStrength strength) {
  std::vector<std::string> ids;
  for (const Variant& variant : variants())
    if ((strength == DrawStrength::Weak || variant.strongHigh > 0) &&
        (ids.empty() || ids.back() != variant.id))
      ids.emplace_back(variant.id);
  return ids;
}

DrawnCapture drawCapture(std::uint64_t seed, const std::vector<std::string>& effects, DrawStrength strength,
                         int pixels, double factor) {
  return draw(seed, effects, strength, nullptr, pixels, factor);
}

DrawnCapture drawCaptureWith(std::uint64_t seed, const std::string& effect, double strength, int pixels) {
  return draw(seed, {effect}, DrawStrength::Weak, &strength, pixels, 1);
}

Status simulateDrawn(const DrawnCapture& drawn, const std::filesystem::path& folder, const JobContext& job) {
  const std::filesystem::path stamp = folder.string() + ".draw";
  const std::string same = "2 " + std::to_string(drawn.seed) + " " + drawn.summary + "\n";
  if (std::ifstream in(stamp); in && std::filesystem::exists(folder / "capture.json"))
    if (std::string((std::istreambuf_iterator<char>(in)), {}) == same) return Done{};
  JobContext own = job;
  own.seed = drawn.seed;
  if (const auto made = simulateCapture(folder, drawn.rig, drawn.sheet, drawn.options, own); !made)
    return made.error();
  std::ofstream(stamp) << same;
  return Done{};
}

}  // namespace patina::test
