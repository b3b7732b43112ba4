#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "devices/simulated/screen_integrator.h"
#include "devices/simulated/simulated_effects.h"
#include "devices/simulated/simulated_sensor.h"
#include "devices/simulated/simulated_sheet.h"
#include "engine/acquire/capture_plan.h"
#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/capture/capture.h"
#include "engine/geometry/camera.h"
#include "engine/screen/screen.h"

namespace patina {

/// A camera and a screen over a desk, with what the capture format says of them. All of it is declared in the
/// bundle; what is hidden from a fit is in SimulatedCaptureOptions::effects.
struct SimulatedRig {
  Camera camera;
  Screen screen;
  SensorNoise noise;
  double fullScale = 0;  ///< radiance at which the sensor clips; 0: a tenth above the brightest pixel of the
                         ///< window photograph
  double blackLevel =
      0.002;  ///< radiance read with the screen black, everywhere: the room's light and the sensor's pedestal
  double exposureS = 3.0;

  /// A 15.6 inch laptop screen tilted over the sheet and a camera opposite, both about 45 degrees up. The
  /// picture of a sheet of the given size fills `pixels` x `pixels` but for a small margin; the lens has
  /// slight barrel distortion.
  static SimulatedRig desk(int pixels, double sheetWidthMm, double sheetHeightMm);
  /// The same with other places (mm, world): the camera looks at the sheet's centre, the screen faces it and
  /// is turned in its plane by `screenTurnDeg`.
  static SimulatedRig placed(int pixels, double sheetWidthMm, double sheetHeightMm,
                             const Eigen::Vector3d& cameraMm, const Eigen::Vector3d& screenMm,
                             double screenTurnDeg);
  /// Every problem with the values; empty when usable.
  std::vector<std::string> validate() const;
};

struct SimulatedCaptureOptions {
  IntegrationQuality quality;
  int samplesPerPixelSide =
      2;  ///< samples a pixel, squared: 1 looks through pixel centres only, more mixes what a pixel covers
  SimulatedEffects effects;  ///< what the rig and the sheet do and the bundle doesn't say
  bool withNoise = true;     ///< false also turns clipping off
  bool writeTruth = false;   ///< also truth/, for tests; a fit never reads it
  int truthSize = 0;         ///< longest side of the truth maps; 0: the camera's longer side
  std::vector<Eigen::Vector2i> fitted = paperFrequencies();
  std::vector<Eigen::Vector2i> heldOut = heldOutFrequencies();
};

struct SimulatedCaptureReport {
  std::map<std::string, double> seconds;  ///< by stage: "prepare", "integrate", "write"
  double fullScale = 0;                   ///< of the sensor, radiance
  std::size_t photos = 0;
  std::size_t clippedSamples = 0;
  int finestLevel = 0;
};

/// Noise-free radiance of the photographs of a capture (window, black, patterns in their order), before the
/// sensor.
class SimulatedExposure {
 public:
  SimulatedExposure(int width, int height, int photos);
  ~SimulatedExposure();
  SimulatedExposure(SimulatedExposure&&) noexcept;
  SimulatedExposure& operator=(SimulatedExposure&&) noexcept;
  SimulatedExposure(const SimulatedExposure&) = delete;
  SimulatedExposure& operator=(const SimulatedExposure&) = delete;

  bool valid() const { return data_ != nullptr; }
  int width() const { return width_; }
  int height() const { return height_; }
  int photos() const { return photos_; }
  /// R G B of one pixel of one photograph.
  float* pixel(int photo, int x, int y);
  const float* pixel(int photo, int x, int y) const;
  /// A copy of one photograph.
  Image photo(int index) const;

 private:
  std::size_t bytes() const;
  int width_ = 0, height_ = 0, photos_ = 0;
  float* data_ = nullptr;
};

/// Noise-free radiance of the photographs that the rig would take of the sheet with a perfect sensor. Source:
/// frequency-domain paper, equation 1, with the true microfacet BRDF instead of the paper's Gaussian
/// approximation of it; see ScreenIntegrator. Effects up to subsurface scattering act here, those of time,
/// lens and sensor later. Beyond the sheet's edge its surface goes on. Errors: Invalid (rig, sheet or options
/// make no sense; a lobe too narrow for the finest grid), Cancelled. All cores or job.threads.
Result<SimulatedExposure> exposeSheet(const SimulatedRig& rig, const SimulatedSheet& sheet,
                                      const SimulatedCaptureOptions& options, const JobContext& job,
                                      SimulatedCaptureReport* report = nullptr);

/// Takes a whole capture bundle of kind `fourier` of the sheet: `exposeSheet`, then the sensor's noise
/// (job.seed) and clipping, half-float EXR files and capture.json. Made in a folder beside `folder` and
/// renamed at the end: failed or cancelled, nothing is left and an earlier capture stays. An existing folder
/// is replaced only where it is empty or holds a capture that a simulated rig made ("made_by" in
/// capture.json) and nothing else. Errors: as `exposeSheet`, Refused (the folder holds something else),
/// WriteFailed.
Result<SimulatedCaptureReport> simulateCapture(const std::filesystem::path& folder, const SimulatedRig& rig,
                                               const SimulatedSheet& sheet,
                                               const SimulatedCaptureOptions& options, const JobContext& job);

/// The sheet's own values as R G B (or one-channel) rasters over the sample rectangle, row 0 at +y, as fitted
/// maps are laid out.
struct SheetTruth {
  Image diffuse, specular, normal, sigma, kurtosis;
  Image material;  ///< index of the material; texels near a border between two have -1
};
/// `borderTexels`: how far from a border between materials a texel counts as near it.
SheetTruth sheetTruth(const SimulatedSheet& sheet, int width, int height, int borderTexels);

}  // namespace patina
