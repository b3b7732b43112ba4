#include <tbb/task_arena.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/fourier/fit_state.h"

namespace patina {
namespace {

using Json = nlohmann::ordered_json;

const char* name(LobeMapping lobe) {
  return lobe == LobeMapping::ExactMoments ? "exact" : "paper";
}
const char* name(MeasurementWeights weights) {
  return weights == MeasurementWeights::Noise ? "noise" : "paper";
}

Json toJson(const FourierFit& fit) {
  const FourierFitStats& stats = fit.stats();
  const FourierFitOptions& options = fit.options();
  Json json;
  json["kind"] = "fourier";
  json["bundle"] = std::filesystem::absolute(fit.capture().folder).lexically_normal().string();
  json["sample_mm"] = {fit.maps().widthMm, fit.maps().heightMm};
  json["map_size"] = {fit.maps().width, fit.maps().height};
  json["seconds"] = stats.seconds;
  json["texels"] = stats.texels;
  json["iterations"] = stats.meanIterations;
  json["options"] = {{"size", options.size},
                     {"lobe", name(options.lobe)},
                     {"weights", name(options.weights)},
                     {"max_iterations", options.maxIterations},
                     {"tolerance", options.tolerance},
                     {"neighbour_restarts", options.neighbourRestarts},
                     {"pool_neighbours", options.poolNeighbours},
                     {"schedule", options.schedule == FitSchedule::Paper ? "paper" : "independent"},
                     {"memory_bytes", options.memoryLimitBytes},
                     {"effects", "none"}};
  json["cancelled"] = stats.cancelled;
  auto number = [](double value) -> Json { return value > 0 ? Json(value) : Json(nullptr); };
  json["fit_rms"] = number(stats.fitRms);
  json["holdout_rms"] = number(stats.holdoutRms);
  json["noise_floor"] = number(stats.holdoutRms > 0 ? stats.noiseFloorHoldout : stats.noiseFloorFit);
  json["noise_floor_fit"] = number(stats.noiseFloorFit);
  json["noise_floor_holdout"] = number(stats.noiseFloorHoldout);
  json["noise"] = {{"shot", stats.noiseShot}, {"read", stats.noiseRead}};
  json["status"] = stats.statusCounts;
  json["clipped_samples"] = stats.clippedSamples;
  json["clipped_points"] = stats.clippedSites;
  json["dropped_measurements"] = stats.droppedRows;
  json["resumed_texels"] = stats.resumedTexels;
  json["measurements_on_disk"] = stats.measurementsOnDisk;
  json["coarser_points"] = stats.coarserSites;
  json["threads"] = stats.threads;
  json["peak_bytes"] = stats.peakBytes;
  json["solver"] = solverTarget();
  return json;
}

}  // namespace

Status writeFourierFit(const std::filesystem::path& folder, const FourierFit& fit) {
  auto staged = StagedFolder::create(folder);
  if (!staged) return staged.error();
  std::error_code failed;
  std::filesystem::create_directories(staged->path() / "maps", failed);
  if (failed)
    return Error{ErrorCode::WriteFailed, "can't make the folder for the maps: " + failed.message(),
                 folder.string(), "check the disk's space and permissions"};
  if (auto status = writeMaps(staged->path() / "maps", fit.maps()); !status) return status;
  if (auto status =
          writeFileAtomically(staged->path() / "fit.json",
                              toJson(fit).dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
      !status)
    return status;
  return staged->commit();
}

namespace {

Result<std::unique_ptr<FourierFitState>> loadState(const std::filesystem::path& fitFolder,
                                                   const JobContext& job) {
  constexpr std::uint64_t kLargestFitJson = 1 << 20;
  const auto jsonFile = fitFolder / "fit.json";
  auto text = readFile(jsonFile, kLargestFitJson);
  if (!text) return text.error();
  auto malformed = [&](std::string what) {
    return Error{ErrorCode::Malformed, std::move(what), jsonFile.string(), "fit the bundle again"};
  };
  auto state = std::make_unique<FourierFitState>();
  std::filesystem::path bundle;
  double widthMm = 0, heightMm = 0;
  try {
    const Json json = Json::parse(*text);
    if (json.at("kind") != "fourier") return malformed("this is not a fit of kind fourier");
    bundle = json.at("bundle").get<std::string>();
    widthMm = json.at("sample_mm").at(0).get<double>();
    heightMm = json.at("sample_mm").at(1).get<double>();
    const Json& options = json.at("options");
    state->options.size = options.at("size").get<int>();
    state->options.lobe =
        options.at("lobe") == "paper" ? LobeMapping::PaperAffine : LobeMapping::ExactMoments;
    state->options.weights =
        options.at("weights") == "paper" ? MeasurementWeights::PaperConstant : MeasurementWeights::Noise;
    state->options.maxIterations = options.at("max_iterations").get<int>();
    state->options.tolerance = options.at("tolerance").get<double>();
    state->options.neighbourRestarts = options.at("neighbour_restarts").get<bool>();
    state->options.poolNeighbours = options.at("pool_neighbours").get<bool>();
    // Fits of earlier versions don't have what follows.
    state->options.schedule =
        options.value("schedule", "independent") == "paper" ? FitSchedule::Paper : FitSchedule::Independent;
    state->options.memoryLimitBytes = options.value("memory_bytes", FourierFitOptions{}.memoryLimitBytes);
    FourierFitStats& stats = state->stats;
    stats.clippedSites = json.value("clipped_points", std::size_t{0});
    stats.droppedRows = json.value("dropped_measurements", std::size_t{0});
    stats.resumedTexels = json.value("resumed_texels", std::size_t{0});
    stats.coarserSites = json.value("coarser_points", false);
    auto number = [&](const char* key) {
      return json.at(key).is_number() ? json.at(key).get<double>() : -1.0;
    };
    stats.seconds = json.at("seconds").get<std::map<std::string, double>>();
    stats.texels = json.at("texels").get<std::size_t>();
    stats.meanIterations = json.at("iterations").get<double>();
    stats.cancelled = json.at("cancelled").get<bool>();
    stats.fitRms = number("fit_rms");
    stats.holdoutRms = number("holdout_rms");
    stats.noiseFloorFit = number("noise_floor_fit");
    stats.noiseFloorHoldout = number("noise_floor_holdout");
    stats.statusCounts = json.at("status").get<std::map<std::string, std::size_t>>();
    stats.clippedSamples = json.at("clipped_samples").get<std::size_t>();
    stats.threads = json.at("threads").get<int>();
    stats.peakBytes = json.at("peak_bytes").get<std::size_t>();
  } catch (const nlohmann::json::exception& problem) {
    return malformed(std::string("fit.json can't be understood: ") + problem.what());
  }
  if (!state->options.validate().empty() || !(widthMm > 0) || !(heightMm > 0))
    return malformed("fit.json holds impossible values");

  auto maps = readMaps(fitFolder / "maps");
  if (!maps) return maps.error();
  auto capture = readFourierCapture(bundle, job);
  if (!capture) {
    Error error = capture.error();
    error.what = "the fit's bundle can't be opened: " + error.what;
    error.tryThis = "put the bundle back where it was (" + bundle.string() + "), or fit it again";
    return error;
  }
  auto plan = planMeasurements(*capture, job);
  if (!plan) return plan.error();
  // A fit whose pixels were grouped for the memory limit is looked at with the same groups.
  const int size = state->stats.coarserSites ? std::max(maps->width, maps->height) : state->options.size;
  auto sites = makeSites(*capture, size);
  if (!sites) return sites.error();
  const MeasurementStorage storage{state->options.memoryLimitBytes, {}};
  auto measured = measure(*capture, std::move(*plan), std::move(*sites), job, storage);
  if (!measured) return measured.error();

  state->capture = std::move(*capture);
  state->frame = ScreenFrame(state->capture.screen);
  state->measurements = std::move(*measured);
  state->stats.noiseShot = state->measurements.noise.shot;
  state->stats.noiseRead = state->measurements.noise.read;
  state->maps = std::move(*maps);
  state->maps.widthMm = widthMm;
  state->maps.heightMm = heightMm;
  state->makeDiffuse();
  // The maps are what was kept; each measured point takes its texel's values.
  const SiteSet& set = state->measurements.sites;
  state->sites.resize(set.size());
  state->siteStatus.resize(set.size());
  state->siteResidual.resize(set.size());
  const SvbrdfMaps& m = state->maps;
  for (std::size_t s = 0; s < set.size(); ++s) {
    const int i =
        std::clamp(static_cast<int>((set.pointMm[s].x() / widthMm + 0.5) * m.width), 0, m.width - 1);
    const int j =
        std::clamp(static_cast<int>((0.5 - set.pointMm[s].y() / heightMm) * m.height), 0, m.height - 1);
    SvbrdfParameters& p = state->sites[s];
    for (int c = 0; c < 3; ++c) {
      p.diffuse[c] = m.diffuse.at(i, j, c);
      p.specular[c] = m.specular.at(i, j, c);
      p.normal[c] = m.normal.at(i, j, c);
    }
    p.sigma = m.sigma.at(i, j);
    p.kurtosis = m.kurtosis.at(i, j);
    state->siteStatus[s] = static_cast<TexelStatus>(static_cast<int>(m.status.at(i, j)));
    state->siteResidual[s] = m.residual.at(i, j);
  }
  // Held-out measurements for the spectra; the errors themselves stand in fit.json.
  if (!state->stats.cancelled && !state->measurements.plan.heldOut.empty()) {
    const Status read = measureHeldOut(state->capture, state->measurements, job, storage);
    if (!read) return read.error();
  }
  return state;
}

}  // namespace

Result<std::shared_ptr<const FourierFit>> loadFourierFit(const std::filesystem::path& fitFolder,
                                                         const JobContext& job) {
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  std::optional<Result<std::unique_ptr<FourierFitState>>> state;
  arena.execute([&] { state.emplace(loadState(fitFolder, job)); });
  if (!*state) return state->error();
  return makeFourierFit(std::move(**state));
}

}  // namespace patina
