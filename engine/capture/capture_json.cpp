#include "engine/capture/capture_json.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <tuple>

#include "engine/base/text.h"
#include "engine/capture/capture_parts.h"
#include "engine/capture/json_reader.h"
#include "engine/image/image_size.h"

namespace patina {
namespace {

using Json = nlohmann::json;
using namespace capture_parts;

constexpr double kNearestScreenMm = 1;                        // nothing touches the panel
constexpr double kSmallestSigma = 1e-3, kLargestSigma = 1e3;  // pattern units; the screen is 2 pi wide
constexpr int kHighestFrequency = 10000;  // cycles across the screen: finer than any screen's pixels

void readSample(JsonObject& file, FourierCapture* capture) {
  JsonObject sample = file.object("sample");
  capture->sampleWidthMm = sample.number("width_mm", kSmallestMm, kLargestMm);
  capture->sampleHeightMm = sample.number("height_mm", kSmallestMm, kLargestMm);
  capture->sampleName = readSampleName(sample);
  if (sample.has("known")) {
    JsonObject known = sample.object("known");
    requireType(known, "lambertian");
    capture->known = KnownLambertian{vector3(known, "albedo", 0.0, 1.0)};
    noteUnread(known, "sample.known", &capture->ignoredKeys);
  }
  noteUnread(sample, "sample", &capture->ignoredKeys);
}

/// The screen must light the sample's front: every corner of the sample on the side that the screen emits to,
/// and some of the screen over the sample's plane. Anything else fits black maps.
void checkScreenPose(const JsonObject& object, const FourierCapture& capture) {
  const Screen& screen = capture.screen;
  const Eigen::Vector3d normal = screen.worldFromScreen.col(2);
  double lowestMm = kFarthestMm, highestMm = -kFarthestMm;
  for (const double x : {-0.5, 0.5}) {
    for (const double y : {-0.5, 0.5}) {
      const Eigen::Vector3d onSample(x * capture.sampleWidthMm, y * capture.sampleHeightMm, 0);
      lowestMm = std::min(lowestMm, normal.dot(onSample - screen.originMm));
      const Eigen::Vector3d onScreen(x * screen.widthMm, y * screen.heightMm, 0);
      highestMm = std::max(highestMm, (screen.originMm + screen.worldFromScreen * onScreen).z());
    }
  }
  if (!(lowestMm >= kNearestScreenMm)) {
    object.fail(
        ErrorCode::Invalid, "R",
        "with these screen.R and screen.t the screen faces away from the sample, or from a corner of it",
        "check that screen.R and screen.t are world-from-screen, and that the third column of R points "
        "from the lit side to the sample");
  }
  if (!(highestMm >= kNearestScreenMm)) {
    object.fail(ErrorCode::Invalid, "t",
                "with these screen.R and screen.t the whole screen is behind the sample, at z <= 0",
                "check that screen.R and screen.t are world-from-screen, with the sample at z = 0 facing +z");
  }
}

void readScreen(JsonObject& file, FourierCapture* capture) {
  JsonObject object = file.object("screen");
  Screen& screen = capture->screen;
  screen.widthMm = object.number("width_mm", kSmallestMm, kLargestMm);
  screen.heightMm = object.number("height_mm", kSmallestMm, kLargestMm);
  screen.widthPx = object.integer("width_px", 1, kMaxImageSide);
  screen.heightPx = object.integer("height_px", 1, kMaxImageSide);
  screen.worldFromScreen = object.rotation("R");
  screen.originMm = vector3(object, "t", -kFarthestMm, kFarthestMm);
  checkScreenPose(object, *capture);

  JsonObject window = object.object("window");
  requireType(window, "gaussian");
  screen.windowSigma = vector2(window, "sigma", kSmallestSigma, kLargestSigma);
  noteUnread(window, "screen.window", &capture->ignoredKeys);

  if (object.has("emission")) {
    JsonObject emission = object.object("emission");
    requireType(emission, "gaussian");
    ScreenEmission found;
    found.mean = vector2(emission, "mean", -kLargestSigma, kLargestSigma);
    found.sigma = vector2(emission, "sigma", kSmallestSigma, kLargestSigma);
    found.gain = emission.number("gain", 1.0 / kLargestScale, kLargestScale);
    screen.emission = found;
    noteUnread(emission, "screen.emission", &capture->ignoredKeys);
  }
  noteUnread(object, "screen", &capture->ignoredKeys);
}

PhotoRole readRole(JsonObject& object) {
  const std::string role = object.text("role");
  if (role == "pattern") return PhotoRole::Pattern;
  if (role == "window") return PhotoRole::Window;
  if (role == "black") return PhotoRole::Black;
  if (role == "geometry") return PhotoRole::Geometry;
  const std::string nearest = nearestWord(role, {"pattern", "window", "black", "geometry"});
  object.fail(ErrorCode::Malformed, "role", inQuotes(role) + " is not a role of a photograph",
              nearest.empty() ? "use pattern, window, black or geometry" : "use " + inQuotes(nearest));
}

FourierPhoto readOnePhoto(JsonObject& object, const std::string& where) {
  FourierPhoto photo;
  photo.file = readFileName(object, where);
  photo.role = readRole(object);
  photo.exposureS = object.number("exposure_s", 0.0, kLongestExposureS);
  if (photo.role == PhotoRole::Pattern) {
    const std::vector<double> frequency =
        object.numbers("frequency", 2, -kHighestFrequency, kHighestFrequency);
    for (std::size_t i = 0; i < 2; ++i) {
      if (frequency[i] != std::floor(frequency[i])) {
        object.fail(ErrorCode::Invalid, "frequency[" + std::to_string(i) + "]",
                    "frequencies are whole numbers, and this one is not",
                    "count the waves across the screen's width");
      }
    }
    photo.frequency = {static_cast<int>(frequency[0]), static_cast<int>(frequency[1])};
    photo.phase = object.integer("phase", 0, 3);
  }
  photo.holdout = readHoldout(object);
  photo.encoding = readEncoding(object, where, photo.file);
  return photo;
}

std::string patternName(const FourierPhoto& photo) {
  return "frequency [" + std::to_string(photo.frequency.x()) + ", " + std::to_string(photo.frequency.y()) +
         "], phase " + std::to_string(photo.phase);
}

void readPhotos(JsonObject& file, const std::string& where, FourierCapture* capture) {
  const Json& list = file.list("photos", 1, kMostPhotos);
  std::map<std::tuple<int, int, int>, std::size_t> seen;
  bool window = false, black = false;
  for (std::size_t i = 0; i < list.size(); ++i) {
    JsonObject object(list[i], where, "photos[" + std::to_string(i) + "]");
    FourierPhoto photo = readOnePhoto(object, where);
    if (photo.role == PhotoRole::Pattern) {
      const auto key = std::make_tuple(photo.frequency.x(), photo.frequency.y(), photo.phase);
      const auto [other, isNew] = seen.emplace(key, i);
      if (!isNew) {
        object.fail(ErrorCode::Invalid, "phase",
                    patternName(photo) + " is already shown by photos[" + std::to_string(other->second) + "]",
                    "remove one of the two, or correct its frequency and phase");
      }
    }
    window |= photo.role == PhotoRole::Window && !photo.holdout;
    black |= photo.role == PhotoRole::Black && !photo.holdout;
    // Keys of patterns on other photos are harmless, and known.
    for (const std::string& key : object.unread()) {
      const bool known = key == "frequency" || key == "phase";
      const std::string name = "photos[]." + key;
      auto& ignored = capture->ignoredKeys;
      if (!known && std::find(ignored.begin(), ignored.end(), name) == ignored.end()) ignored.push_back(name);
    }
    capture->photos.push_back(std::move(photo));
  }
  if (!window) {
    file.fail(
        ErrorCode::Invalid, "photos",
        "no photograph has the role 'window' (the window alone, held-out ones aside)",
        "photograph the window at frequency zero; without it nothing is known about the sum of all light");
  }
  if (!black) {
    file.fail(ErrorCode::Invalid, "photos",
              "no photograph has the role 'black' (the screen black, held-out ones aside)",
              "photograph the sample with the screen black; without it stray light can't be taken off");
  }
}

/// format, version, kind: what decides whether the rest can be understood at all.
void requireFourier(JsonObject& file) {
  const std::string kind = readHead(file);
  if (kind == "two-shot") {
    file.fail(ErrorCode::Unsupported, "kind", "this is a 'two-shot' capture, and not of kind 'fourier'",
              "open it as a two-shot capture: the window and patina-cli fit tell the kinds apart by "
              "themselves");
  }
  if (kind == "flash") {
    file.fail(ErrorCode::Unsupported, "kind", "this is a 'flash' capture, and not of kind 'fourier'",
              "open it as a flash capture: the window and patina-cli fit tell the kinds apart by "
              "themselves");
  }
  if (kind != "fourier") {
    file.fail(ErrorCode::Unsupported, "kind",
              inQuotes(kind) + " is not a kind of capture that this program knows",
              "open a bundle of kind 'fourier', 'two-shot' or 'flash'");
  }
}

std::string roleName(PhotoRole role) {
  switch (role) {
    case PhotoRole::Pattern:
      return "pattern";
    case PhotoRole::Window:
      return "window";
    case PhotoRole::Black:
      return "black";
    case PhotoRole::Geometry:
      return "geometry";
  }
  return {};
}

}  // namespace

Result<FourierCapture> parseFourierCapture(std::string_view text, const std::filesystem::path& folder,
                                           const std::string& where) {
  try {
    const Json json = parseJson(text, where);
    JsonObject file(json, where, "");
    requireFourier(file);
    FourierCapture capture;
    capture.folder = folder;
    readSample(file, &capture);
    JsonObject camera = file.object("camera");
    capture.camera = readCamera(camera);
    noteUnread(camera, "camera", &capture.ignoredKeys);
    readScreen(file, &capture);
    capture.radianceScale = file.number("radiance_scale", 1.0 / kLargestScale, kLargestScale, 1.0);
    if (file.has("saturation")) {
      capture.saturation = file.number("saturation", 1 / kLargestScale, kLargestScale);
    }
    readPhotos(file, where, &capture);
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

std::string fourierCaptureJson(const FourierCapture& capture) {
  nlohmann::ordered_json json;
  json["format"] = "patina-capture";
  json["version"] = kVersion;
  json["kind"] = "fourier";
  if (!capture.madeBy.empty()) json["made_by"] = capture.madeBy;
  json["sample"] = {{"width_mm", capture.sampleWidthMm}, {"height_mm", capture.sampleHeightMm}};
  if (!capture.sampleName.empty()) json["sample"]["name"] = capture.sampleName;
  if (capture.known) {
    json["sample"]["known"] = {{"type", "lambertian"}, {"albedo", jsonOf(capture.known->albedo)}};
  }
  if (capture.radianceScale != 1.0) json["radiance_scale"] = capture.radianceScale;
  if (capture.saturation > 0) json["saturation"] = capture.saturation;
  json["camera"] = jsonOf(capture.camera);
  const Screen& screen = capture.screen;
  json["screen"] = {{"width_mm", screen.widthMm},
                    {"height_mm", screen.heightMm},
                    {"width_px", screen.widthPx},
                    {"height_px", screen.heightPx},
                    {"R", jsonOf(screen.worldFromScreen)},
                    {"t", jsonOf(screen.originMm)},
                    {"window", {{"type", "gaussian"}, {"sigma", jsonOf(screen.windowSigma)}}}};
  if (screen.emission) {
    json["screen"]["emission"] = {{"type", "gaussian"},
                                  {"mean", jsonOf(screen.emission->mean)},
                                  {"sigma", jsonOf(screen.emission->sigma)},
                                  {"gain", screen.emission->gain}};
  }
  json["photos"] = nlohmann::ordered_json::array();
  for (const FourierPhoto& photo : capture.photos) {
    nlohmann::ordered_json object = {
        {"file", photo.file}, {"role", roleName(photo.role)}, {"exposure_s", photo.exposureS}};
    if (photo.role == PhotoRole::Pattern) {
      object["frequency"] = {photo.frequency.x(), photo.frequency.y()};
      object["phase"] = photo.phase;
    }
    if (photo.holdout) object["split"] = "holdout";
    if (!photo.encoding.empty()) object["encoding"] = photo.encoding;
    json["photos"].push_back(std::move(object));
  }
  return json.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace patina
