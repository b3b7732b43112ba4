#include "app/window/services.h"

namespace patina {

Services Services::engine() {
  Services services;
  services.readCapture = [](const std::filesystem::path& folder, const JobContext& job) {
    return readFourierCapture(folder, job);
  };
  services.readPhoto = [](const FourierCapture& capture, const FourierPhoto& photo) {
    return patina::readPhoto(capture, photo);
  };
  services.fit = [](const FourierCapture& capture, const FourierFitOptions& options, const JobContext& job) {
    return fitFourier(capture, options, job);
  };
  services.writeFit = [](const std::filesystem::path& folder, const FourierFit& fit) {
    return writeFourierFit(folder, fit);
  };
  services.loadFit = [](const std::filesystem::path& folder, const JobContext& job) {
    return loadFourierFit(folder, job);
  };
  return services;
}

}  // namespace patina
