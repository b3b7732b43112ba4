#pragma once

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "engine/base/result.h"
#include "engine/calibration/camera_calibration.h"
#include "engine/calibration/camera_response.h"
#include "engine/calibration/screen_pose.h"
#include "engine/calibration/screen_response.h"
#include "engine/calibration/white_tile.h"
#include "engine/screen/screen.h"

namespace patina {

/// What each kind of calibration file holds. Numbers that are needed to use it, and how sure they are.
struct StoredCamera {
  Camera camera;  ///< the lens; pose not stored
  IntrinsicVector sd = IntrinsicVector::Zero();
  Board board;
  int views = 0;
};
struct StoredScreenPose {
  Camera camera;  ///< lens and pose
  Screen screen;  ///< sizes and pose
  PlacedBoard onSample, onScreen;
  double mirrorHeightMm = 0;
  double screenAngleSdDeg = 0, screenPositionSdMm = 0;
};
struct StoredEmission {
  ScreenEmission emission;
  Eigen::Vector2d meanSd = Eigen::Vector2d::Zero(), sigmaSd = Eigen::Vector2d::Zero();
  double gainSd = 0;
  Eigen::Vector3d channelGain = Eigen::Vector3d::Ones();  ///< of R G B over `emission.gain`
  Eigen::Vector3d paperAlbedo = Eigen::Vector3d::Ones();
  double radianceScale = 1;
};
struct StoredWhiteTile {
  CertifiedReflectance reflectance;
  Eigen::Vector3d irradiance = Eigen::Vector3d::Zero();  ///< mean over the tile, pixel units a second
  Eigen::Vector3d relativeSd = Eigen::Vector3d::Zero();
  PixelRegion region;
  std::string mapFile;  ///< EXR beside the file: irradiance a pixel; "" without
};
struct StoredResponse {
  std::array<ResponseCurve, 3> curves;
  std::optional<DarkLevel> dark;
};
struct StoredScreenResponse {
  ScreenCurve response;
};

using StoredCalibration = std::variant<StoredCamera, StoredScreenPose, StoredEmission, StoredWhiteTile,
                                       StoredResponse, StoredScreenResponse>;

/// A calibration as it is kept: docs/calibration.md, "Files".
struct CalibrationRecord {
  StoredCalibration content;
  std::string device;  ///< which camera or screen it is of, as its backend names it; may be empty
  std::chrono::system_clock::time_point taken;  ///< to the second
  double residual = 0;                          ///< in `residualUnit`
  std::string residualUnit;                     ///< "px", "%"
  std::string madeBy;                           ///< program and version
  std::vector<std::string> remarks;
};

/// "camera", "screen-pose", "emission", "white-tile", "camera-response", "screen-response".
std::string_view kindOf(const StoredCalibration& content);

std::string calibrationJson(const CalibrationRecord& record);
Status writeCalibration(const std::filesystem::path& file, const CalibrationRecord& record);
/// Refuses with a sentence that names the key: not a calibration, another version, another kind than
/// `wanted` ("" takes any), values without sense. No text, however broken, throws (fuzzed).
Result<CalibrationRecord> parseCalibration(std::string_view text, const std::string& where,
                                           std::string_view wanted = {});
Result<CalibrationRecord> readCalibration(const std::filesystem::path& file, std::string_view wanted = {});

/// "today", "3 days ago", "taken in the future: is this machine's clock right?".
std::string ageInWords(std::chrono::system_clock::time_point taken,
                       std::chrono::system_clock::time_point now);

/// How a stored calibration agrees with a fresh photograph.
struct Recheck {
  bool good = true;
  double difference = 0;  ///< in `unit`
  std::string unit;       ///< "px", "%"
  std::string sentence;   ///< what differs, how much, and what to do
};

/// Lens: a fresh photograph of the board must fit the stored lens as well as the calibration's own did
/// (within 0.3 px or twice its RMS). Errors: NotFound (no board seen), Invalid (picture size).
Result<Recheck> recheckCamera(const CalibrationRecord& stored, const Image& photo);
/// Screen pose: corners of a fresh photograph of mirror and marker, or of the marker alone, against where the
/// stored poses put them (within 0.5 px RMS).
Result<Recheck> recheckScreenPose(const CalibrationRecord& stored, const Image& photo);
/// White tile: light over the tile in a fresh linear photograph against the stored mean, channels together
/// and apart (within 1 %).
Result<Recheck> recheckWhiteTile(const CalibrationRecord& stored, const Image& photo,
                                 const WhiteTileOptions& options);
/// Curves: two linearised photographs of one still scene, exposures known, must agree (within 2 %).
Result<Recheck> recheckResponse(const CalibrationRecord& stored, const std::vector<ExposedPhoto>& photos);

}  // namespace patina
