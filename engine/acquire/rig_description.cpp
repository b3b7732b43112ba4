#include "engine/acquire/rig_description.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/capture/capture_json.h"

namespace patina {
namespace {

constexpr std::uint64_t kMostBytes = 16u << 20;

/// A capture's description with the photographs that its reader insists on.
FourierCapture captureOf(const RigDescription& rig) {
  FourierCapture capture;
  capture.sampleWidthMm = rig.sampleWidthMm;
  capture.sampleHeightMm = rig.sampleHeightMm;
  capture.sampleName = rig.sampleName;
  capture.camera = rig.camera;
  capture.screen = rig.screen;
  for (const PhotoRole role : {PhotoRole::Window, PhotoRole::Black}) {
    FourierPhoto photo;
    photo.role = role;
    photo.file = role == PhotoRole::Window ? "window.exr" : "black.exr";
    capture.photos.push_back(photo);
  }
  return capture;
}

}  // namespace

std::vector<std::string> RigDescription::problems() const {
  std::vector<std::string> problems;
  const auto need = [&](bool good, const char* sentence) {
    if (!good) problems.emplace_back(sentence);
  };
  need(camera.width > 0 && camera.height > 0, "the camera's size in pixels is not known");
  need(screen.widthPx > 0 && screen.heightPx > 0 && screen.widthMm > 0 && screen.heightMm > 0,
       "the screen's size is not known");
  need(sampleWidthMm > 0 && sampleHeightMm > 0, "the sample's size is not known");
  if (problems.empty()) {
    const Result<FourierCapture> checked =
        parseFourierCapture(fourierCaptureJson(captureOf(*this)), ".", "rig");
    if (!checked) problems.push_back(checked.error().sentence());
  }
  return problems;
}

Result<RigDescription> readRigDescription(const std::filesystem::path& file) {
  const Result<std::string> text = readFile(file, kMostBytes);
  if (!text) return text.error();
  nlohmann::json json = nlohmann::json::parse(*text, nullptr, false);
  if (!json.is_object())
    return Error{ErrorCode::Malformed, "this is not a description of a rig", file.string(),
                 "name a file that calibration wrote, or the capture.json of an earlier capture"};
  RigDescription rig;
  // The reader of captures checks camera, screen and sample; photographs are none of a rig's business.
  nlohmann::json whole = json;
  whole["format"] = "patina-capture";
  whole["version"] = 1;
  whole["kind"] = "fourier";
  whole["photos"] = nlohmann::json::array({{{"file", "window.exr"}, {"role", "window"}, {"exposure_s", 1}},
                                           {{"file", "black.exr"}, {"role", "black"}, {"exposure_s", 1}}});
  const Result<FourierCapture> capture = parseFourierCapture(whole.dump(), ".", file.string());
  if (!capture) return capture.error();
  rig.camera = capture->camera;
  rig.screen = capture->screen;
  rig.sampleWidthMm = capture->sampleWidthMm;
  rig.sampleHeightMm = capture->sampleHeightMm;
  rig.sampleName = capture->sampleName;
  const auto bad = [&](const char* key, const char* what) {
    return Error{ErrorCode::Invalid, what, file.string() + ": " + key,
                 "measure it again, or correct the file"};
  };
  if (const auto found = json.find("radiance_of_full_scale_second"); found != json.end()) {
    if (!found->is_number() || !(found->get<double>() > 0))
      return bad("radiance_of_full_scale_second", "this must be a positive number");
    rig.radianceOfFullScaleSecond = *found;
  }
  if (const auto found = json.find("screen_response"); found != json.end()) {
    if (found->is_object() && found->contains("gamma") && (*found)["gamma"].is_number()) {
      const double gamma = (*found)["gamma"];
      if (!(gamma >= 0.2 && gamma <= 5))
        return bad("screen_response.gamma", "a screen's gamma lies in 0.2 to 5");
      rig.screenResponse = ScreenResponse::gamma(gamma);
    } else {
      if (!found->is_array() || found->size() != 256)
        return bad("screen_response", "this must be 256 numbers, or an object with gamma");
      for (std::size_t v = 0; v < 256; ++v) {
        if (!(*found)[v].is_number()) return bad("screen_response", "this must be 256 numbers");
        rig.screenResponse.level[v] = (*found)[v];
      }
      if (!std::ranges::is_sorted(rig.screenResponse.level) || rig.screenResponse.level[0] < 0 ||
          rig.screenResponse.level[255] != 1)
        return bad("screen_response", "these numbers must never fall, and end with 1");
    }
  }
  return rig;
}

Status writeRigDescription(const std::filesystem::path& file, const RigDescription& rig) {
  nlohmann::ordered_json json = nlohmann::ordered_json::parse(fourierCaptureJson(captureOf(rig)));
  json.erase("photos");
  json.erase("kind");
  json["format"] = "patina-rig";
  if (rig.radianceOfFullScaleSecond > 0)
    json["radiance_of_full_scale_second"] = rig.radianceOfFullScaleSecond;
  json["screen_response"] = rig.screenResponse.level;
  return writeFileAtomically(file, json.dump(1) + "\n");
}

}  // namespace patina
