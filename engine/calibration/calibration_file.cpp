#include "engine/calibration/calibration_file.h"

#include <cmath>
#include <cstdio>
#include <ctime>
#include <nlohmann/json.hpp>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/calibration/calibration_format.h"
#include "engine/capture/capture_parts.h"

namespace patina {
namespace {

using Json = nlohmann::ordered_json;
using capture_parts::jsonOf;

Json lensJson(const Camera& camera) {
  Json json = jsonOf(camera);
  json.erase("R");
  json.erase("t");
  return json;
}

Json placedJson(const PlacedBoard& placed) {
  return {{"board", boardText(placed.board)},
          {"centre_mm", jsonOf(placed.centreMm)},
          {"turn_deg", placed.turnDeg}};
}

struct ContentWriter {
  Json& json;

  void operator()(const StoredCamera& stored) const {
    json["camera"] = lensJson(stored.camera);
    json["sd"] = std::vector<double>(stored.sd.begin(), stored.sd.end());
    json["board"] = boardText(stored.board);
    json["views"] = stored.views;
  }
  void operator()(const StoredScreenPose& stored) const {
    json["camera"] = jsonOf(stored.camera);
    json["screen"] = {{"width_mm", stored.screen.widthMm},          {"height_mm", stored.screen.heightMm},
                      {"width_px", stored.screen.widthPx},          {"height_px", stored.screen.heightPx},
                      {"R", jsonOf(stored.screen.worldFromScreen)}, {"t", jsonOf(stored.screen.originMm)}};
    json["on_sample"] = placedJson(stored.onSample);
    json["on_screen"] = placedJson(stored.onScreen);
    json["mirror_height_mm"] = stored.mirrorHeightMm;
    json["screen_angle_sd_deg"] = stored.screenAngleSdDeg;
    json["screen_position_sd_mm"] = stored.screenPositionSdMm;
  }
  void operator()(const StoredEmission& stored) const {
    json["emission"] = {{"type", "gaussian"},
                        {"mean", jsonOf(stored.emission.mean)},
                        {"sigma", jsonOf(stored.emission.sigma)},
                        {"gain", stored.emission.gain}};
    json["mean_sd"] = jsonOf(stored.meanSd);
    json["sigma_sd"] = jsonOf(stored.sigmaSd);
    json["gain_sd"] = stored.gainSd;
    json["channel_gain"] = jsonOf(stored.channelGain);
    json["paper_albedo"] = jsonOf(stored.paperAlbedo);
    json["radiance_scale"] = stored.radianceScale;
  }
  void operator()(const StoredWhiteTile& stored) const {
    json["reflectance"] = {{"rgb", jsonOf(stored.reflectance.rgb)},
                           {"spread", jsonOf(stored.reflectance.spread)},
                           {"source", stored.reflectance.source}};
    json["irradiance"] = jsonOf(stored.irradiance);
    json["relative_sd"] = jsonOf(stored.relativeSd);
    json["region"] = {stored.region.x0, stored.region.y0, stored.region.x1, stored.region.y1};
    if (!stored.mapFile.empty()) json["map"] = stored.mapFile;
  }
  void operator()(const StoredResponse& stored) const {
    for (int c = 0; c < 3; ++c)
      json[std::string(1, "RGB"[c])] = {{"input", stored.curves[c].input},
                                        {"output", stored.curves[c].output}};
    if (!stored.dark) return;
    json["dark"] = {{"level", jsonOf(stored.dark->level)},
                    {"read_noise", jsonOf(stored.dark->readNoise)},
                    {"pattern", stored.dark->pattern},
                    {"hot_share", stored.dark->hotShare},
                    {"clipped_at_zero", stored.dark->clippedAtZero ? 1 : 0}};
  }
  void operator()(const StoredScreenResponse& stored) const {
    json["value"] = stored.response.value;
    json["light"] = stored.response.light;
    json["black_share"] = stored.response.blackShare;
    json["exponent"] = stored.response.exponent;
    json["channel_spread"] = stored.response.channelSpread;
  }
};

}  // namespace

std::string_view kindOf(const StoredCalibration& content) {
  return calibration_format::kKinds[content.index()];
}

std::string calibrationJson(const CalibrationRecord& record) {
  const bool response = std::holds_alternative<StoredResponse>(record.content);
  const std::time_t time = std::chrono::system_clock::to_time_t(record.taken);
  std::tm parts{};
  ::gmtime_r(&time, &parts);
  char taken[40];
  std::strftime(taken, sizeof taken, "%Y-%m-%dT%H:%M:%SZ", &parts);
  // A response's calibration is at the same time the file that a bundle's encoding names.
  Json json = {{"format", response ? calibration_format::kResponseFormat : calibration_format::kFormat},
               {"version", calibration_format::kVersion},
               {"kind", std::string(kindOf(record.content))},
               {"taken", taken}};
  if (!record.device.empty()) json["device"] = record.device;
  json["residual"] = record.residual;
  json["residual_unit"] = record.residualUnit;
  if (!record.madeBy.empty()) json["made_by"] = record.madeBy;
  if (!record.remarks.empty()) json["remarks"] = record.remarks;
  std::visit(ContentWriter{json}, record.content);
  return json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

Status writeCalibration(const std::filesystem::path& file, const CalibrationRecord& record) {
  return writeFileAtomically(file, calibrationJson(record));
}

Result<CalibrationRecord> readCalibration(const std::filesystem::path& file, std::string_view wanted) {
  const Result<std::string> text = readFile(file, calibration_format::kLargestFile);
  if (!text) return text.error();
  return parseCalibration(*text, file.string(), wanted);
}

std::string ageInWords(std::chrono::system_clock::time_point taken,
                       std::chrono::system_clock::time_point now) {
  using namespace std::chrono;
  const auto age = duration_cast<minutes>(now - taken);
  if (age < minutes(-5)) return "taken in the future: is this machine's clock right?";
  if (age < minutes(2)) return "just now";
  if (age < hours(2)) return counted(static_cast<std::size_t>(age.count()), "minute") + " ago";
  if (age < hours(48)) return counted(static_cast<std::size_t>(age.count() / 60), "hour") + " ago";
  return counted(static_cast<std::size_t>(age.count() / (24 * 60)), "day") + " ago";
}

}  // namespace patina
