#include "app/window/rig/rig_services.h"

#include <mutex>

#include "app/window/rig/pattern_window.h"
#include "devices/camera_providers.h"
#include "devices/simulated/live_rig.h"

namespace patina {

RigServices RigServices::devices() {
  RigServices services;
  // One set for the window's life: a rig that is simulated is the same one whenever it is asked for.
  struct Shared {
    std::mutex mutex;
    std::vector<std::unique_ptr<CameraProvider>> providers = cameraProviders();
  };
  const auto shared = std::make_shared<Shared>();
  services.listCameras = [shared](std::vector<std::string>* remarks) {
    const std::lock_guard lock(shared->mutex);
    return patina::listCameras(shared->providers, remarks);
  };
  services.openCamera = [shared](const std::string& id) {
    const std::lock_guard lock(shared->mutex);
    return patina::openCamera(shared->providers, id);
  };
  services.simulation = [shared](const std::string& id) -> std::shared_ptr<LiveRig> {
    const std::lock_guard lock(shared->mutex);
    for (const auto& provider : shared->providers)
      if (auto* simulated = dynamic_cast<LiveRigProvider*>(provider.get());
          simulated && id.starts_with(simulated->backend() + ":"))
        if (const auto rig = simulated->rig(id); rig) return *rig;
    return nullptr;
  };
  services.listScreens = [] { return screensThere(); };
  services.openDisplay = openPatternWindow;
  return services;
}

}  // namespace patina
