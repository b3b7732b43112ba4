#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>

#include "engine/base/text.h"
#include "engine/calibration/calibration_file.h"
#include "engine/calibration/calibration_format.h"
#include "engine/capture/bundle_path.h"
#include "engine/capture/capture_parts.h"
#include "engine/capture/json_reader.h"

namespace patina {
namespace {

using capture_parts::vector2;
using capture_parts::vector3;

constexpr double kLargest = 1e12;  // of what has no natural bound
constexpr std::size_t kMostSamples = 65536, kMostRemarks = 1000;

std::vector<double> numberList(JsonObject& object, const std::string& name, std::size_t fewest, double low,
                               double high) {
  const std::size_t count = object.list(name, fewest, kMostSamples).size();
  return object.numbers(name, count, low, high);
}

/// A camera without a pose: the pose is filled in, so that the reader of whole cameras does the checks.
Camera readLens(const nlohmann::json& file, const std::string& where) {
  const auto found = file.find("camera");
  if (found == file.end() || !found->is_object()) {
    JsonObject whole(file, where, "");
    whole.object("camera");  // says what is wrong
  }
  nlohmann::json copy = *found;
  copy["R"] = {{1, 0, 0}, {0, -1, 0}, {0, 0, -1}};
  copy["t"] = {0, 0, 100};
  JsonObject camera(copy, where, "camera");
  Camera lens = capture_parts::readCamera(camera);
  lens.cameraFromWorld = Eigen::Matrix3d::Identity();
  lens.translationMm = Eigen::Vector3d::Zero();
  return lens;
}

Board readBoard(JsonObject& object, const std::string& name) {
  const Result<Board> board = parseBoard(object.text(name), "board");
  if (!board) object.fail(ErrorCode::Invalid, name, board.error().what, board.error().tryThis);
  return *board;
}

PlacedBoard readPlaced(JsonObject object) {
  PlacedBoard placed;
  placed.board = readBoard(object, "board");
  placed.centreMm = vector2(object, "centre_mm", -capture_parts::kFarthestMm, capture_parts::kFarthestMm);
  placed.turnDeg = object.number("turn_deg", -360, 360);
  return placed;
}

StoredCamera readCamera(JsonObject& file, const nlohmann::json& json, const std::string& where) {
  StoredCamera stored;
  stored.camera = readLens(json, where);
  const std::vector<double> sd = file.numbers("sd", kIntrinsicCount, 0, kLargest);
  stored.sd = Eigen::Map<const IntrinsicVector>(sd.data());
  stored.board = readBoard(file, "board");
  stored.views = file.integer("views", 1, 1000000);
  return stored;
}

StoredScreenPose readScreenPose(JsonObject& file) {
  StoredScreenPose stored;
  JsonObject camera = file.object("camera");
  stored.camera = capture_parts::readCamera(camera);
  JsonObject screen = file.object("screen");
  stored.screen.widthMm = screen.number("width_mm", capture_parts::kSmallestMm, capture_parts::kLargestMm);
  stored.screen.heightMm = screen.number("height_mm", capture_parts::kSmallestMm, capture_parts::kLargestMm);
  stored.screen.widthPx = screen.integer("width_px", 1, kMaxImageSide);
  stored.screen.heightPx = screen.integer("height_px", 1, kMaxImageSide);
  stored.screen.worldFromScreen = screen.rotation("R");
  stored.screen.originMm = vector3(screen, "t", -capture_parts::kFarthestMm, capture_parts::kFarthestMm);
  stored.onSample = readPlaced(file.object("on_sample"));
  stored.onScreen = readPlaced(file.object("on_screen"));
  stored.mirrorHeightMm = file.number("mirror_height_mm", -1000, 1000);
  stored.screenAngleSdDeg = file.number("screen_angle_sd_deg", 0, 360);
  stored.screenPositionSdMm = file.number("screen_position_sd_mm", 0, kLargest);
  return stored;
}

StoredEmission readEmission(JsonObject& file) {
  StoredEmission stored;
  JsonObject emission = file.object("emission");
  capture_parts::requireType(emission, "gaussian");
  stored.emission.mean = vector2(emission, "mean", -1000, 1000);
  stored.emission.sigma = vector2(emission, "sigma", 1e-3, 1000);
  stored.emission.gain = emission.number("gain", 1e-12, kLargest);
  stored.meanSd = vector2(file, "mean_sd", 0, kLargest);
  stored.sigmaSd = vector2(file, "sigma_sd", 0, kLargest);
  stored.gainSd = file.number("gain_sd", 0, kLargest);
  stored.channelGain = vector3(file, "channel_gain", 1e-6, 1e6);
  stored.paperAlbedo = vector3(file, "paper_albedo", 0.01, 1.05);
  stored.radianceScale = file.number("radiance_scale", 1e-9, capture_parts::kLargestScale);
  return stored;
}

StoredWhiteTile readWhiteTile(JsonObject& file, const std::string& where) {
  StoredWhiteTile stored;
  JsonObject reflectance = file.object("reflectance");
  stored.reflectance.rgb = vector3(reflectance, "rgb", 0.01, 1.05);
  stored.reflectance.spread = vector3(reflectance, "spread", 0, 1);
  stored.reflectance.source = reflectance.text("source", "");
  stored.irradiance = vector3(file, "irradiance", 0, kLargest);
  stored.relativeSd = vector3(file, "relative_sd", 0, kLargest);
  const std::vector<double> region = file.numbers("region", 4, 0, kMaxImageSide);
  stored.region = {static_cast<int>(region[0]), static_cast<int>(region[1]), static_cast<int>(region[2]),
                   static_cast<int>(region[3])};
  stored.mapFile = file.text("map", "");
  if (!stored.mapFile.empty())
    if (const Status allowed = checkBundlePath(stored.mapFile, where + ": map"); !allowed)
      throw JsonFault{allowed.error()};
  return stored;
}

StoredResponse readResponse(JsonObject& file, std::string_view text, const std::string& where) {
  StoredResponse stored;
  Result<std::array<ResponseCurve, 3>> curves = parseResponse(text, where);
  if (!curves) throw JsonFault{curves.error()};
  stored.curves = std::move(*curves);
  if (!file.has("dark")) return stored;
  JsonObject dark = file.object("dark");
  DarkLevel level;
  level.level = vector3(dark, "level", -1, 1);
  level.readNoise = vector3(dark, "read_noise", 0, 1);
  level.pattern = dark.number("pattern", 0, 1);
  level.hotShare = dark.number("hot_share", 0, 1);
  level.clippedAtZero = dark.integer("clipped_at_zero", 0, 1) == 1;
  stored.dark = level;
  return stored;
}

StoredScreenResponse readScreenResponse(JsonObject& file) {
  StoredScreenResponse stored;
  stored.response.value = numberList(file, "value", 2, 0, 1);
  stored.response.light = file.numbers("light", stored.response.value.size(), 0, 1);
  for (std::size_t i = 1; i < stored.response.value.size(); ++i) {
    const std::string index = "[" + std::to_string(i) + "]";
    if (!(stored.response.value[i] > stored.response.value[i - 1]))
      file.fail(ErrorCode::Invalid, "value" + index, "the values must rise from each to the next");
    if (!(stored.response.light[i] >= stored.response.light[i - 1]))
      file.fail(ErrorCode::Invalid, "light" + index, "the light never falls, and this one does");
  }
  if (stored.response.value.front() != 0 || stored.response.value.back() != 1 ||
      stored.response.light.front() != 0 || stored.response.light.back() != 1)
    file.fail(ErrorCode::Invalid, "value", "the curve must run from black to white, (0, 0) to (1, 1)");
  stored.response.blackShare = file.number("black_share", -1, 1);
  stored.response.exponent = file.number("exponent", -1000, 1000);
  stored.response.channelSpread = file.number("channel_spread", 0, kLargest);
  return stored;
}

/// "2026-11-30T21:00:00Z".
std::chrono::system_clock::time_point readTime(JsonObject& file) {
  const std::string text = file.text("taken");
  int year = 0, month = 0, day = 0, hour = 0, minute = 0, second = 0;
  char end = 0, extra = 0;
  const int count = std::sscanf(text.c_str(), "%4d-%2d-%2dT%2d:%2d:%2d%c%c", &year, &month, &day, &hour,
                                &minute, &second, &end, &extra);
  using namespace std::chrono;
  const year_month_day date{std::chrono::year(year),
                            std::chrono::month(static_cast<unsigned>(std::clamp(month, 0, 99))),
                            std::chrono::day(static_cast<unsigned>(std::clamp(day, 0, 99)))};
  if (count != 7 || end != 'Z' || !date.ok() || year < 1970 || year > 2200 || hour < 0 || hour > 23 ||
      minute < 0 || minute > 59 || second < 0 || second > 60)
    file.fail(ErrorCode::Malformed, "taken", "this is no time: " + inQuotes(text),
              "write it like 2026-05-17T09:30:00Z");
  return sys_days(date) + hours(hour) + minutes(minute) + seconds(second);
}

}  // namespace

Result<CalibrationRecord> parseCalibration(std::string_view text, const std::string& where,
                                           std::string_view wanted) {
  namespace format = calibration_format;
  try {
    const nlohmann::json json = parseJson(text, where);
    JsonObject file(json, where, "");
    const std::string name = file.text("format");
    if (name != format::kFormat && name != format::kResponseFormat)
      file.fail(ErrorCode::Malformed, "format", "this is not a calibration: its format is " + inQuotes(name),
                "name a file that 'patina-cli calibrate' or the guided calibration wrote");
    if (file.integer("version", 0, 1 << 30) != format::kVersion)
      file.fail(ErrorCode::Unsupported, "version", "this calibration is of another version than 1",
                "calibrate again with this program, or use the program that made it");
    CalibrationRecord record;
    // A response file that something else made has its curves and nothing more.
    const bool bare = name == format::kResponseFormat && !file.has("kind");
    const std::string kind = bare ? "camera-response" : file.text("kind");
    if (std::find(format::kKinds.begin(), format::kKinds.end(), kind) == format::kKinds.end()) {
      const std::string nearest = nearestWord(kind, {format::kKinds.begin(), format::kKinds.end()});
      file.fail(ErrorCode::Unsupported, "kind", "there is no calibration of kind " + inQuotes(kind),
                nearest.empty() ? "" : "is " + nearest + " meant?");
    }
    if ((kind == "camera-response") != (name == format::kResponseFormat))
      file.fail(ErrorCode::Malformed, "kind", "format and kind don't go together");
    if (!wanted.empty() && kind != wanted)
      file.fail(ErrorCode::Invalid, "kind",
                "a calibration of kind " + inQuotes(wanted) + " is needed, and this one is of kind " +
                    inQuotes(kind),
                "name the other file");
    if (!bare) {
      record.taken = readTime(file);
      record.residual = file.number("residual", 0, kLargest);
      record.residualUnit = file.text("residual_unit", "");
    }
    record.device = file.text("device", "");
    record.madeBy = file.text("made_by", "");
    if (file.has("remarks")) {
      const nlohmann::json& remarks = file.list("remarks", 0, kMostRemarks);
      for (std::size_t i = 0; i < remarks.size(); ++i) {
        if (!remarks[i].is_string())
          file.fail(ErrorCode::Malformed, "remarks[" + std::to_string(i) + "]", "text is needed here");
        record.remarks.push_back(remarks[i].get<std::string>());
      }
    }
    if (kind == "camera") record.content = readCamera(file, json, where);
    if (kind == "screen-pose") record.content = readScreenPose(file);
    if (kind == "emission") record.content = readEmission(file);
    if (kind == "white-tile") record.content = readWhiteTile(file, where);
    if (kind == "camera-response") record.content = readResponse(file, text, where);
    if (kind == "screen-response") record.content = readScreenResponse(file);
    return record;
  } catch (const JsonFault& fault) {
    return fault.error;
  } catch (const std::exception& failure) {
    return Error{ErrorCode::Malformed, std::string("the file can't be read: ") + failure.what(), where,
                 "write it again"};
  }
}

}  // namespace patina
