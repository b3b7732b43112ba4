#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/geometry/camera.h"
#include "engine/image/image.h"

namespace patina {

/// One photograph of a two-shot capture, of the sample or of the white tile.
struct TwoShotPhoto {
  std::string file;  ///< relative to the bundle's folder, never leaving it
  Camera camera;
  Eigen::Vector3d toLight = Eigen::Vector3d::UnitZ();  ///< unit, from the sample to the distant light
  double exposureS = 1;
  bool holdout = false;                             ///< a fit must not read it
  std::string encoding;                             ///< "" (linear), else as in Fourier bundles
  std::optional<Eigen::Vector3d> normalIrradiance;  ///< E on a plane that faces the light, pixel units per
                                                    ///< second; instead of a white reference
};

/// A capture bundle of kind `two-shot`: the description only, no pixels.
struct TwoShotCapture {
  std::filesystem::path folder;
  bool disc = true;
  double radiusMm = 0;               ///< disc
  double widthMm = 0, heightMm = 0;  ///< rectangle
  std::string sampleName, madeBy;
  std::vector<TwoShotPhoto> shots;
  Eigen::Vector3d whiteReflectance = Eigen::Vector3d::Ones();
  std::vector<TwoShotPhoto> whiteShots;  ///< empty where every shot has its normalIrradiance
  double saturation = 0;  ///< pixel value at which the sensor clips, before exposure is divided out; 0: not
                          ///< said. Key "saturation"
  std::vector<std::string> ignoredKeys;

  bool onSample(double xMm, double yMm) const {
    return disc ? xMm * xMm + yMm * yMm <= radiusMm * radiusMm
                : std::abs(xMm) <= widthMm / 2 && std::abs(yMm) <= heightMm / 2;
  }
};

/// The kind that a bundle says it is: "fourier", "two-shot", "flash", or what stands there. Errors: NotFound,
/// Malformed.
Result<std::string> captureKind(const std::filesystem::path& folder);

/// Reads and checks `folder`/capture.json of kind `two-shot`, as strictly as `readFourierCapture`. Opens no
/// photograph. Errors name file and key: at least one shot to fit; light directions unit and above the
/// sample; every shot has a white photograph under the same light (within 0.1 degrees) or its irradiance.
Result<TwoShotCapture> readTwoShotCapture(const std::filesystem::path& folder, const JobContext& job = {});
/// The same from a text, without looking at files (fuzzed).
Result<TwoShotCapture> parseTwoShotCapture(std::string_view text, const std::filesystem::path& folder,
                                           const std::string& where);
/// Writes capture.json into `capture.folder`, atomically.
Status writeTwoShotCapture(const TwoShotCapture& capture);
/// The text of capture.json for a description, indented, newline at the end. Numbers keep all their digits.
std::string twoShotCaptureJson(const TwoShotCapture& capture);
/// Whether two photographs were taken under the same light: directions within 0.1 degrees.
bool sameLight(const TwoShotPhoto& a, const TwoShotPhoto& b);
/// Reads one photograph, decoded to linear, R G B, not divided by its exposure. Errors: missing, wrong size,
/// truncated, non-finite (pixel named).
Result<Image> readPhoto(const TwoShotCapture& capture, const TwoShotPhoto& photo);

}  // namespace patina
