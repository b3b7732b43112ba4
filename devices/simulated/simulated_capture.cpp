#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <iterator>
#include <mutex>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>

#include "devices/simulated/simulated_rig.h"
#include "engine/base/atomic_file.h"
#include "engine/capture/capture_json.h"
#include "engine/image/exr.h"

namespace patina {
namespace {

namespace fs = std::filesystem;

/// A well mixed 64-bit value of a counter (splitmix64's finaliser): the noise of a sample depends on where it
/// is, not on which thread came first.
std::uint64_t mixed(std::uint64_t value) {
  value += 0x9E3779B97F4A7C15ull;
  value = (value ^ (value >> 30)) * 0xBF58476D1CE4E5B9ull;
  value = (value ^ (value >> 27)) * 0x94D049BB133111EBull;
  return value ^ (value >> 31);
}

/// Standard normal for a counter (Box and Muller).
double normal(std::uint64_t counter) {
  const double u = (static_cast<double>(mixed(2 * counter) >> 11) + 0.5) * 0x1.0p-53;
  const double v = static_cast<double>(mixed(2 * counter + 1) >> 11) * 0x1.0p-53;
  return std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi * v);
}

/// Adds the sensor's noise and clips; returns how many samples were clipped at full scale.
std::size_t senseInPlace(Image& photo, const SensorNoise& noise, double fullScale, std::uint64_t stream) {
  std::size_t clipped = 0, index = 0;
  for (float& sample : photo.samples()) {
    const double variance =
        fullScale * noise.shot * std::max(0.0f, sample) + noise.read * noise.read * fullScale * fullScale;
    double value = sample + std::sqrt(variance) * normal(stream + index++);
    if (value >= fullScale) {
      value = fullScale;
      ++clipped;
    }
    sample = static_cast<float>(value);  // may fall below zero where the black level is low
  }
  return clipped;
}

constexpr const char* kMadeBy = "patina simulated rig";

bool onlyNames(const fs::path& folder, const std::function<bool(const std::string&)>& ours) {
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    if (!ours(it->path().filename().string())) return false;
  return !error;
}

/// Whether nothing would be lost with the folder: it is missing, empty, or holds a capture that says that the
/// simulated rig made it, and nothing that the rig doesn't write.
bool replaceable(const fs::path& folder) {
  std::error_code error;
  if (fs::symlink_status(folder, error).type() == fs::file_type::not_found) return true;
  if (!fs::is_directory(folder, error)) return false;
  if (fs::is_empty(folder, error)) return true;
  std::ifstream in(folder / "capture.json", std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  const Result<FourierCapture> there = parseFourierCapture(text, folder, "capture.json");
  if (!there || there->madeBy != kMadeBy) return false;
  const bool truthIsOurs =
      !fs::exists(folder / "truth", error) ||
      onlyNames(folder / "truth", [](auto& name) { return name == "truth.json" || name.ends_with(".exr"); });
  return truthIsOurs && onlyNames(folder, [](const std::string& name) {
           return name == "capture.json" || name == "truth" ||
                  (name.starts_with("photo_") && name.ends_with(".exr"));
         });
}

Error strangersFolder(const fs::path& folder) {
  return {ErrorCode::Refused,
          "the folder holds something that is not a simulated capture, so it is left alone", folder.string(),
          "name an empty or a new folder"};
}

/// A hidden name beside `folder` that nobody else uses.
fs::path hiddenNeighbour(const fs::path& folder, const char* what) {
  static std::atomic<unsigned> counter{0};
  const auto now = std::chrono::steady_clock::now().time_since_epoch().count();
  return folder.parent_path() / ("." + folder.filename().string() + what + std::to_string(::getpid()) + "-" +
                                 std::to_string(now) + "-" + std::to_string(counter++));
}

/// Puts the finished capture where an earlier one is: that one aside, this one in, and only then the earlier
/// one away. On failure the earlier one is back in its place.
Status replaceFolder(const fs::path& finished, const fs::path& target) {
  if (!replaceable(target)) return strangersFolder(target);  // changed while the work was going on
  const fs::path aside = hiddenNeighbour(target, ".replaced-");
  std::error_code error, ignored;
  fs::rename(target, aside, error);
  if (!error) {
    fs::rename(finished, target, error);
    if (error) fs::rename(aside, target, ignored);
  }
  if (error)
    return Error{ErrorCode::WriteFailed,
                 "the finished capture could not be moved into place: " + error.message(), target.string(),
                 "check the permissions"};
  fs::remove_all(aside, ignored);
  return Done{};
}

Status writeTruth(const fs::path& folder, const SimulatedRig& rig, const SimulatedSheet& sheet,
                  const SimulatedCaptureOptions& options, double fullScale) {
  std::error_code error;
  fs::create_directories(folder, error);
  const int longest =
      options.truthSize > 0 ? options.truthSize : std::max(rig.camera.width, rig.camera.height);
  const double scale = longest / std::max(sheet.widthMm, sheet.heightMm);
  const int width = std::max(1, static_cast<int>(std::lround(sheet.widthMm * scale)));
  const int height = std::max(1, static_cast<int>(std::lround(sheet.heightMm * scale)));
  const SheetTruth truth = sheetTruth(sheet, width, height, 0);
  const std::vector<std::string> rgb{"R", "G", "B"}, one{"Y"};
  for (const auto& [name, image, channels] : {std::tuple{"diffuse.exr", &truth.diffuse, &rgb},
                                              {"specular.exr", &truth.specular, &rgb},
                                              {"normal.exr", &truth.normal, &rgb},
                                              {"roughness.exr", &truth.sigma, &one},
                                              {"kurtosis.exr", &truth.kurtosis, &one}})
    if (Status written = writeExr(folder / name, *image, *channels); !written) return written;
  nlohmann::json json = {
      {"effects", nlohmann::json::object()},
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

}  // namespace

Result<SimulatedCaptureReport> simulateCapture(const fs::path& folder, const SimulatedRig& rig,
                                               const SimulatedSheet& sheet,
                                               const SimulatedCaptureOptions& options,
                                               const JobContext& job) {
  std::error_code error;
  const fs::path resolved = fs::weakly_canonical(fs::absolute(folder), error);  // through symbolic links
  const fs::path clean = resolved.has_filename() ? resolved : resolved.parent_path();  // "out/" means "out"
  if (error || clean.empty() || !replaceable(clean)) return strangersFolder(folder);
  const bool existed = fs::exists(clean, error);
  // Not committed, it takes itself and the parents that it made away.
  const fs::path finished = existed ? hiddenNeighbour(clean, ".new-") : clean;
  Result<StagedFolder> staged = StagedFolder::create(finished);
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
  capture.madeBy = kMadeBy;
  capture.camera = rig.camera;
  capture.screen = rig.screen;
  const auto add = [&](PhotoRole role, Eigen::Vector2i frequency, int phase, bool holdout) {
    char name[32];
    std::snprintf(name, sizeof name, "photo_%03zu.exr", capture.photos.size());
    FourierPhoto photo;
    photo.file = name;
    photo.role = role;
    photo.exposureS = rig.exposureS;
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
  const std::uint64_t samples = static_cast<std::uint64_t>(exposure.width()) * exposure.height() * 3;
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  arena.execute([&] {
    tbb::parallel_for(0, exposure.photos(), [&](int index) {
      if (job.cancelled()) return;
      {
        const std::lock_guard lock(failureMutex);
        if (failure) return;
      }
      Image photo = exposure.photo(index);
      for (float& sample : photo.samples()) sample += static_cast<float>(rig.blackLevel);
      if (options.withNoise)
        clipped += senseInPlace(photo, rig.noise, fullScale,
                                mixed(job.seed) + static_cast<std::uint64_t>(index) * samples);
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
  if (existed) {
    if (const Status replaced = replaceFolder(finished, clean); !replaced) {
      fs::remove_all(finished, error);
      return replaced.error();
    }
  }
  report.seconds["write"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - writing).count();
  return report;
}

}  // namespace patina
