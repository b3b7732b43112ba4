#include "engine/capture/flash_capture.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/capture/bundle_path.h"
#include "engine/capture/capture_parts.h"
#include "engine/capture/encoding.h"

namespace patina {
namespace fs = std::filesystem;
using namespace capture_parts;
namespace {

using Json = nlohmann::json;

/// A camera nearer than this to the sample's plane only grazes it.
constexpr double kLowestMm = 1e-3;
constexpr double kDimmest = 1e-9;
/// Radiant intensity goes with the square of the distance: bounds of its own.
constexpr double kBrightest = 1e15;

void requireFlash(JsonObject& file) {
  const std::string kind = readHead(file);
  if (kind == "flash") return;
  const bool known = kind == "fourier" || kind == "two-shot";
  file.fail(ErrorCode::Unsupported, "kind",
            known ? "this is a " + inQuotes(kind) + " capture, and not of kind 'flash'"
                  : inQuotes(kind) + " is not a kind of capture that this program knows",
            known ? "open it as what it is, or choose a bundle of kind 'flash'" : "use the kind 'flash'");
}

Eigen::Vector3d positionInFront(JsonObject& object, const std::string& name, const char* what) {
  const Eigen::Vector3d position = vector3(object, name, -kFarthestMm, kFarthestMm);
  if (!(position.z() >= kLowestMm)) {
    object.fail(ErrorCode::Invalid, name,
                std::string("this ") + what + " is not in front of the sample: its z is not above 0",
                "check that positions are in the sample's frame, mm, with the sample facing +z");
  }
  return position;
}

bool readRectified(const Json& entry, JsonObject& photo) {
  if (!photo.has("rectified")) return false;
  const Json& value = entry["rectified"];
  if (!value.is_boolean()) {
    photo.fail(ErrorCode::Malformed, "rectified", "'rectified' is neither true nor false",
               "use true where the picture covers exactly the sample's rectangle");
  }
  return value.get<bool>();
}

FlashPhoto readOne(const Json& entry, const std::string& where, std::size_t index, FlashCapture* capture) {
  JsonObject object(entry, where, "photos[" + std::to_string(index) + "]");
  FlashPhoto photo;
  photo.file = readFileName(object, where);
  photo.rectified = readRectified(entry, object);
  if (object.has("camera")) {
    JsonObject camera = object.object("camera");
    photo.camera = readCamera(camera);
    noteUnread(camera, "photos[].camera", &capture->ignoredKeys);
  } else if (!photo.rectified) {
    object.fail(ErrorCode::Malformed, "camera",
                "the key 'camera' is missing, and the photograph is not rectified",
                "add the camera, or 'rectified': true where the picture covers exactly the sample");
  }
  if (object.has("camera_position_mm") || !photo.camera) {
    photo.cameraPositionMm = positionInFront(object, "camera_position_mm", "camera");
  } else {
    photo.cameraPositionMm = photo.camera->positionMm();
  }
  JsonObject light = object.object("light");
  requireType(light, "point");
  photo.lightPositionMm = positionInFront(light, "position_mm", "light");
  photo.lightIntensity = vector3(light, "intensity", kDimmest, kBrightest);
  noteUnread(light, "photos[].light", &capture->ignoredKeys);
  photo.holdout = readHoldout(object);
  photo.encoding = readEncoding(object, where, photo.file);
  // `rectified` was read as a truth value, beside the reader that knows numbers and texts only.
  std::vector<std::string> unread;
  noteUnread(object, "photos[]", &unread);
  for (const std::string& key : unread) {
    if (key != "photos[].rectified" && std::find(capture->ignoredKeys.begin(), capture->ignoredKeys.end(),
                                                 key) == capture->ignoredKeys.end())
      capture->ignoredKeys.push_back(key);
  }
  return photo;
}

Status checkFiles(const FlashCapture& capture, const std::string& where, const JobContext& job) {
  std::map<fs::path, std::string> files;
  std::set<std::string> encodings;
  for (std::size_t i = 0; i < capture.photos.size(); ++i) {
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "reading the bundle was cancelled", where, ""};
    const FlashPhoto& photo = capture.photos[i];
    const std::string key = "photos[" + std::to_string(i) + "]";
    Result<fs::path> file = resolveInBundle(capture.folder, photo.file, where + ": " + key + ".file");
    if (!file) return file.error();
    const auto [first, isNew] = files.emplace(*file, key);
    if (!isNew) {
      return Error{ErrorCode::Invalid,
                   "the same file, " + inQuotes(photo.file) + ", is given for two photographs",
                   where + ": " + first->second + " and " + key, "name another file for one of them"};
    }
    if (encodings.insert(photo.encoding).second) {
      if (Status status = checkEncoding(capture.folder, photo.encoding, where + ": " + key + ".encoding");
          !status)
        return status;
    }
  }
  return Done{};
}

nlohmann::ordered_json jsonOf(const FlashPhoto& photo) {
  nlohmann::ordered_json object = {{"file", photo.file}};
  if (!photo.encoding.empty()) object["encoding"] = photo.encoding;
  object["rectified"] = photo.rectified;
  if (photo.camera) object["camera"] = capture_parts::jsonOf(*photo.camera);
  object["camera_position_mm"] = capture_parts::jsonOf(photo.cameraPositionMm);
  object["light"] = {{"type", "point"},
                     {"position_mm", capture_parts::jsonOf(photo.lightPositionMm)},
                     {"intensity", capture_parts::jsonOf(photo.lightIntensity)}};
  if (photo.holdout) object["split"] = "holdout";
  return object;
}

/// What each code of an 8-bit file stands for.
Result<std::array<std::vector<float>, 3>> tableOfCodes(const fs::path& folder, const PhotoEncoding& encoding,
                                                       const std::string& where) {
  std::array<std::vector<float>, 3> table;
  std::optional<std::array<ResponseCurve, 3>> curves;
  if (encoding.kind == PhotoEncoding::Kind::Response) {
    Result<fs::path> file = resolveInBundle(folder, encoding.responseFile, where);
    if (!file) return file.error();
    auto read = readResponse(*file);
    if (!read) return read.error();
    curves = std::move(*read);
  }
  for (std::size_t c = 0; c < 3; ++c) {
    table[c].resize(256);
    for (int code = 0; code < 256; ++code) {
      const double value = code / 255.0;
      table[c][code] =
          static_cast<float>(curves ? linearFromResponse((*curves)[c], value)
                             : encoding.kind == PhotoEncoding::Kind::Srgb ? linearFromSrgbPixel(value)
                                                                          : std::pow(value, encoding.gamma));
    }
  }
  return table;
}

}  // namespace

Result<FlashCapture> parseFlashCapture(std::string_view text, const fs::path& folder,
                                       const std::string& where) {
  try {
    const Json json = parseJson(text, where);
    JsonObject file(json, where, "");
    requireFlash(file);
    FlashCapture capture;
    capture.folder = folder;
    JsonObject sample = file.object("sample");
    capture.widthMm = sample.number("width_mm", kSmallestMm, kLargestMm);
    capture.heightMm = sample.number("height_mm", kSmallestMm, kLargestMm);
    capture.sampleName = readSampleName(sample);
    noteUnread(sample, "sample", &capture.ignoredKeys);
    const Json& photos = file.list("photos", 1, kMostPhotos);
    for (std::size_t i = 0; i < photos.size(); ++i) {
      capture.photos.push_back(readOne(photos[i], where, i, &capture));
    }
    if (std::all_of(capture.photos.begin(), capture.photos.end(),
                    [](const FlashPhoto& photo) { return photo.holdout; })) {
      file.fail(ErrorCode::Invalid, "photos", "every photograph is held out, and none is left to fit",
                "take 'split': 'holdout' away from one at least");
    }
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

std::string flashCaptureJson(const FlashCapture& capture) {
  nlohmann::ordered_json json;
  json["format"] = "patina-capture";
  json["version"] = kVersion;
  json["kind"] = "flash";
  if (!capture.madeBy.empty()) json["made_by"] = capture.madeBy;
  json["sample"] = {{"width_mm", capture.widthMm}, {"height_mm", capture.heightMm}};
  if (!capture.sampleName.empty()) json["sample"]["name"] = capture.sampleName;
  if (capture.saturation > 0) json["saturation"] = capture.saturation;
  json["photos"] = nlohmann::ordered_json::array();
  for (const FlashPhoto& photo : capture.photos) json["photos"].push_back(jsonOf(photo));
  return json.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

Result<FlashCapture> readFlashCapture(const fs::path& folder, const JobContext& job) {
  Result<fs::path> description = findDescription(folder);
  if (!description) return description.error();
  Result<std::string> text = readFile(*description, kLargestDescription);
  if (!text) return text.error();
  const fs::path home = description->has_parent_path() ? description->parent_path() : fs::path(".");
  Result<FlashCapture> capture = parseFlashCapture(*text, home, description->string());
  if (!capture) return capture;
  Status files = checkFiles(*capture, description->string(), job);
  if (!files) return files.error();
  for (const std::string& key : capture->ignoredKeys) {
    job.info("The key " + inQuotes(key) + " in " + description->string() +
             " is not known to this version and was ignored.");
  }
  return capture;
}

Status writeFlashCapture(const FlashCapture& capture) {
  std::error_code code;
  fs::create_directories(capture.folder, code);
  if (code && !fs::is_directory(capture.folder)) {
    return Error{ErrorCode::WriteFailed, "the bundle's folder can't be made: " + code.message(),
                 capture.folder.string(), "choose another folder"};
  }
  return writeFileAtomically(capture.folder / "capture.json", flashCaptureJson(capture));
}

Result<FlashPixels> readFlashPixels(const FlashCapture& capture, const FlashPhoto& photo,
                                    std::optional<ImageSize> expected) {
  const std::string where = (capture.folder / photo.file).string();
  Result<PhotoEncoding> encoding = parseEncoding(photo.encoding, where);
  if (!encoding) return encoding.error();
  if (photo.camera && !photo.rectified) expected = ImageSize{photo.camera->width, photo.camera->height};
  FlashPixels pixels;
  auto linear = readLinear(capture.folder, photo.file, photo.encoding, expected, 1.0);
  if (!linear) return linear.error();
  pixels.linear = std::move(*linear);
  if (encoding->kind == PhotoEncoding::Kind::Linear) return pixels;
  auto table = tableOfCodes(capture.folder, *encoding, where);
  if (!table) return table.error();
  // The reader has no word for a file's depth: 8 bits where every value is one of the 256.
  // A hundred thousand of them are proof enough.
  bool eight = true;
  const std::size_t every = std::max<std::size_t>(1, pixels.linear.samples().size() / 100000) * 3 + 1;
  for (std::size_t i = 0; i < pixels.linear.samples().size() && eight; i += every) {
    const std::vector<float>& values = (*table)[i % 3];
    const float value = pixels.linear.samples()[i];
    const auto above = std::lower_bound(values.begin(), values.end(), value);
    const float tolerance = 1e-6f + 1e-5f * value;
    const bool near = (above != values.end() && *above - value <= tolerance) ||
                      (above != values.begin() && value - *(above - 1) <= tolerance);
    eight = near;
  }
  for (std::size_t c = 0; c < 3; ++c) pixels.largest[c] = (*table)[c].back();
  if (eight) pixels.valueOfCode = std::move(*table);
  return pixels;
}

}  // namespace patina
