#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/geometry/camera.h"
#include "engine/image/image.h"
#include "engine/image/image_size.h"

namespace patina {

/// One photograph of a flash capture.
struct FlashPhoto {
  std::string file;              ///< relative to the bundle's folder, never leaving it
  std::string encoding;          ///< "" (linear), else as in Fourier bundles
  bool rectified = true;         ///< the picture covers exactly the sample rectangle, row 0 at +y
  std::optional<Camera> camera;  ///< where it is not rectified
  Eigen::Vector3d cameraPositionMm = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d lightPositionMm = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d lightIntensity = Eigen::Vector3d::Ones();  ///< R G B, pixel units times mm^2
  bool holdout = false;                                      ///< a fit must not read it
};

/// A capture bundle of kind `flash`: the description only, no pixels. Pixel = f_r cos(theta_i) intensity /
/// distance^2.
struct FlashCapture {
  std::filesystem::path folder;
  double widthMm = 0, heightMm = 0;
  std::string sampleName, madeBy;
  std::vector<FlashPhoto> photos;
  double saturation = 0;  ///< decoded pixel value at which the camera clips; 0: not said (a PNG's largest
                          ///< code, or what the photographs show). Key "saturation"
  std::vector<std::string> ignoredKeys;
};

/// Reads and checks `folder`/capture.json of kind `flash`, as strictly as `readFourierCapture`. Opens no
/// photograph. Errors name file and key: one photograph at least to fit; cameras and lights in front of the
/// sample; a photograph that is not rectified has its camera.
Result<FlashCapture> readFlashCapture(const std::filesystem::path& folder, const JobContext& job = {});
/// The same from a text, without looking at files (fuzzed).
Result<FlashCapture> parseFlashCapture(std::string_view text, const std::filesystem::path& folder,
                                       const std::string& where);
/// Writes capture.json into `capture.folder`, atomically.
Status writeFlashCapture(const FlashCapture& capture);
/// The text of capture.json for a description, indented, newline at the end. Numbers keep all their digits.
std::string flashCaptureJson(const FlashCapture& capture);

/// A photograph with what its file says about precision.
struct FlashPixels {
  Image linear;  ///< R G B, decoded as the bundle says
  /// Decoded value of each code of an 8-bit file, R G B, never falling; empty for finer files.
  std::array<std::vector<float>, 3> valueOfCode;
  /// Decoded value of the file's largest code, R G B: the camera clips there or before; 0 where the format
  /// has none.
  std::array<float, 3> largest{0, 0, 0};
};

/// Reads one photograph. `expected`: its size, where known. Errors: missing, wrong size, truncated,
/// non-finite (pixel named).
Result<FlashPixels> readFlashPixels(const FlashCapture& capture, const FlashPhoto& photo,
                                    std::optional<ImageSize> expected = {});

}  // namespace patina
