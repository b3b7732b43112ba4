#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/capture/two_shot_capture.h"
#include "engine/image/image.h"
#include "engine/twoshot/deviation.h"
#include "engine/twoshot/photo_noise.h"

namespace patina {

/// Where each pixel of a camera looks on the sample plane. Arrays of width x height.
struct SampleView {
  int width = 0, height = 0;
  Eigen::Vector3d cameraMm = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector2f> positionMm;  ///< on z = 0; NaN where the pixel doesn't see the plane
  std::vector<float> areaMm2;               ///< of the plane that a pixel covers
  std::vector<std::uint8_t> onSample;       ///< 1: the pixel's centre is on the sample
  std::vector<std::uint8_t> inside;         ///< 1: its eight neighbours are too, so that no edge mixes in

  std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * width + x; }
  Eigen::Vector3d toView(std::size_t pixel) const {
    return (cameraMm - Eigen::Vector3d(positionMm[pixel].x(), positionMm[pixel].y(), 0)).normalized();
  }
};

SampleView viewOf(const TwoShotCapture& capture, const Camera& camera);

/// E cos(thetaI) at each pixel of a camera, pixel units per second: what a photograph of a white tile with a
/// BRDF of 1/sr would read, so that pixel = BRDF * rate * exposure. The lens' vignetting is part of it.
struct IrradiancePicture {
  Image rate;               ///< R G B; 0 where unknown
  Image relativeVariance;   ///< of the rate, after smoothing
  double smoothedOver = 1;  ///< pixels that one value was averaged over
  bool otherCamera =
      false;  ///< from a white photograph of another camera: the lens' vignetting is not removed
};

/// Photographs of one camera under one light, merged and made absolute: BRDF values.
struct ReflectancePicture {
  std::vector<std::size_t> shots;  ///< indices into capture.shots, at least one
  Eigen::Vector3d toLight = Eigen::Vector3d::UnitZ();
  SampleView view;
  IrradiancePicture irradiance;
  Image brdf;                        ///< R G B, 1/sr; noise may make it negative
  Image variance;                    ///< of brdf, without the irradiance's part
  std::vector<std::uint8_t> usable;  ///< 1: inside the sample, not clipped in every exposure, white known
  /// What the bundle doesn't say of the set-up; `brdf` is free of it. Null: nothing.
  std::shared_ptr<const TwoShotDeviation> deviation;
  std::size_t clipped = 0, dark = 0;  ///< pixels inside the sample: clipped in all exposures; not above zero
};

/// Light and view at a point of the sample plane, in the sample's own frame; half-angle coordinates of them,
/// as the basis is looked up.
DirectionPair directionsAt(const ReflectancePicture& picture, const Eigen::Vector2d& positionMm);
HalfDiffAngles anglesAt(const ReflectancePicture& picture, const DirectionPair& pair);

/// One photograph as it was read.
struct LoadedShot {
  Image pixels;  ///< linear, as the file
  PhotoNoise noise;
  Image asTaken;  ///< before glare was taken off `pixels`; empty where nothing was
};

/// All photographs of a bundle that were asked for, and what is known of their light.
struct LoadedCapture {
  std::vector<LoadedShot> shots;               ///< as capture.shots; empty images where not asked for
  std::vector<ReflectancePicture> pictures;    ///< of the fitted shots, merged
  std::vector<std::string> remarks;            ///< sentences on whites of other cameras, clipping
  std::map<std::size_t, std::string> leftOut;  ///< shots that can't be used, and why, a sentence
};

/// Reads the fitted shots and their white photographs. A picture that has nothing to fit (black, clipped, its
/// white black, the sample not in view) is left out, with the reason among the remarks. `deviation`: taken
/// out of the pictures. Errors: those of `readPhoto`; Invalid where no picture is left, with the last one's
/// reason; Cancelled.
Result<LoadedCapture> loadFittedShots(const TwoShotCapture& capture, const JobContext& job,
                                      const std::shared_ptr<const TwoShotDeviation>& deviation = {});

/// E cos(thetaI) for one shot: its own `normalIrradiance`, or white photographs under the same light. Where
/// one was taken by the same camera the same pixel is used, else the white is looked up where it sees the
/// same point of the sample. Several exposures are merged; noise is averaged over 7 x 7 pixels where that
/// changes nothing but the noise. `remarks` may be null.
Result<IrradiancePicture> irradianceOf(const TwoShotCapture& capture, const TwoShotPhoto& shot,
                                       const SampleView& view, std::vector<std::string>* remarks);

/// Whether two cameras are the same to rounding.
bool sameCamera(const Camera& a, const Camera& b);

}  // namespace patina
