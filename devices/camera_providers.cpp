#include "devices/camera_providers.h"

#include "devices/simulated/live_rig.h"
#include "devices/v4l2/v4l2_camera.h"
#include "devices/watched_folder/watched_folder.h"
#include "engine/base/text.h"
#ifdef PATINA_HAS_LIBCAMERA
#include "devices/libcamera_camera.h"
#endif

namespace patina {

std::vector<std::unique_ptr<CameraProvider>> cameraProviders() {
  std::vector<std::unique_ptr<CameraProvider>> providers;
  providers.push_back(std::make_unique<V4l2Provider>());
#ifdef PATINA_HAS_LIBCAMERA
  providers.push_back(std::make_unique<LibcameraProvider>());
#endif
  providers.push_back(std::make_unique<WatchedFolderProvider>());
  providers.push_back(std::make_unique<LiveRigProvider>());
  return providers;
}

std::vector<CameraInfo> listCameras(const std::vector<std::unique_ptr<CameraProvider>>& providers,
                                    std::vector<std::string>* remarks) {
  std::vector<CameraInfo> all;
  for (const auto& provider : providers) {
    Result<std::vector<CameraInfo>> cameras = provider->list();
    if (cameras) {
      all.insert(all.end(), cameras->begin(), cameras->end());
    } else if (remarks) {
      remarks->push_back(provider->backend() + ": " + cameras.error().sentence());
    }
  }
  return all;
}

Result<std::unique_ptr<CameraDevice>> openCamera(
    const std::vector<std::unique_ptr<CameraProvider>>& providers, const std::string& id) {
  const std::string backend = id.substr(0, id.find(':'));
  std::string names;
  for (const auto& provider : providers) {
    if (provider->backend() == backend) return provider->open(id);
    names += (names.empty() ? "" : ", ") + provider->backend();
  }
  return Error{ErrorCode::NotFound,
               inQuotes(id) + " names no camera: there is no backend " + inQuotes(backend), "",
               "begin with one of: " + names + " (patina-cli capture --list)"};
}

}  // namespace patina
