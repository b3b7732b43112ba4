#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "engine/acquire/rig_description.h"
#include "engine/calibration/calibration_file.h"

namespace patina {

/// What was calibrated of a rig, piece by piece.
struct RigParts {
  StoredScreenPose pose;                         ///< camera and screen
  std::optional<StoredEmission> emission;        ///< before the white paper: none
  std::optional<StoredScreenResponse> screen;    ///< none: a gamma of 2.2 is guessed
  std::optional<StoredResponse> cameraResponse;  ///< for cameras whose format is not linear
  std::vector<std::string> remarks;              ///< sentences on what is guessed
};

/// The parts that a folder of calibrations holds: screen-pose.json, and where they are there emission.json,
/// screen-response.json and camera-response.json. Errors: those of `readCalibration`.
Result<RigParts> readRigParts(const std::filesystem::path& folder);

/// What a capture is taken with. The radiance of full scale is the white paper's, and the emission's gain is
/// brought to that unit, in which the screen's white seen head-on is 1. Errors: Invalid (no size of the
/// sample, parts that make no sense together).
Result<RigDescription> rigFromParts(const RigParts& parts, double sampleWidthMm, double sampleHeightMm,
                                    const std::string& sampleName);

}  // namespace patina
