#include "engine/report/explanation_files.h"

#include <nlohmann/json.hpp>
#include <set>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/flash/fit.h"
#include "engine/fourier/fit.h"
#include "engine/image/exr.h"
#include "engine/render/two_shot_pictures.h"
#include "engine/report/result_files.h"
#include "engine/twoshot/fit.h"

namespace patina {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

fs::path effectMapFile(const std::string& stem) {
  std::string name;
  for (const char c : stem.substr(0, 64)) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
    name += plain ? c : '_';
  }
  return fs::path("maps") / ((name.empty() ? "effect" : name) + ".exr");
}

namespace {

constexpr std::uint64_t kLargestJson = 64u << 20;

/// EXR channels as the house writes them: "anisotropy.ratio"; of colours: "fresnel.R".
std::vector<std::string> channelsOf(const std::string& stem, int count) {
  if (count == 3) return {stem + ".R", stem + ".G", stem + ".B"};
  if (count != 1) {
    std::vector<std::string> names;
    for (int c = 0; c < count; ++c) names.push_back(stem + "." + std::to_string(c));
    return names;
  }
  const std::size_t split = stem.find('_');
  if (split == std::string::npos) return {stem + ".value"};
  return {stem.substr(0, split) + "." + stem.substr(split + 1)};
}

/// Nothing where the final fit has nothing to write: it was cancelled before.
Status writeFit(const fs::path& folder, const Explanation& explanation) {
  if (const auto& fit = explanation.fourierAfter ? explanation.fourierAfter : explanation.fourierBefore)
    return writeFourierFit(folder, *fit);
  if (const auto& fit = explanation.twoShotAfter ? explanation.twoShotAfter : explanation.twoShotBefore)
    return writeTwoShotFit(folder, *fit,
                           [&](const fs::path& staged) { return writeTwoShotPictures(staged, *fit, {}); });
  if (const auto& fit = explanation.flashAfter ? explanation.flashAfter : explanation.flashBefore)
    return writeFlashFit(folder, *fit);
  return Done{};
}

/// fit.json of the final fit says which effects are in it.
Status noteEffects(const fs::path& file, const Explanation& explanation) {
  std::error_code none;
  if (explanation.effects.empty() || !fs::exists(file, none)) return Done{};
  auto text = readFile(file, kLargestJson);
  if (!text) return text.error();
  std::string ids;
  for (const EffectFinding& effect : explanation.effects) ids += (ids.empty() ? "" : ",") + effect.id;
  std::string changed;
  try {
    Json json = Json::parse(*text);
    // A fit that knows effects itself says so better.
    if (json["options"].contains("effects") && !json["options"]["effects"].is_string()) return Done{};
    json["options"]["effects"] = ids;
    changed = json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
  } catch (const nlohmann::json::exception& problem) {
    return Error{ErrorCode::Malformed, std::string("fit.json can't be understood: ") + problem.what(),
                 file.string(), ""};
  }
  return writeFileAtomically(file, changed);
}

Status writeEffectMaps(const fs::path& folder, const Explanation& explanation) {
  for (const EffectFinding& effect : explanation.effects)
    for (const auto& [stem, map] : effect.maps) {
      if (map.empty()) continue;
      const fs::path file = folder / effectMapFile(stem);
      std::error_code failed;
      if (fs::exists(file, failed)) continue;  // the fit has written it itself
      fs::create_directories(file.parent_path(), failed);
      if (failed)
        return Error{ErrorCode::WriteFailed, "can't make the folder for the maps: " + failed.message(),
                     folder.string(), "check the disk's space and permissions"};
      if (auto status = writeExr(file, map, channelsOf(stem, map.channels()),
                                 {{"effect", effect.id}, {"frame", "sample rectangle, row 0 at +y"}});
          !status)
        return status;
    }
  return Done{};
}

/// The maps of effects that an earlier result in `folder` says it wrote. Nothing that isn't one of ours.
std::set<fs::path> earlierMaps(const fs::path& folder) {
  std::set<fs::path> files;
  const auto text = readFile(folder / "explain.json", kLargestJson);
  if (!text) return files;
  const Json json = Json::parse(*text, nullptr, false);
  if (!json.is_object() || !json.contains("effects") || !json["effects"].is_array()) return files;
  for (const Json& effect : json["effects"]) {
    if (!effect.is_object() || !effect.contains("maps") || !effect["maps"].is_array()) continue;
    for (const Json& file : effect["maps"])
      if (file.is_string()) {
        const fs::path path = file.get<std::string>();
        // Only names that we would write ourselves: a stranger's explain.json must not have files removed.
        if (path == effectMapFile(path.stem().string())) files.insert(path);
      }
  }
  return files;
}

/// A bundle, which is never written to, or something below one.
bool belongsToBundle(const fs::path& folder, const Explanation& explanation) {
  std::error_code none;
  if (fs::exists(folder / "capture.json", none)) return true;
  for (fs::path at = fs::weakly_canonical(fs::absolute(folder, none), none); !at.empty();
       at = at.parent_path()) {
    for (const fs::path& bundle : explanation.bundles)
      if (!bundle.empty() && fs::equivalent(at, bundle, none)) return true;
    if (at == at.parent_path()) break;
  }
  return false;
}

}  // namespace

namespace {

Status write(const fs::path& folder, const Explanation& explanation, bool withReport) {
  if (belongsToBundle(folder, explanation))
    return Error{ErrorCode::Refused, "a bundle is never written to", folder.string(),
                 "choose a folder beside it"};
  std::string report;
  if (withReport) {
    auto made = explanationReport(explanation);
    if (!made) return made.error();
    report = std::move(*made);
  }
  std::set<fs::path> stale = earlierMaps(folder);
  for (const EffectFinding& effect : explanation.effects)
    for (const auto& [stem, map] : effect.maps) stale.erase(effectMapFile(stem));

  auto staged = StagedFolder::create(folder);
  if (!staged) return staged.error();
  if (auto status = writeFit(staged->path(), explanation); !status) return status;
  if (auto status = noteEffects(staged->path() / "fit.json", explanation); !status) return status;
  if (auto status = writeEffectMaps(staged->path(), explanation); !status) return status;
  if (withReport) {
    if (auto status = writeFileAtomically(staged->path() / "report.html", report); !status) return status;
    if (auto status = writeFileAtomically(staged->path() / "explain.json", explanationJson(explanation));
        !status)
      return status;
  }
  // A map of an effect that the new result doesn't have would be taken for a part of it, unless the new fit
  // has a map of that name itself.
  for (auto file = stale.begin(); file != stale.end();) {
    std::error_code none;
    file = fs::exists(staged->path() / *file, none) ? stale.erase(file) : std::next(file);
  }
  if (auto status = staged->commit(); !status) return status;
  for (const fs::path& file : stale) {
    std::error_code none;
    fs::remove(folder / file, none);
  }
  return Done{};
}

}  // namespace

Status writeExplanation(const fs::path& folder, const Explanation& explanation) {
  return write(folder, explanation, true);
}

Status writeExplainedFit(const fs::path& folder, const Explanation& explanation) {
  return write(folder, explanation, false);
}

}  // namespace patina
