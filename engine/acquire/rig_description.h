#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "engine/acquire/frame_image.h"
#include "engine/acquire/pattern_image.h"
#include "engine/base/result.h"
#include "engine/geometry/camera.h"
#include "engine/screen/screen.h"

namespace patina {

/// What calibration knows of a rig, as a capture needs it.
struct RigDescription {
  Camera camera;  ///< lens and pose
  Screen screen;  ///< size, pose, window, emission
  double sampleWidthMm = 0, sampleHeightMm = 0;
  std::string sampleName;
  /// Radiance, in the screen's full white head-on, of a pixel at full scale after one second at gain 1.
  /// Source: white paper (Appendix A). 0: not known; the bundle then has the unit of its own window
  /// photograph.
  double radianceOfFullScaleSecond = 0;
  ScreenResponse screenResponse = ScreenResponse::linear();
  FrameConversion conversion;
  std::vector<std::string> problems() const;
};

/// From a JSON file with the keys `sample`, `camera`, `screen` of a capture.json (an earlier bundle's
/// description will do), and optionally `radiance_of_full_scale_second`, `screen_response` (256 numbers, or
/// {"gamma": g}). Errors: NotFound, Malformed, Invalid.
Result<RigDescription> readRigDescription(const std::filesystem::path& file);
Status writeRigDescription(const std::filesystem::path& file, const RigDescription& rig);

}  // namespace patina
