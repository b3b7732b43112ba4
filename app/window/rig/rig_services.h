#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "engine/acquire/camera_device.h"
#include "engine/acquire/pattern_display.h"
#include "engine/acquire/pose_source.h"
#include "engine/calibration/board.h"
#include "engine/geometry/camera.h"

namespace patina {

class LiveRig;

/// The outside world as the rig's pages see it, in one place so that a test can put its own in.
struct RigServices {
  /// Cameras that are there now; a backend that fails is said in `remarks`. Any thread.
  std::function<std::vector<CameraInfo>(std::vector<std::string>* remarks)> listCameras;
  std::function<Result<std::unique_ptr<CameraDevice>>(const std::string& id)> openCamera;
  /// The simulated rig behind a camera; null for a real one.
  std::function<std::shared_ptr<LiveRig>(const std::string& cameraId)> simulation;

  /// Screens that are there now. The window's thread, as all below.
  std::function<std::vector<ScreenInfo>()> listScreens;
  /// A full-screen pattern window on one of them: see `openPatternWindow`.
  std::function<Result<std::shared_ptr<PatternDisplay>>(const std::string& screenId, GlassObserver* observer,
                                                        std::function<void(const Error&)> left)>
      openDisplay;

  /// Finds the camera's pose from a board of markers that lies round the sample. `lens`: calibrated.
  std::function<std::unique_ptr<PoseSource>(const Camera& lens, const Board& markers)> poses;

  /// The real ones.
  static RigServices devices();
};

}  // namespace patina
