#pragma once

#include <optional>

#include "engine/acquire/camera_device.h"
#include "engine/acquire/frame_image.h"
#include "engine/base/job.h"

namespace patina {

struct PhotographOptions {
  int frames = 1;        ///< averaged. More: less noise, longer
  double fill = 0.8;     ///< share of full scale that the brightest percentile may reach
  double refreshHz = 0;  ///< of a screen that lights it: exposures are whole periods; 0: no screen does
  RigTime notBefore{};   ///< exposure begins at this time or later
  std::optional<double> exposureS;  ///< given: nothing is chosen
  FrameConversion conversion;
};

/// A photograph for a calibration.
struct Photograph {
  Image image;              ///< linear, share of full scale, black level off
  double exposureS = 0;     ///< really in force; 0: the camera doesn't say
  double clippedShare = 0;  ///< of its pixels
};

/// Photographs with an exposure that the histogram decides, where the camera's can be set; its own else.
/// Errors: those of the camera; Invalid (still clipped or black after all attempts, in words). Progress:
/// "photograph".
Result<Photograph> takePhotograph(CameraDevice& camera, const PhotographOptions& options,
                                  const JobContext& job);

}  // namespace patina
