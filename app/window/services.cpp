#include "app/window/services.h"

#include "devices/simulated/simulated_rig.h"

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
    // A fit that was stopped, or died with the program, goes on where it was.
    FourierFitStorage storage;
    storage.keepFolder = unfinishedInCache(capture);
    auto fit = fitFourier(capture, options, job, storage);
    if (fit && !(*fit)->stats().cancelled) removeUnfinished(storage.keepFolder);
    return fit;
  };
  services.writeFit = [](const std::filesystem::path& folder, const FourierFit& fit) {
    return writeFourierFit(folder, fit);
  };
  services.loadFit = [](const std::filesystem::path& folder, const JobContext& job) {
    return loadFourierFit(folder, job);
  };
  services.simulate = [](const std::string& scene, const std::filesystem::path& folder,
                         const JobContext& job) -> Result<FourierCapture> {
    constexpr int kPixels = 96;  // a capture in about ten seconds, a fit in a few
    const SimulatedSheet sheet = simulatedScene(scene);
    const auto report =
        simulateCapture(folder, SimulatedRig::desk(kPixels, sheet.widthMm, sheet.heightMm), sheet, {}, job);
    if (!report) return report.error();
    return readFourierCapture(folder, job);
  };
  for (const std::string& scene : simulatedSceneNames())
    services.scenes.emplace_back(scene, simulatedSceneSummary(scene));
  services.addTwoShot();
  services.addExplain();
  services.rig = RigServices::devices();
  return services;
}

}  // namespace patina
