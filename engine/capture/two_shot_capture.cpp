#include "engine/capture/two_shot_capture.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/capture/bundle_path.h"
#include "engine/capture/capture_parts.h"

namespace patina {
namespace fs = std::filesystem;
using namespace capture_parts;
namespace {

using Json = nlohmann::json;

constexpr double kSmallestReflectance = 1e-3;  // darker is no white reference
constexpr double kLargestReflectance = 1.5;    // fluorescent tiles pass 1 a little
/// A direction's length may be off by rounding to three decimals.
constexpr double kUnitTolerance = 2e-3;
/// Lower, and the light only grazes the sample: nothing that a pose can be known well enough for.
constexpr double kLowestLightZ = 1e-3;
constexpr double kShortestExposureS = 1e-9;

void requireTwoShot(JsonObject& file) {
  const std::string kind = readHead(file);
  if (kind == "two-shot") return;
  const bool known = kind == "fourier" || kind == "flash";
  file.fail(
      ErrorCode::Unsupported, "kind",
      known ? "this is a " + inQuotes(kind) + " capture, and not of kind 'two-shot'"
            : inQuotes(kind) + " is not a kind of capture that this program knows",
      known ? "open it as what it is, or choose a bundle of kind 'two-shot'" : "use the kind 'two-shot'");
}

void readSample(JsonObject& file, TwoShotCapture* capture) {
  JsonObject sample = file.object("sample");
  const std::string shape = sample.text("shape");
  capture->disc = shape == "disc";
  if (capture->disc) {
    capture->radiusMm = sample.number("radius_mm", kSmallestMm, kLargestMm);
  } else if (shape == "rectangle") {
    capture->widthMm = sample.number("width_mm", kSmallestMm, kLargestMm);
    capture->heightMm = sample.number("height_mm", kSmallestMm, kLargestMm);
  } else {
    sample.fail(ErrorCode::Unsupported, "shape",
                inQuotes(shape) + " is not a shape of a sample that this version knows",
                "use 'disc' with 'radius_mm', or 'rectangle' with 'width_mm' and 'height_mm'");
  }
  capture->sampleName = readSampleName(sample);
  noteUnread(sample, "sample", &capture->ignoredKeys);
}

Eigen::Vector3d readDirection(JsonObject& light) {
  const Eigen::Vector3d direction = vector3(light, "direction", -2, 2);
  if (!(std::abs(direction.norm() - 1) <= kUnitTolerance)) {
    light.fail(ErrorCode::Invalid, "direction", "the light's direction is not of length 1",
               "divide the direction from the sample to the light by its length");
  }
  if (!(direction.z() >= kLowestLightZ)) {
    light.fail(ErrorCode::Invalid, "direction",
               "this light is not in front of the sample: its z is not above 0",
               "check that the direction points from the sample to the light, with the sample facing +z");
  }
  return direction.normalized();
}

TwoShotPhoto readOne(JsonObject& object, const std::string& where, const std::string& list, bool white,
                     TwoShotCapture* capture) {
  TwoShotPhoto photo;
  photo.file = readFileName(object, where);
  JsonObject camera = object.object("camera");
  photo.camera = readCamera(camera);
  noteUnread(camera, list + ".camera", &capture->ignoredKeys);
  JsonObject light = object.object("light");
  requireType(light, "directional");
  photo.toLight = readDirection(light);
  if (!white && light.has("normal_irradiance")) {
    photo.normalIrradiance = vector3(light, "normal_irradiance", 1 / kLargestScale, kLargestScale);
  }
  noteUnread(light, list + ".light", &capture->ignoredKeys);
  photo.exposureS = object.number("exposure_s", kShortestExposureS, kLongestExposureS);
  if (!white) photo.holdout = readHoldout(object);
  photo.encoding = readEncoding(object, where, photo.file);
  noteUnread(object, list, &capture->ignoredKeys);
  return photo;
}

std::vector<TwoShotPhoto> readList(JsonObject& parent, const std::string& where, const std::string& list,
                                   bool white, TwoShotCapture* capture) {
  const Json& entries = parent.list("shots", 1, kMostPhotos);
  std::vector<TwoShotPhoto> photos;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    JsonObject object(entries[i], where, parent.keyOf("shots") + "[" + std::to_string(i) + "]");
    photos.push_back(readOne(object, where, list, white, capture));
  }
  return photos;
}

void readWhite(JsonObject& file, const std::string& where, TwoShotCapture* capture) {
  JsonObject reference = file.object("white_reference");
  capture->whiteReflectance = vector3(reference, "reflectance", kSmallestReflectance, kLargestReflectance);
  capture->whiteShots = readList(reference, where, "white_reference.shots[]", true, capture);
  noteUnread(reference, "white_reference", &capture->ignoredKeys);
}

/// Every shot can be made absolute, and one at least can be fitted.
void checkShots(const JsonObject& file, const TwoShotCapture& capture) {
  bool fitted = false;
  for (std::size_t i = 0; i < capture.shots.size(); ++i) {
    const TwoShotPhoto& shot = capture.shots[i];
    fitted |= !shot.holdout;
    if (shot.normalIrradiance) continue;
    const bool hasWhite = std::any_of(capture.whiteShots.begin(), capture.whiteShots.end(),
                                      [&](const TwoShotPhoto& white) { return sameLight(shot, white); });
    if (!hasWhite) {
      file.fail(ErrorCode::Invalid, "shots[" + std::to_string(i) + "].light",
                "no photograph of the white reference was taken under this shot's light (within 0.1 degrees)",
                "add one to white_reference.shots, or give the light's normal_irradiance");
    }
  }
  if (!fitted) {
    file.fail(ErrorCode::Invalid, "shots", "every shot is held out, and none is left to fit",
              "take 'split': 'holdout' away from one at least");
  }
}

Status checkFiles(const TwoShotCapture& capture, const std::string& where, const JobContext& job) {
  std::map<fs::path, std::string> files;
  std::set<std::string> encodings;
  const auto check = [&](const std::vector<TwoShotPhoto>& photos, const std::string& list) -> Status {
    for (std::size_t i = 0; i < photos.size(); ++i) {
      if (job.cancelled()) return Error{ErrorCode::Cancelled, "reading the bundle was cancelled", where, ""};
      const std::string key = list + "[" + std::to_string(i) + "]";
      Result<fs::path> file = resolveInBundle(capture.folder, photos[i].file, where + ": " + key + ".file");
      if (!file) return file.error();
      const auto [other, isNew] = files.emplace(*file, key);
      if (!isNew) {
        job.warn(other->second + " and " + key + " name the same file, " + inQuotes(photos[i].file));
      }
      if (!encodings.insert(photos[i].encoding).second) continue;
      Status encoding = checkEncoding(capture.folder, photos[i].encoding, where + ": " + key + ".encoding");
      if (!encoding) return encoding;
    }
    return Done{};
  };
  Status shots = check(capture.shots, "shots");
  if (!shots) return shots;
  return check(capture.whiteShots, "white_reference.shots");
}

nlohmann::ordered_json jsonOf(const TwoShotPhoto& photo) {
  nlohmann::ordered_json light = {{"type", "directional"},
                                  {"direction", capture_parts::jsonOf(photo.toLight)}};
  if (photo.normalIrradiance) light["normal_irradiance"] = capture_parts::jsonOf(*photo.normalIrradiance);
  nlohmann::ordered_json object = {{"file", photo.file},
                                   {"camera", capture_parts::jsonOf(photo.camera)},
                                   {"light", std::move(light)},
                                   {"exposure_s", photo.exposureS}};
  if (photo.holdout) object["split"] = "holdout";
  if (!photo.encoding.empty()) object["encoding"] = photo.encoding;
  return object;
}

}  // namespace

bool sameLight(const TwoShotPhoto& a, const TwoShotPhoto& b) {
  // The chord, because acos loses small angles.
  constexpr double kChord = 0.1 * std::numbers::pi / 180;
  return (a.toLight - b.toLight).norm() <= kChord;
}

Result<std::string> captureKind(const fs::path& folder) {
  Result<fs::path> description = findDescription(folder);
  if (!description) return description.error();
  const std::string where = description->string();
  Result<std::string> text = readFile(*description, kLargestDescription);
  if (!text) return text.error();
  try {
    const Json json = parseJson(*text, where);
    return JsonObject(json, where, "").text("kind");
  } catch (const JsonFault& fault) {
    return fault.error;
  } catch (const std::exception& failure) {  // no memory
    return Error{ErrorCode::Malformed, std::string("the file can't be read: ") + failure.what(), where,
                 "check that this is the right file"};
  }
}

Result<TwoShotCapture> parseTwoShotCapture(std::string_view text, const fs::path& folder,
                                           const std::string& where) {
  try {
    const Json json = parseJson(text, where);
    JsonObject file(json, where, "");
    requireTwoShot(file);
    TwoShotCapture capture;
    capture.folder = folder;
    readSample(file, &capture);
    capture.shots = readList(file, where, "shots[]", false, &capture);
    const bool needsWhite =
        std::any_of(capture.shots.begin(), capture.shots.end(),
                    [](const TwoShotPhoto& shot) { return !shot.normalIrradiance.has_value(); });
    if (needsWhite || file.has("white_reference")) readWhite(file, where, &capture);
    checkShots(file, capture);
    if (file.has("saturation")) {
      capture.saturation = file.number("saturation", 1 / kLargestScale, kLargestScale);
    }
    // Informational; anything but a text is a stranger's key, and ignored like one.
    if (json.contains("made_by") && json["made_by"].is_string()) capture.madeBy = file.text("made_by");
    noteUnread(file, "", &capture.ignoredKeys);
    return capture;
  } catch (const JsonFault& fault) {
    return fault.error;
  } catch (const std::exception& failure) {  // no memory
    return Error{ErrorCode::Malformed, std::string("the file can't be read: ") + failure.what(), where,
                 "check that this is the right file"};
  }
}

std::string twoShotCaptureJson(const TwoShotCapture& capture) {
  nlohmann::ordered_json json;
  json["format"] = "patina-capture";
  json["version"] = kVersion;
  json["kind"] = "two-shot";
  if (!capture.madeBy.empty()) json["made_by"] = capture.madeBy;
  if (capture.disc) {
    json["sample"] = {{"shape", "disc"}, {"radius_mm", capture.radiusMm}};
  } else {
    json["sample"] = {{"shape", "rectangle"}, {"width_mm", capture.widthMm}, {"height_mm", capture.heightMm}};
  }
  if (!capture.sampleName.empty()) json["sample"]["name"] = capture.sampleName;
  if (capture.saturation > 0) json["saturation"] = capture.saturation;
  json["shots"] = nlohmann::ordered_json::array();
  for (const TwoShotPhoto& shot : capture.shots) json["shots"].push_back(jsonOf(shot));
  if (!capture.whiteShots.empty()) {
    json["white_reference"] = {{"reflectance", capture_parts::jsonOf(capture.whiteReflectance)}};
    json["white_reference"]["shots"] = nlohmann::ordered_json::array();
    for (const TwoShotPhoto& shot : capture.whiteShots) {
      json["white_reference"]["shots"].push_back(jsonOf(shot));
    }
  }
  return json.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

Result<TwoShotCapture> readTwoShotCapture(const fs::path& folder, const JobContext& job) {
  Result<fs::path> description = findDescription(folder);
  if (!description) return description.error();
  Result<std::string> text = readFile(*description, kLargestDescription);
  if (!text) return text.error();
  const fs::path home = description->has_parent_path() ? description->parent_path() : fs::path(".");
  Result<TwoShotCapture> capture = parseTwoShotCapture(*text, home, description->string());
  if (!capture) return capture;
  Status files = checkFiles(*capture, description->string(), job);
  if (!files) return files.error();
  for (const std::string& key : capture->ignoredKeys) {
    job.info("The key " + inQuotes(key) + " in " + description->string() +
             " is not known to this version and was ignored.");
  }
  return capture;
}

Status writeTwoShotCapture(const TwoShotCapture& capture) {
  std::error_code code;
  fs::create_directories(capture.folder, code);
  if (code && !fs::is_directory(capture.folder)) {
    return Error{ErrorCode::WriteFailed, "the bundle's folder can't be made: " + code.message(),
                 capture.folder.string(), "choose another folder"};
  }
  return writeFileAtomically(capture.folder / "capture.json", twoShotCaptureJson(capture));
}

Result<Image> readPhoto(const TwoShotCapture& capture, const TwoShotPhoto& photo) {
  return readLinear(capture.folder, photo.file, photo.encoding, photo.camera, 1.0);
}

}  // namespace patina
