#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "devices/simulated/simulated_sensor.h"
#include "devices/simulated/two_shot_effects.h"
#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/brdf/brdf.h"
#include "engine/geometry/camera.h"
#include "engine/image/image.h"
#include "engine/twoshot/near_field.h"

namespace patina {

/// One position of camera and light, photographed at one or more exposure times.
struct TwoShotPose {
  ShotDirections directions;
  std::vector<double> exposuresS{1.0};  ///< a photograph each; a bracket where there are several
  bool holdout = false;
};

/// A flat sample on the simulated near-field rig: a camera at `distanceMm` that looks at the sample's centre,
/// a distant light, a white tile that takes the sample's place.
struct TwoShotScene {
  std::string name;
  std::vector<BrdfPtr> brdfs;  ///< one, or one for each value of `labels`
  Image labels;  ///< one channel over the sample's bounding rectangle, row 0 at +y: index into `brdfs`, the
                 ///< nearest texel counts; empty: brdfs[0] everywhere
  double fovDeg = 25;                ///< a disc of radius distanceMm * tan(fov / 2)
  double widthMm = 0, heightMm = 0;  ///< a rectangle instead of the disc where both are positive
  double distanceMm = 300;           ///< from the camera to the sample's centre
  int pixels = 160;                  ///< of the camera's sides
  double rollDeg = 0;                ///< of the camera about its axis
  Eigen::Matrix<double, 5, 1> distortion = Eigen::Matrix<double, 5, 1>::Zero();  ///< k1 k2 p1 p2 k3
  double vignetting = 0;  ///< share of light that the lens loses in the picture's corners, [0, 1): a white
                          ///< reference divides it out
  std::vector<TwoShotPose> poses;
  Eigen::Vector3d irradiance{2.7, 2.4, 1.9};  ///< E on a plane that faces the light, pixel units per second
  Eigen::Vector3d whiteReflectance{0.991, 0.990, 0.987};  ///< of the tile, Lambertian
  double tileExcess = 1.5;                                ///< the tile's size over the sample's, at least 1
  bool declareIrradiance = false;  ///< say E in the bundle instead of photographing the tile
  SensorNoise noise;
  bool withNoise = true;         ///< false also turns clipping off
  double fullScale = 0;          ///< pixel value at which the sensor clips; 0: a tenth above the brightest of
                                 ///< all photographs of the sample
  bool statesSaturation = true;  ///< whether the bundle says where the sensor clips
  int samplesPerPixelSide = 4;   ///< rays a pixel, squared
  TwoShotEffects effects;        ///< what happens and the bundle doesn't say
  bool halfFloats = true;        ///< 16-bit EXR; else 32

  double radiusMm() const;
  bool disc() const { return !(widthMm > 0 && heightMm > 0); }
  /// Every problem with the values; empty when usable.
  std::vector<std::string> validate() const;
};

/// The camera of a pose: looks at the centre, sees the whole sample with a small margin. The lens is the same
/// for all poses of a scene.
Camera twoShotCamera(const TwoShotScene& scene, const ShotDirections& directions);

/// Noise-free pixels of a photograph after 1 s with a perfect sensor: brdf * cos(theta_i) * E, the mean over
/// rays that each meet the sample at their own point with their own view direction; off the sample 0. Rays
/// where the BRDF is not known are left out of the mean and counted in `unknownRays`; a pixel without any
/// known ray is 0. `tile`: the white tile in the sample's place, `tileExcess` times as large. Errors:
/// Cancelled.
Result<Image> exposeTwoShot(const TwoShotScene& scene, const ShotDirections& directions, bool tile,
                            const JobContext& job, std::size_t* unknownRays = nullptr);

struct TwoShotSimulationReport {
  std::map<std::string, double> seconds;  ///< "expose", "write"
  double fullScale = 0;                   ///< pixel value at which the sensor clips
  std::size_t photos = 0, clippedSamples = 0, unknownRays = 0;
};

/// Takes a whole bundle of kind `two-shot`: photographs (shot_NNN.exr), white photographs (white_NNN.exr, one
/// a pose, exposed so that the tile reaches two thirds of full scale), capture.json; noise from job.seed, the
/// same on any number of threads. Made beside `folder` and moved there at the end; see BundleFolder for what
/// is replaced. Progress: "expose". Errors: Invalid (the scene; every problem is named), Cancelled, Refused,
/// WriteFailed.
Result<TwoShotSimulationReport> simulateTwoShot(const TwoShotScene& scene,
                                                const std::filesystem::path& folder, const JobContext& job);

}  // namespace patina
