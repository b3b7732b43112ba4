#include "devices/simulated/simulated_effects.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "engine/base/text.h"

namespace patina {
namespace {

using E = SimulatedEffects;
using Field = SimulatedEffectField;

#define PATINA_FIELD(group, name) [](E& e) -> double& { return e.group.name; }

std::vector<Field> allFields() {
  constexpr bool kStrength = true, kShape = false;
  const auto material = [](std::string_view id, double& (*of)(E&)) {
    return Field{id, "material", "", -1, kShape, -1, 100, "index of the only material that has it; -1: all",
                 of};
  };
  return {
      {"emission-angular", "skirt", "", 0, kStrength, 0, 1,
       "share of the panel's light in a wider Gaussian over tan(theta)",
       PATINA_FIELD(emissionAngular, skirt)},
      {"emission-angular", "skirtWidth", "times", 2, kShape, 1.05, 10, "how much wider that one is",
       PATINA_FIELD(emissionAngular, skirtWidth)},
      {"emission-angular", "cosine", "", 0, kStrength, 0, 1,
       "share of the panel's light that falls off as a power of the cosine",
       PATINA_FIELD(emissionAngular, cosine)},
      {"emission-angular", "cosinePower", "", 2, kShape, 0, 20, "that power",
       PATINA_FIELD(emissionAngular, cosinePower)},
      {"emission-angular", "beyond", "", 0, kStrength, -0.95, 5,
       "relative change far outside of a cone round the panel's normal",
       PATINA_FIELD(emissionAngular, beyond)},
      {"emission-angular", "beyondTan", "tan(theta)", 0.7, kShape, 0.05, 5,
       "where half of that change is reached", PATINA_FIELD(emissionAngular, beyondTan)},
      {"emission-angular", "tiltX", "tan(theta)", 0, kStrength, -1, 1,
       "centre of the emission, to the screen's right", PATINA_FIELD(emissionAngular, tiltX)},
      {"emission-angular", "tiltY", "tan(theta)", 0, kStrength, -1, 1,
       "centre of the emission, upwards on the screen", PATINA_FIELD(emissionAngular, tiltY)},
      {"emission-spatial", "edges", "", 0, kStrength, -1, 0.95,
       "share of the backlight that the screen's corners lack", PATINA_FIELD(emissionSpatial, edges)},
      {"emission-spatial", "gradient", "", 0, kStrength, 0, 0.95,
       "relative change of the backlight from the centre to the left or right edge's distance",
       PATINA_FIELD(emissionSpatial, gradient)},
      {"emission-spatial", "gradientAngleDeg", "degrees", 0, kShape, -360, 360,
       "direction in which it grows; 0: to the right, 90: upwards",
       PATINA_FIELD(emissionSpatial, gradientAngleDeg)},
      {"screen-response", "gamma", "", 1, kStrength, 0.2, 5,
       "the panel shows the value asked for to this power", PATINA_FIELD(screenResponse, gamma)},
      {"screen-drift", "warmUp", "", 0, kStrength, -5, 0.95,
       "share of the panel's light that is missing at the first photograph",
       PATINA_FIELD(screenDrift, warmUp)},
      {"screen-drift", "warmUpPhotos", "photographs", 40, kShape, 0.1, 1e5,
       "after so many it is down to a third", PATINA_FIELD(screenDrift, warmUpPhotos)},
      {"screen-drift", "linear", "", 0, kStrength, -0.95, 5,
       "relative change of the panel's light from the first photograph to the last",
       PATINA_FIELD(screenDrift, linear)},
      {"flicker", "sd", "", 0, kStrength, 0, 0.5,
       "standard deviation of a factor that each photograph draws anew", PATINA_FIELD(flicker, sd)},
      {"screen-pose", "tiltXDeg", "degrees", 0, kStrength, -30, 30, "screen turned about its own x axis",
       PATINA_FIELD(screenPose, tiltXDeg)},
      {"screen-pose", "tiltYDeg", "degrees", 0, kStrength, -30, 30, "screen turned about its own y axis",
       PATINA_FIELD(screenPose, tiltYDeg)},
      {"screen-pose", "turnDeg", "degrees", 0, kStrength, -30, 30, "screen turned in its own plane",
       PATINA_FIELD(screenPose, turnDeg)},
      {"screen-pose", "shiftXMm", "mm", 0, kStrength, -200, 200, "screen shifted to its right",
       PATINA_FIELD(screenPose, shiftXMm)},
      {"screen-pose", "shiftYMm", "mm", 0, kStrength, -200, 200, "screen shifted upwards on it",
       PATINA_FIELD(screenPose, shiftYMm)},
      {"screen-pose", "alongNormalMm", "mm", 0, kStrength, -200, 200, "screen shifted to where it shines",
       PATINA_FIELD(screenPose, alongNormalMm)},
      {"sample-height", "bendMm", "mm", 0, kStrength, -50, 50,
       "sheet bent to a cylinder: height at half its width from the axis",
       PATINA_FIELD(sampleHeight, bendMm)},
      {"sample-height", "bendAngleDeg", "degrees", 0, kShape, -360, 360,
       "direction in which it bends; 0: along x", PATINA_FIELD(sampleHeight, bendAngleDeg)},
      {"sample-height", "wavesMm", "mm", 0, kStrength, 0, 20,
       "standard deviation of smooth waves of the sheet", PATINA_FIELD(sampleHeight, wavesMm)},
      {"sample-height", "waveLengthMm", "mm", 90, kShape, 10, 1000, "their shortest length",
       PATINA_FIELD(sampleHeight, waveLengthMm)},
      {"sample-tilt", "aboutXDeg", "degrees", 0, kStrength, -20, 20, "sheet turned about the world's x axis",
       PATINA_FIELD(sampleTilt, aboutXDeg)},
      {"sample-tilt", "aboutYDeg", "degrees", 0, kStrength, -20, 20, "sheet turned about the world's y axis",
       PATINA_FIELD(sampleTilt, aboutYDeg)},
      {"sample-tilt", "liftMm", "mm", 0, kStrength, -50, 50, "sheet above the plane z = 0",
       PATINA_FIELD(sampleTilt, liftMm)},
      {"anisotropy", "ratio", "", 1, kStrength, 0.05, 20,
       "sigma along over sigma across; their geometric mean stays", PATINA_FIELD(anisotropy, ratio)},
      {"anisotropy", "angleDeg", "degrees", 0, kShape, -360, 360,
       "direction along, from the sample's x axis towards y", PATINA_FIELD(anisotropy, angleDeg)},
      material("anisotropy", PATINA_FIELD(anisotropy, material)),
      {"third-lobe", "share", "", 0, kStrength, 0, 1, "share of the lobe's energy in a third Gaussian",
       PATINA_FIELD(thirdLobe, share)},
      {"third-lobe", "sigma", "slope", 0.4, kShape, 0.01, 1.5, "that one's standard deviation",
       PATINA_FIELD(thirdLobe, sigma)},
      {"third-lobe", "ggx", "", 0, kStrength, 0, 1,
       "share of the lobe that is GGX instead of Gaussian, alpha = sqrt(2) sigma",
       PATINA_FIELD(thirdLobe, ggx)},
      material("third-lobe", PATINA_FIELD(thirdLobe, material)),
      {"fresnel", "power", "", 5, kStrength, 0.5, 20, "power in Schlick's formula",
       PATINA_FIELD(fresnel, power)},
      {"fresnel", "f0", "", 0.06, kStrength, 0.005, 1, "reflectance at normal incidence in Schlick's formula",
       PATINA_FIELD(fresnel, f0)},
      {"sheen", "albedo", "", 0, kStrength, 0, 1, "weight of a velvet term, white",
       PATINA_FIELD(sheen, albedo)},
      {"sheen", "width", "", 0.8, kShape, 0.1, 1, "its spread; smaller: closer to the horizon",
       PATINA_FIELD(sheen, width)},
      {"sheen", "grazing", "1/sr", 0, kStrength, 0, 100, "weight of a grazing term, white: times (1 - l.h)^5",
       PATINA_FIELD(sheen, grazing)},
      material("sheen", PATINA_FIELD(sheen, material)),
      {"retroreflection", "albedo", "", 0, kStrength, 0, 1,
       "share of the light sent back to where it came from, white", PATINA_FIELD(retroreflection, albedo)},
      {"retroreflection", "widthDeg", "degrees", 25, kShape, 3, 90,
       "standard deviation of the angle between light and view", PATINA_FIELD(retroreflection, widthDeg)},
      material("retroreflection", PATINA_FIELD(retroreflection, material)),
      {"clearcoat", "weight", "", 0, kStrength, 0, 2, "of a coat that reflects 0.04 at normal incidence",
       PATINA_FIELD(clearcoat, weight)},
      {"clearcoat", "sigma", "slope", 0.03, kShape, 0.01, 1, "its slope's standard deviation",
       PATINA_FIELD(clearcoat, sigma)},
      material("clearcoat", PATINA_FIELD(clearcoat, material)),
      {"subsurface", "radiusMm", "mm", 0, kStrength, 0, 60,
       "mean distance between where light enters and leaves", PATINA_FIELD(subsurface, radiusMm)},
      {"self-shadowing", "horizonDeg", "degrees", 0, kStrength, 0, 85,
       "light lower than this over the sample's plane doesn't arrive",
       PATINA_FIELD(selfShadowing, horizonDeg)},
      {"self-shadowing", "softDeg", "degrees", 3, kShape, 0.5, 30, "width of the edge",
       PATINA_FIELD(selfShadowing, softDeg)},
      {"self-shadowing", "sectorDeg", "degrees", 360, kShape, 1, 360, "part of the horizon that is so high",
       PATINA_FIELD(selfShadowing, sectorDeg)},
      {"self-shadowing", "azimuthDeg", "degrees", 0, kShape, -360, 360,
       "its middle, from the sample's x axis towards y", PATINA_FIELD(selfShadowing, azimuthDeg)},
      {"glare", "share", "", 0, kStrength, 0, 0.9, "share of the picture that is spread",
       PATINA_FIELD(glare, share)},
      {"glare", "radiusPx", "pixels", 4, kShape, 0.3, 200, "standard deviation of the spread",
       PATINA_FIELD(glare, radiusPx)},
      {"defocus", "sigmaPx", "pixels", 0, kStrength, 0, 30, "standard deviation of the blur",
       PATINA_FIELD(defocus, sigmaPx)},
      {"vignetting", "corners", "", 0, kStrength, -1, 0.95, "share of light that the picture's corners lack",
       PATINA_FIELD(vignetting, corners)},
      {"camera-response", "gamma", "", 1, kStrength, 0.3, 3,
       "the sensor's value over full scale to this power", PATINA_FIELD(cameraResponse, gamma)},
      {"camera-response", "compression", "", 0, kStrength, 0, 20,
       "c in (1 + c) u / (1 + c u), u the value over full scale", PATINA_FIELD(cameraResponse, compression)},
      {"black-level", "offset", "of full scale", 0, kStrength, -0.5, 0.5,
       "added to every photograph but the black one", PATINA_FIELD(blackLevel, offset)},
      {"channel-crosstalk", "amount", "", 0, kStrength, 0, 0.33,
       "share that a channel gives to each of the two others", PATINA_FIELD(channelCrosstalk, amount)},
      {"ambient-drift", "perPhoto", "of full scale", 0, kStrength, -0.1, 0.1,
       "growth of the room's light from photograph to photograph", PATINA_FIELD(ambientDrift, perPhoto)},
      {"ambient-drift", "sd", "of full scale", 0, kStrength, 0, 0.1,
       "standard deviation of a part of it that each photograph draws anew", PATINA_FIELD(ambientDrift, sd)},
      {"ambient-drift", "onSheet", "", 0, kShape, 0, 1,
       "share that the sheet reflects by its diffuse albedo; the rest is a veil",
       PATINA_FIELD(ambientDrift, onSheet)},
      {"stray-light", "share", "", 0, kStrength, 0, 1,
       "veil over the whole picture, of the picture's own mean", PATINA_FIELD(strayLight, share)},
      {"saturation", "level", "of full scale", 1, kStrength, 0.02, 1, "where the sensor clips",
       PATINA_FIELD(saturation, level)},
      {"exposure-mismatch", "error", "", 0, kStrength, -0.9, 5,
       "relative error of the exposure of the later photographs", PATINA_FIELD(exposureMismatch, error)},
      {"exposure-mismatch", "share", "", 0.5, kShape, 0.01, 0.99,
       "of the photographs that have it; they are declared as one exposure, the others as another",
       PATINA_FIELD(exposureMismatch, share)},
  };
}

#undef PATINA_FIELD

bool isOn(const Field& field, const SimulatedEffects& effects) {
  return field.strength && field.get(effects) != field.none;
}

}  // namespace

const std::vector<SimulatedEffectField>& simulatedEffectFields() {
  static const std::vector<Field> fields = allFields();
  return fields;
}

std::vector<std::string> SimulatedEffects::ids() const {
  std::vector<std::string> on;
  for (const Field& field : simulatedEffectFields())
    if (isOn(field, *this) && (on.empty() || on.back() != field.id)) on.emplace_back(field.id);
  return on;
}

bool SimulatedEffects::has(std::string_view id) const {
  const auto& fields = simulatedEffectFields();
  return std::any_of(fields.begin(), fields.end(),
                     [&](const Field& field) { return field.id == id && isOn(field, *this); });
}

std::vector<std::string> SimulatedEffects::validate(int materials) const {
  std::vector<std::string> problems;
  for (const Field& field : simulatedEffectFields()) {
    const double value = field.get(*this);
    const std::string name = std::string(field.id) + "." + std::string(field.name);
    if (!(value >= field.least && value <= field.most)) {
      char range[80];
      std::snprintf(range, sizeof range, " must lie in %g to %g", field.least, field.most);
      problems.push_back(name + range);
    } else if (field.name == "material" && (value != std::floor(value) || value >= materials)) {
      problems.push_back(name + " must be the index of one of the sheet's materials, or -1");
    }
  }
  return problems;
}

nlohmann::json simulatedEffectsJson(const SimulatedEffects& effects) {
  nlohmann::json json = nlohmann::json::object();
  for (const std::string& id : effects.ids())
    for (const Field& field : simulatedEffectFields())
      if (field.id == id) json[id][std::string(field.name)] = field.get(effects);
  return json;
}

Result<SimulatedEffects> simulatedEffectsFromJson(std::string_view text, const std::string& where) {
  const nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
  if (!json.is_object())
    return Error{ErrorCode::Malformed, "the effects are not a JSON object", where,
                 R"(write {"anisotropy": {"ratio": 1.2}})"};
  SimulatedEffects effects;
  std::vector<std::string> ids;
  for (const Field& field : simulatedEffectFields())
    if (ids.empty() || ids.back() != field.id) ids.emplace_back(field.id);
  for (const auto& [id, values] : json.items()) {
    if (std::find(ids.begin(), ids.end(), id) == ids.end()) {
      const std::string like = nearestWord(id, ids);
      return Error{ErrorCode::Invalid, "the simulated rig has no effect " + inQuotes(id), where,
                   like.empty() ? "use one of the simulated effects" : "did you mean " + like + "?"};
    }
    if (!values.is_object())
      return Error{ErrorCode::Malformed, id + " is not an object of numbers", where,
                   "write {} for the defaults"};
    for (const auto& [name, value] : values.items()) {
      std::vector<std::string> names;
      const Field* found = nullptr;
      for (const Field& field : simulatedEffectFields()) {
        if (field.id != id) continue;
        names.emplace_back(field.name);
        if (field.name == name) found = &field;
      }
      if (!found) {
        const std::string like = nearestWord(name, names);
        return Error{ErrorCode::Invalid, id + " has no field " + inQuotes(name), where,
                     like.empty() ? "leave it out" : "did you mean " + like + "?"};
      }
      if (!value.is_number())
        return Error{ErrorCode::Malformed, id + "." + name + " is not a number", where, "give one"};
      found->of(effects) = value.get<double>();
    }
  }
  const std::vector<std::string> problems = effects.validate();
  if (!problems.empty()) return Error{ErrorCode::Invalid, problems.front(), where, "correct this value"};
  return effects;
}

}  // namespace patina
