#pragma once

#include <filesystem>
#include <functional>
#include <memory>

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

  /// The real ones.
  static Services engine();
};

}  // namespace patina
