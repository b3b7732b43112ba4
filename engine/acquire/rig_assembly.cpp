#include "engine/acquire/rig_assembly.h"

#include <cmath>

namespace patina {
namespace {

constexpr double kUsualGamma = 2.2;

/// A calibration of one kind, or none where the file isn't there.
template <typename Content>
Result<std::optional<Content>> readPart(const std::filesystem::path& folder, const char* kind) {
  const std::filesystem::path file = folder / (std::string(kind) + ".json");
  std::error_code ignored;
  if (!std::filesystem::exists(file, ignored)) return std::optional<Content>();
  const Result<CalibrationRecord> record = readCalibration(file, kind);
  if (!record) return record.error();
  return std::optional<Content>(std::get<Content>(record->content));
}

}  // namespace

Result<RigParts> readRigParts(const std::filesystem::path& folder) {
  const Result<CalibrationRecord> pose = readCalibration(folder / "screen-pose.json", "screen-pose");
  if (!pose) return pose.error();
  RigParts parts;
  parts.pose = std::get<StoredScreenPose>(pose->content);
  const auto emission = readPart<StoredEmission>(folder, "emission");
  if (!emission) return emission.error();
  parts.emission = *emission;
  const auto screen = readPart<StoredScreenResponse>(folder, "screen-response");
  if (!screen) return screen.error();
  parts.screen = *screen;
  const auto camera = readPart<StoredResponse>(folder, "camera-response");
  if (!camera) return camera.error();
  parts.cameraResponse = *camera;
  if (!parts.screen)
    parts.remarks.emplace_back("The screen's response was not measured: a gamma of 2.2 is taken for it.");
  if (!parts.emission)
    parts.remarks.emplace_back(
        "No white paper was photographed: albedos are relative to the screen's white.");
  return parts;
}

Result<RigDescription> rigFromParts(const RigParts& parts, double sampleWidthMm, double sampleHeightMm,
                                    const std::string& sampleName) {
  RigDescription rig;
  rig.camera = parts.pose.camera;
  rig.screen = parts.pose.screen;
  rig.screen.windowSigma = {1.0, 1.0 / rig.screen.aspect()};
  rig.sampleWidthMm = sampleWidthMm;
  rig.sampleHeightMm = sampleHeightMm;
  rig.sampleName = sampleName;
  if (parts.emission) {
    ScreenEmission emission = parts.emission->emission;
    // The unit in which head-on white is 1: what the mean off the middle takes is the gain's to give.
    emission.gain = std::exp(0.5 * (emission.mean.array() / emission.sigma.array()).square().sum());
    rig.screen.emission = emission;
    rig.radianceOfFullScaleSecond = parts.emission->radianceScale;
  }
  rig.screenResponse = ScreenResponse::gamma(kUsualGamma);
  if (parts.screen)
    for (std::size_t v = 0; v < 256; ++v)
      rig.screenResponse.level[v] = parts.screen->response.lightOf(static_cast<double>(v) / 255);
  if (parts.cameraResponse)
    rig.conversion.response.assign(parts.cameraResponse->curves.begin(), parts.cameraResponse->curves.end());
  if (const std::vector<std::string> problems = rig.problems(); !problems.empty()) {
    std::string all;
    for (const std::string& problem : problems) all += (all.empty() ? "" : "; ") + problem;
    return Error{ErrorCode::Invalid, "these calibrations make no rig: " + all, "",
                 "measure again what is named, or correct the sample's size"};
  }
  return rig;
}

}  // namespace patina
