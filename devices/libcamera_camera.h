#pragma once

#include <memory>
#include <string>
#include <vector>

#include "engine/acquire/camera_device.h"

namespace patina {

/// Cameras through libcamera (the sensors of laptops and small boards that V4L2 alone can't drive): raw role
/// where there is one, else stills. Automatic exposure and white balance are off from the first frame;
/// exposure and gains are those that each frame's metadata say. Built where the library is found. Never run
/// on a real camera.
class LibcameraProvider : public CameraProvider {
 public:
  LibcameraProvider();
  ~LibcameraProvider() override;
  std::string backend() const override { return "libcamera"; }
  Result<std::vector<CameraInfo>> list() override;
  Result<std::unique_ptr<CameraDevice>> open(const std::string& id) override;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace patina
