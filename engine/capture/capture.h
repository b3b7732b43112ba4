#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/geometry/camera.h"
#include "engine/image/image.h"
#include "engine/screen/screen.h"

namespace patina {

enum class PhotoRole { Pattern, Window, Black, Geometry };

/// One photograph of a Fourier capture, as capture.json describes it.
struct FourierPhoto {
  std::string file;  ///< relative to the bundle's folder, never leaving it
  PhotoRole role = PhotoRole::Pattern;
  double exposureS = 0;                                 ///< informational: pixels are scene-referred already
  Eigen::Vector2i frequency = Eigen::Vector2i::Zero();  ///< integers, pattern coordinates; role Pattern only
  int phase = 0;         ///< k in 0..3: g = w max(0, sin(w.x + k pi/2)); role Pattern only
  bool holdout = false;  ///< a fit must not read it
  std::string encoding;  ///< "" (linear), "srgb", "gamma:2.2", "response:FILE.json"
};

/// What is known of the sample beforehand, e.g. a white paper.
struct KnownLambertian {
  Eigen::Vector3d albedo = Eigen::Vector3d::Ones();
};

/// A capture bundle of kind `fourier`: the description only, no pixels. See docs and the capture format,
/// version 1.
struct FourierCapture {
  std::filesystem::path folder;
  double sampleWidthMm = 0, sampleHeightMm = 0;
  std::string sampleName;
  std::string madeBy;  ///< the program that took it, "" where the bundle doesn't say; key "made_by"
  std::optional<KnownLambertian> known;
  Camera camera;
  Screen screen;
  double radianceScale = 1.0;  ///< radiance = pixel * radianceScale
  double saturation = 0;       ///< pixel value at which the sensor of linear photographs clips; 0: not said.
                               ///< Encoded photographs clip at their highest code. Key "saturation"
  std::vector<FourierPhoto> photos;
  std::vector<std::string> ignoredKeys;  ///< keys that this version does not know, as "camera.foo"
};

/// Reads `folder`/capture.json (a path to the file itself works too) and checks it: required keys and their
/// types, version, kind, orthonormal rotations, sizes within reason, paths that stay inside the folder, every
/// photograph present. Opens no photograph. Errors name file and key; kinds `two-shot` and `flash` give
/// Unsupported.
Result<FourierCapture> readFourierCapture(const std::filesystem::path& folder, const JobContext& job = {});

/// Writes capture.json into `capture.folder` (created if missing), atomically. Photographs are the caller's.
Status writeFourierCapture(const FourierCapture& capture);

/// Reads one photograph, decodes it to linear radiance (encoding undone, radianceScale applied), R G B.
/// Errors: missing, wrong size, truncated, non-finite (pixel named).
Result<Image> readPhoto(const FourierCapture& capture, const FourierPhoto& photo);

}  // namespace patina
