#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "app/window/rig/rig_services.h"
#include "engine/capture/capture.h"
#include "engine/capture/flash_capture.h"
#include "engine/capture/two_shot_capture.h"
#include "engine/diagnosis/explanation.h"
#include "engine/fourier/fit.h"
#include "engine/twoshot/fit.h"
#include "engine/twoshot/plan.h"

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

  /// The kind that a bundle's folder says it holds: "fourier", "two-shot", ...
  std::function<Result<std::string>(const std::filesystem::path&)> captureKind;
  /// The kind that the fit.json of a folder says it is; "" where it can't be told.
  std::function<std::string(const std::filesystem::path&)> fitKind;

  // Two-shot. `basisFile`: empty for the built-in basis.
  using TwoShotFitPtr = std::shared_ptr<const TwoShotFit>;
  std::function<Result<TwoShotCapture>(const std::filesystem::path& folder, const JobContext&)> readTwoShot;
  std::function<Result<Image>(const TwoShotCapture&, const TwoShotPhoto&)> readTwoShotPhoto;
  std::function<Result<TwoShotFitPtr>(const TwoShotCapture&, const std::filesystem::path& basisFile,
                                      const TwoShotFitOptions&, const JobContext&)>
      fitTwoShot;
  std::function<Status(const std::filesystem::path& folder, const TwoShotFit&)> writeTwoShotFit;
  std::function<Result<TwoShotFitPtr>(const std::filesystem::path& folder, const JobContext&)> loadTwoShotFit;
  std::function<Result<Plan>(const std::filesystem::path& basisFile, const PlanOptions&, const JobContext&)>
      plan;
  /// What directions that were used are expected to do.
  std::function<Result<Plan>(const std::filesystem::path& basisFile, const std::vector<ShotDirections>&,
                             const NearFieldDisc&, BasisRegion, double eta, const JobContext&)>
      expect;
  /// Writes the plan, and its drawing beside it with the ending .svg.
  std::function<Status(const std::filesystem::path& file, const Plan&)> writePlan;
  std::function<Result<TwoShotCapture>(const std::string& scene, const std::filesystem::path& folder,
                                       const JobContext&)>
      simulateTwoShot;
  std::vector<std::pair<std::string, std::string>> twoShotScenes;

  /// Flash photographs have no page of their own: they are fitted while they are explained.
  std::function<Result<FlashCapture>(const std::filesystem::path& folder, const JobContext&)> readFlash;

  // Closing the loop; any kind of bundle, the first is the one that is explained.
  std::function<Result<ExplanationPtr>(const std::vector<std::filesystem::path>& bundles,
                                       const ExplainOptions&, const JobContext&)>
      explain;
  /// The same with effects of the person's choice instead of a search; empty where the engine can't.
  std::function<Result<ExplanationPtr>(const std::vector<std::filesystem::path>& bundles,
                                       const std::vector<std::string>& ids, const ExplainOptions&,
                                       const JobContext&)>
      explainWith;
  std::function<Status(const std::filesystem::path& folder, const Explanation&)> writeExplanation;

  /// Cameras, screens and what else the guided captures need.
  RigServices rig;

  /// The real ones.
  static Services engine();

 private:
  void addTwoShot();
  void addExplain();
};

}  // namespace patina
