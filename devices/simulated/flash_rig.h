#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "devices/simulated/simulated_sensor.h"
#include "devices/simulated/simulated_sheet.h"
#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/capture/flash_capture.h"
#include "engine/image/image.h"

namespace patina {

/// A simulated phone in somebody's hand: what it does that the bundle doesn't say. Everything as declared
/// where it is zero or one.
struct FlashPhone {
  double toneGamma = 1;       ///< exponent from light to value on top of the encoding
  double toneShoulder = 0;    ///< highlights pressed together: v = L (1 + s) / (1 + s L)
  std::vector<double> power;  ///< factor on the flash, photograph by photograph; empty: 1
  double vignetting = 0;      ///< light lost at the sample's corner seen from the middle position, share
  double beamExponent = 0;    ///< the flash gives cos^n of the angle to its axis
  Eigen::Vector2d beamAim = Eigen::Vector2d::Zero();        ///< slope of its axis against straight down
  Eigen::Array3d ambient = Eigen::Array3d::Zero();          ///< the room's irradiance on the sample
  double black = 0;                                         ///< of the decoded value, all channels
  Eigen::Vector2d flashOffsetMm = Eigen::Vector2d::Zero();  ///< of the flash beside where it is declared
};

/// What the surface does beyond the sheet's own two Gaussians.
struct FlashSurface {
  double anisotropy = 1;          ///< ratio of the slope's standard deviations
  double anisotropyAngleDeg = 0;  ///< of the larger one, from +x to +y
  double thirdShare = 0, thirdRatio = 3;
  bool heavyTails = false;  ///< GGX instead of the two Gaussians, alpha = sqrt(2) sigma
};

/// A flat sheet under a phone's flash.
struct FlashScene {
  std::string name = "flash";
  SimulatedSheet sheet;
  std::vector<Eigen::Vector3d> positionsMm;  ///< of the lens, one a photograph
  std::vector<int> holdout;                  ///< indices of photographs that are not to be fitted
  double intensity = 0;  ///< declared, pixel units times mm^2; 0: the brightest hundredth clips
  double clippedShare = 0.01;
  int pixels = 192;       ///< of the longer side; rectified
  int samplesASide = 2;   ///< a pixel, squared
  bool eightBits = true;  ///< PNG, sRGB; else linear EXR of 32-bit floats that clip at 1
  bool withNoise = true;
  SensorNoise noise{.shot = 2e-5, .read = 5e-4};
  FlashPhone phone;
  FlashSurface surface;

  std::vector<std::string> validate() const;
};

/// Nine positions over a sheet of this size, as a person takes them: some in the middle, some over the edges,
/// 2.4 to 2.8 sheet widths away.
std::vector<Eigen::Vector3d> flashPositions(double widthMm, double heightMm);

struct FlashSimulationReport {
  double intensity = 0;  ///< as declared
  std::size_t photos = 0, clippedSamples = 0;
};

/// Takes a whole bundle of kind `flash`: photographs, capture.json; noise from job.seed, the same on any
/// number of threads. Shares no formula with the fit: the microfacet BRDF is written from the distribution of
/// normals. Progress: "expose". Errors: Invalid (the scene), Cancelled, Refused, WriteFailed.
Result<FlashSimulationReport> simulateFlash(const FlashScene& scene, const std::filesystem::path& folder,
                                            const JobContext& job);

}  // namespace patina
