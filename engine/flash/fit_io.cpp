#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "engine/base/atomic_file.h"
#include "engine/flash/fit.h"
#include "engine/image/exr.h"

namespace patina {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

Json measured(double value) {
  return value >= 0 ? Json(value) : Json(nullptr);
}

template <typename Vector>
Json listOf(const Vector& v) {
  Json list = Json::array();
  for (Eigen::Index i = 0; i < v.size(); ++i) list.push_back(v[i]);
  return list;
}

Json rigJson(const FlashFit& fit) {
  Json rig = Json::object();
  const FlashRig& found = fit.model.rig;
  for (const FlashEffect effect : fit.options.effects) {
    switch (effect) {
      case FlashEffect::CameraResponse: {
        Json curve = Json::array();
        for (int i = 1; i <= 20; ++i)
          curve.push_back({{"light", fit.model.tone.light(0.05 * i)}, {"value", 0.05 * i}});
        rig["camera_response"] = {{"log_slope", found.toneLogSlope}, {"curve", curve}};
        break;
      }
      case FlashEffect::LightPower: {
        Json gains = Json::array();
        for (std::size_t k = 0; k < fit.capture.photos.size(); ++k)
          gains.push_back({{"file", fit.capture.photos[k].file},
                           {"factor", std::exp(found.logGain[k])},
                           {"fitted", !fit.capture.photos[k].holdout}});
        rig["light_power"] = gains;
        break;
      }
      case FlashEffect::NearLight:
        rig["near_light"] = {{"beam_fall_off", found.beamFallOff}, {"aim", listOf(found.aim)}};
        break;
      case FlashEffect::Vignetting:
        rig["vignetting"] = {{"fall_off", found.vignetting}};
        break;
      case FlashEffect::StrayLight:
        rig["ambient_irradiance"] = listOf(found.ambient);
        break;
      case FlashEffect::BlackLevel:
        rig["black_level"] = listOf(found.black);
        break;
      default:
        break;
    }
  }
  return rig;
}

Json toJson(const FlashFit& fit) {
  const FlashFitStats& stats = fit.stats;
  Json json;
  json["kind"] = "flash";
  json["bundle"] = fs::absolute(fit.capture.folder).lexically_normal().string();
  json["sample_mm"] = {fit.capture.widthMm, fit.capture.heightMm};
  json["map_size"] = {fit.maps.width, fit.maps.height};
  json["seconds"] = stats.seconds;
  json["texels"] = stats.texels;
  json["iterations"] = stats.meanIterations;
  Json effects = Json::array();
  for (const FlashEffect effect : fit.options.effects) effects.push_back(flashEffectId(effect));
  json["options"] = {{"size", fit.options.size},
                     {"materials", fit.options.materials},
                     {"shared_texels", fit.options.sharedTexels},
                     {"effects", effects.empty() ? Json("none") : effects}};
  json["cancelled"] = stats.cancelled;
  json["rms_is"] =
      "relative root mean square over pixels and channels, in linear pixel values as the bundle's encoding "
      "decodes them; both sides clipped where the camera clips";
  json["fit_rms"] = measured(stats.fitRms);
  json["holdout_rms"] = measured(stats.holdoutRms);
  json["noise_floor"] = measured(stats.holdoutRms >= 0 ? stats.noiseFloorHoldout
                                 : stats.fitRms >= 0   ? stats.noiseFloorFit
                                                       : -1);
  json["noise_floor_fit"] = measured(stats.fitRms >= 0 ? stats.noiseFloorFit : -1);
  json["noise_floor_holdout"] = measured(stats.holdoutRms >= 0 ? stats.noiseFloorHoldout : -1);
  json["noise"] = {{"shot", stats.noiseShot}, {"read", stats.noiseRead}};
  json["status"] = stats.statusCounts;
  json["clipped_samples"] = stats.clippedSamples;
  json["materials"] = Json::array();
  for (std::size_t m = 0; m < fit.model.materials.size(); ++m) {
    const FlashMaterial& material = fit.model.materials[m];
    std::size_t count = 0;
    for (const std::uint8_t one : fit.texels.material) count += one == m;
    Json one = {{"share", static_cast<double>(count) / static_cast<double>(fit.texels.material.size())},
                {"sigma", material.lobe.sigma()},
                {"kurtosis", material.lobe.kurtosis()},
                {"discrepancy", material.discrepancy}};
    for (const FlashEffect effect : fit.options.effects) {
      if (effect == FlashEffect::Anisotropy) one["anisotropy_ratio"] = std::exp(material.lobe.stretch.norm());
      if (effect == FlashEffect::ThirdLobe) {
        one["third_lobe_share"] = material.lobe.thirdShare;
        one["third_lobe_ratio"] = std::exp(material.lobe.logThirdRatio);
      }
      if (effect == FlashEffect::BasisDeviation) one["log_factor"] = material.lobe.deviation;
    }
    json["materials"].push_back(std::move(one));
  }
  if (!fit.options.effects.empty()) json["rig"] = rigJson(fit);
  json["photos"] = Json::array();
  for (const FlashComparison& photo : fit.comparisons) {
    json["photos"].push_back({{"file", photo.file},
                              {"split", photo.holdout ? "holdout" : "fit"},
                              {"rms", measured(photo.rms)},
                              {"noise_floor", photo.noiseFloor}});
  }
  json["remarks"] = stats.remarks;
  return json;
}

}  // namespace

Status writeFlashFit(const fs::path& folder, const FlashFit& fit,
                     const std::function<Status(const fs::path&)>& writeMore) {
  auto staged = StagedFolder::create(folder);
  if (!staged) return staged.error();
  std::error_code failed;
  const fs::path maps = staged->path() / "maps";
  fs::create_directories(maps, failed);
  if (failed)
    return Error{ErrorCode::WriteFailed, "can't make the folder for the maps: " + failed.message(),
                 folder.string(), "check the disk's space and permissions"};
  if (auto status = writeMaps(maps, fit.maps); !status) return status;
  for (const auto& [name, map] : flashEffectMaps(fit)) {
    if (auto status = writeExr(maps / (name + ".exr"), map, {"Y"}, {{"patina:meaning", name}}); !status)
      return status;
  }
  if (auto status =
          writeFileAtomically(staged->path() / "fit.json",
                              toJson(fit).dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
      !status)
    return status;
  if (writeMore) {
    if (auto status = writeMore(staged->path()); !status) return status;
  }
  return staged->commit();
}

}  // namespace patina
