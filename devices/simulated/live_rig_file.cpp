// Live rigs by name and from files.
#include <algorithm>
#include <nlohmann/json.hpp>

#include "devices/simulated/live_rig.h"
#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/brdf/brdf_file.h"

namespace patina {
namespace {

constexpr const char* kPrefix = "simulated:";
constexpr std::uint64_t kMostBytes = 1u << 20;

struct NumberField {
  const char* name;
  double LiveRigSetup::*field;
};
constexpr NumberField kNumbers[] = {{"gamma", &LiveRigSetup::gamma},
                                    {"refreshHz", &LiveRigSetup::refreshHz},
                                    {"flickerDepth", &LiveRigSetup::flickerDepth},
                                    {"latencyMs", &LiveRigSetup::latencyMs},
                                    {"riseMs", &LiveRigSetup::riseMs},
                                    {"fullScaleSecond", &LiveRigSetup::fullScaleSecond},
                                    {"ambient", &LiveRigSetup::ambient},
                                    {"pedestal", &LiveRigSetup::pedestal},
                                    {"leastExposureS", &LiveRigSetup::leastExposureS},
                                    {"mostExposureS", &LiveRigSetup::mostExposureS},
                                    {"mostGain", &LiveRigSetup::mostGain},
                                    {"readoutMs", &LiveRigSetup::readoutMs}};

}  // namespace

Result<LiveRigSetup> LiveRig::fromJson(std::string_view text, const std::string& where) {
  const nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
  if (!json.is_object())
    return Error{ErrorCode::Malformed, "this is not a JSON object that describes a simulated rig", where,
                 "see the fields of the simulated rig in docs/rig.md"};
  const auto bad = [&](const std::string& key, const std::string& what, const std::string& tryThis) {
    return Error{ErrorCode::Invalid, what, where + ": " + key, tryThis};
  };
  std::string scene = "laminate";
  int pixels = 64, screenPx = 960;
  if (json.contains("scene")) {
    if (!json["scene"].is_string()) return bad("scene", "a scene is named by a text", "write \"laminate\"");
    scene = json["scene"];
    const std::vector<std::string> names = simulatedSceneNames();
    if (std::ranges::find(names, scene) == names.end()) {
      std::string all;
      for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
      return bad("scene", inQuotes(scene) + " is not a scene", "one of: " + all);
    }
  }
  for (const auto& [key, target, most] :
       {std::tuple{"pixels", &pixels, 2048}, std::tuple{"screenPx", &screenPx, 8192}}) {
    if (!json.contains(key)) continue;
    if (!json[key].is_number_integer() || json[key] < 4 || json[key] > most)
      return bad(key, "this must be a whole number from 4 to " + std::to_string(most), "write 64");
    *target = json[key];
  }
  LiveRigSetup setup = desk(scene, pixels, screenPx);
  std::vector<std::string> known{"scene", "pixels", "screenPx", "brdfs",       "effects",
                                 "noise", "seed",   "bayer12",  "settleFrames"};
  for (const NumberField& field : kNumbers) known.emplace_back(field.name);
  for (const auto& [key, value] : json.items()) {
    if (std::ranges::find(known, key) == known.end()) {
      const std::string nearest = nearestWord(key, known);
      return bad(key, "the simulated rig has no such field",
                 nearest.empty() ? "remove it" : "write " + inQuotes(nearest));
    }
    for (const NumberField& field : kNumbers) {
      if (key != field.name) continue;
      if (!value.is_number()) return bad(key, "this must be a number", "correct it");
      setup.*field.field = value;
    }
  }
  if (json.contains("noise")) {
    const nlohmann::json& noise = json["noise"];
    for (const auto& [key, target] :
         {std::pair{"shot", &setup.noise.shot}, std::pair{"read", &setup.noise.read}}) {
      if (!noise.is_object() || !noise.contains(key) || !noise[key].is_number())
        return bad("noise", "noise is an object with the numbers shot and read",
                   "write {\"shot\": 2e-5, \"read\": 2e-4}");
      *target = noise[key];
    }
  }
  if (json.contains("seed")) {
    if (!json["seed"].is_number_unsigned()) return bad("seed", "this must be a whole number", "write 1");
    setup.seed = json["seed"];
  }
  if (json.contains("settleFrames")) {
    if (!json["settleFrames"].is_number_integer())
      return bad("settleFrames", "this must be a whole number", "write 2");
    setup.settleFrames = json["settleFrames"];
  }
  if (json.contains("bayer12")) {
    if (!json["bayer12"].is_boolean()) return bad("bayer12", "this must be true or false", "write true");
    setup.bayer12 = json["bayer12"];
  }
  if (json.contains("brdfs")) {
    if (!json["brdfs"].is_array())
      return bad("brdfs", "this must be a list of BRDFs", "write [\"built-in:red-plastic\"]");
    for (const nlohmann::json& source : json["brdfs"]) {
      if (!source.is_string())
        return bad("brdfs", "a BRDF is named by a text", "write \"built-in:red-plastic\"");
      Result<BrdfPtr> brdf = openBrdf(source);
      if (!brdf) return brdf.error();
      setup.brdfs.push_back(*brdf);
    }
  }
  if (json.contains("effects")) {
    Result<SimulatedEffects> effects = simulatedEffectsFromJson(json["effects"].dump(), where + ": effects");
    if (!effects) return effects.error();
    setup.effects = *effects;
  }
  if (const std::vector<std::string> problems = setup.validate(); !problems.empty())
    return Error{ErrorCode::Invalid, problems.front(), where, "correct this value"};
  return setup;
}

Result<std::vector<CameraInfo>> LiveRigProvider::list() {
  std::vector<CameraInfo> cameras;
  for (const std::string& scene : simulatedSceneNames())
    cameras.push_back({kPrefix + scene, "Simulated rig: " + simulatedSceneSummary(scene), backend(), ""});
  return cameras;
}

Result<std::shared_ptr<LiveRig>> LiveRigProvider::rig(const std::string& id, bool realTime) {
  for (const auto& [name, rig] : rigs_)
    if (name == id && rig->setup().realTime == realTime) return rig;
  if (!id.starts_with(kPrefix))
    return Error{ErrorCode::NotFound, inQuotes(id) + " is no simulated rig", "", "write simulated:laminate"};
  const std::string name = id.substr(std::string(kPrefix).size());
  LiveRigSetup setup;
  const std::vector<std::string> scenes = simulatedSceneNames();
  if (std::ranges::find(scenes, name) != scenes.end()) {
    setup = LiveRig::desk(name);
  } else if (name.ends_with(".json")) {
    const Result<std::string> text = readFile(name, kMostBytes);
    if (!text) return text.error();
    Result<LiveRigSetup> read = LiveRig::fromJson(*text, name);
    if (!read) return read.error();
    setup = std::move(*read);
  } else {
    std::string all;
    for (const std::string& scene : scenes) all += (all.empty() ? "" : ", ") + scene;
    return Error{ErrorCode::NotFound, "there is no simulated rig " + inQuotes(name), "",
                 "one of: " + all + "; or simulated:FILE.json"};
  }
  setup.realTime = realTime;
  Result<std::shared_ptr<LiveRig>> made = LiveRig::create(setup);
  if (made) rigs_.emplace_back(id, *made);
  return made;
}

Result<std::unique_ptr<CameraDevice>> LiveRigProvider::open(const std::string& id) {
  const Result<std::shared_ptr<LiveRig>> found = rig(id);
  if (!found) return found.error();
  return (*found)->openCamera();
}

}  // namespace patina
