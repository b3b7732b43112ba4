#pragma once

#include "engine/base/result.h"
#include "engine/geometry/camera.h"
#include "engine/image/image.h"

namespace patina {

/// Where the camera stands, seen in one frame.
struct PoseEstimate {
  Camera camera;          ///< lens and pose
  double residualPx = 0;  ///< RMS of the markers
  double tiltUncertaintyDeg = 0, distanceUncertaintyMm = 0;
};

/// Finds the camera's pose from a board of markers round the sample (calibration has one), or knows it (the
/// simulated rig). Threading: one thread.
class PoseSource {
 public:
  virtual ~PoseSource() = default;
  /// Errors: NotFound with a sentence on what is missing (too few markers in the picture, too dark).
  virtual Result<PoseEstimate> poseIn(const Image& linear) = 0;
};

}  // namespace patina
