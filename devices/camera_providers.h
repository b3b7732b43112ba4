#pragma once

#include <memory>
#include <string>
#include <vector>

#include "engine/acquire/camera_device.h"

namespace patina {

/// The ways to cameras that this build has, the simulated one last. `libcamera` only where its library was
/// found at build time.
std::vector<std::unique_ptr<CameraProvider>> cameraProviders();

/// All cameras that are there now. A backend that fails is said in `remarks` and leaves the others alone.
std::vector<CameraInfo> listCameras(const std::vector<std::unique_ptr<CameraProvider>>& providers,
                                    std::vector<std::string>* remarks = nullptr);

/// The camera with an id of `listCameras` ("v4l2:/dev/video0", "folder:PATH", "simulated:laminate"). Errors:
/// NotFound (no backend of that name, or no such camera: those that are there are named), and the backend's.
Result<std::unique_ptr<CameraDevice>> openCamera(
    const std::vector<std::unique_ptr<CameraProvider>>& providers, const std::string& id);

}  // namespace patina
