#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "engine/capture/capture.h"
#include "engine/fourier/fit.h"

namespace patina {

/// The engine's calls that the window makes, in one place so that a test can put its own in.
struct Services {
  std::function<Result<FourierCapture>(const std::filesystem::path&, const JobContext&)> readCapture;
  std::function<Result<Image>(const FourierCapture&, const FourierPhoto&)> readPhoto;
  std::function<Result<std::shared_ptr<const FourierFit>>(const FourierCapture&, const FourierFitOptions&,
                                                          const JobContext&)>
      fit;
  std::function<Status(const std::filesystem::path&, const FourierFit&)> writeFit;
  std::function<Result<std::shared_ptr<const FourierFit>>(const std::filesystem::path&, const JobContext&)>
      loadFit;
  /// Photographs one of the simulated rig's scenes into a folder and opens the bundle.
  std::function<Result<FourierCapture>(const std::string& scene, const std::filesystem::path& folder,
                                       const JobContext&)>
      simulate;
  /// Name and description of each scene.
  std::vector<std::pair<std::string, std::string>> scenes;

  /// The real ones.
  static Services engine();
};

}  // namespace patina
