#pragma once

#include <chrono>

#include "engine/acquire/camera_device.h"
#include "engine/acquire/pattern_display.h"
#include "engine/base/job.h"

namespace patina {

struct LatencyMeasurement {
  std::chrono::microseconds latency{
      0};                               ///< from the swap until every frame that begins shows the new picture
  std::chrono::microseconds spread{0};  ///< between flashes
  int flashes = 0;
};

/// Measures a display's latency with a camera that sees the screen or the sample that it lights: the screen
/// flashes from black to white and back, and the first frame that is wholly of the new brightness says when.
/// Known to a frame's period. Progress: "latency". Errors: those of camera and display; Refused where the
/// camera can't tell black from white.
Result<LatencyMeasurement> measureLatency(CameraDevice& camera, PatternDisplay& display, double exposureS,
                                          int flashes, const JobContext& job);

}  // namespace patina
