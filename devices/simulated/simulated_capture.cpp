#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>

#include "devices/simulated/bundle_folder.h"
#include "devices/simulated/photo_effects.h"
#include "devices/simulated/sheet_form.h"
#include "devices/simulated/simulated_rig.h"
#include "devices/simulated/simulated_sensor.h"
#include "engine/capture/capture_json.h"
#include "engine/image/exr.h"

namespace patina {
namespace {

namespace fs = std::filesystem;

Status writeTruth(const fs::path& folder, const SimulatedRig& rig, const SimulatedSheet& sheet,
                  const SimulatedCaptureOptions& options, double fullScale) {
  std::error_code error;
  fs::create_directories(folder, error);
  const int longest =
      options.truthSize > 0 ? options.truthSize : std::max(rig.camera.width, rig.camera.height);
  const double scale = longest / std::max(sheet.widthMm, sheet.heightMm);
  const int width = std::max(1, static_cast<int>(std::lround(sheet.widthMm * scale)));
  const int height = std::max(1, static_cast<int>(std::lround(sheet.heightMm * scale)));
  SheetTruth truth = sheetTruth(sheet, width, height, 0);
  const SheetForm form(options.effects, sheet);
  for (int j = 0; j < height && !form.flat(); ++j)
    for (int i = 0; i < width; ++i) {
      const std::span<float> normal = truth.normal.pixel(i, j);
      const Eigen::Vector3d turned =
          form.turned(Eigen::Vector3d(normal[0], normal[1], normal[2]),
                      ((i + 0.5) / width - 0.5) * sheet.widthMm, (0.5 - (j + 0.5) / height) * sheet.heightMm);
      for (int c = 0; c < 3; ++c) normal[static_cast<std::size_t>(c)] = static_cast<float>(turned[c]);
    }
  const std::vector<std::string> rgb{"R", "G", "B"}, one{"Y"};
  for (const auto& [name, image, channels] : {std::tuple{"diffuse.exr", &truth.diffuse, &rgb},
                                              {"specular.exr", &truth.specular, &rgb},
                                              {"normal.exr", &truth.normal, &rgb},
                                              {"roughness.exr", &truth.sigma, &one},
                                              {"kurtosis.exr", &truth.kurtosis, &one}})
    if (Status written = writeExr(folder / name, *image, *channels); !written) return written;
  nlohmann::json json = {
      {"effects", simulatedEffectsJson(options.effects)},
      {"noise", {{"shot", rig.noise.shot}, {"read", rig.noise.read}}},
      {"camera_full_scale", fullScale},
      {"roughness", "standard deviation of the half-vector's slope (the seed's sigma)"},
      {"specular",
       "albedo of the lobe at normal incidence; at other angles times F(angle)/F0, Schlick, F0=0.06"}};
  std::ofstream out(folder / "truth.json");
  out << json.dump(1) << '\n';
  out.close();
  if (!out)
    return Error{ErrorCode::WriteFailed, "the truth could not be written", (folder / "truth.json").string(),
                 "check the free space and the permissions"};
  return Done{};
}

/// R G B diffuse albedo at each pixel's centre, where an effect needs it.
Image albedoInPicture(const SimulatedRig& rig, const SimulatedSheet& sheet, const SimulatedEffects& effects) {
  if (!(effects.ambientDrift.onSheet > 0) || !effects.has("ambient-drift")) return {};
  Image albedo(rig.camera.width, rig.camera.height, 3);
  const SheetSampler sampler(sheet);
  for (int y = 0; y < albedo.height(); ++y)
    for (int x = 0; x < albedo.width(); ++x)
      if (const auto point = rig.camera.samplePlaneFromPixel(Eigen::Vector2d(x, y)))
        for (int c = 0; c < 3; ++c)
          albedo.at(x, y, c) = static_cast<float>(sampler.at(point->x(), point->y()).diffuse[c]);
  return albedo;
}

}  // namespace

Result<SimulatedCaptureReport> simulateCapture(const fs::path& folder, const SimulatedRig& rig,
                                               const SimulatedSheet& sheet,
                                               const SimulatedCaptureOptions& options,
                                               const JobContext& job) {
  Result<BundleFolder> staged = BundleFolder::create(folder);
  if (!staged) return staged.error();
  const fs::path partial = staged->path();

  SimulatedCaptureReport report;
  Result<SimulatedExposure> exposed = exposeSheet(rig, sheet, options, job, &report);
  if (!exposed) return exposed.error();
  const SimulatedExposure& exposure = *exposed;

  double fullScale = rig.fullScale;
  if (fullScale <= 0) {
    const Image window = exposure.photo(0);
    for (float sample : window.samples()) fullScale = std::max(fullScale, 1.1 * (sample + rig.blackLevel));
    if (fullScale <= 0) fullScale = 1;  // a black sheet: any scale will do
  }
  report.fullScale = fullScale;

  FourierCapture capture;
  capture.folder = partial;
  capture.sampleWidthMm = sheet.widthMm;
  capture.sampleHeightMm = sheet.heightMm;
  capture.sampleName = sheet.name;
  capture.madeBy = kMadeBySimulatedRig;
  capture.camera = rig.camera;
  capture.screen = rig.screen;
  const PhotoEffects effects(options.effects, exposure.photos(), 1, rig.blackLevel, fullScale,
                             albedoInPicture(rig, sheet, options.effects), job.seed);
  const auto add = [&](PhotoRole role, Eigen::Vector2i frequency, int phase, bool holdout) {
    char name[32];
    std::snprintf(name, sizeof name, "photo_%03zu.exr", capture.photos.size());
    FourierPhoto photo;
    photo.file = name;
    photo.role = role;
    photo.exposureS =
        rig.exposureS * (effects.otherExposure(static_cast<int>(capture.photos.size())) ? 0.5 : 1);
    photo.frequency = frequency;
    photo.phase = phase;
    photo.holdout = holdout;
    capture.photos.push_back(photo);
  };
  add(PhotoRole::Window, Eigen::Vector2i::Zero(), 0, false);
  add(PhotoRole::Black, Eigen::Vector2i::Zero(), 0, false);
  for (const auto& [list, holdout] : {std::pair{&options.fitted, false}, std::pair{&options.heldOut, true}})
    for (const Eigen::Vector2i& frequency : *list)
      for (int phase = 0; phase < 4; ++phase) add(PhotoRole::Pattern, frequency, phase, holdout);

  const auto writing = std::chrono::steady_clock::now();
  std::atomic<std::size_t> clipped{0};
  std::atomic<int> done{0};
  std::optional<Error> failure;
  std::mutex failureMutex;
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  arena.execute([&] {
    tbb::parallel_for(0, exposure.photos(), [&](int index) {
      if (job.cancelled()) return;
      {
        const std::lock_guard lock(failureMutex);
        if (failure) return;
      }
      Image photo = exposure.photo(index);
      effects.beforeSensor(photo, index);
      if (options.withNoise)
        clipped += senseInPlace(photo, rig.noise, fullScale, job.seed, static_cast<std::uint64_t>(index),
                                effects.clipsAt());
      effects.afterSensor(photo);
      const Status written = writeExr(partial / capture.photos[static_cast<std::size_t>(index)].file, photo,
                                      {"R", "G", "B"}, {{"units", "radiance, screen's full white"}}, true);
      if (!written) {
        const std::lock_guard lock(failureMutex);
        if (!failure) failure = written.error();
      }
      job.progress("write", ++done, exposure.photos(), "photos");
    });
  });
  if (failure) return *failure;
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "the simulated capture was stopped", "", ""};
  report.clippedSamples = clipped;
  if (options.writeTruth)
    if (const Status written = writeTruth(partial / "truth", rig, sheet, options, fullScale); !written)
      return written.error();
  if (const Status written = writeFourierCapture(capture); !written) return written.error();
  if (const Status moved = staged->commit(); !moved) return moved.error();
  report.seconds["write"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - writing).count();
  return report;
}

}  // namespace patina
