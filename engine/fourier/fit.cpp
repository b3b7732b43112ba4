#include "engine/fourier/fit.h"

#include <sys/resource.h>
#include <tbb/info.h>
#include <tbb/task_arena.h>

#include <chrono>
#include <optional>

#include "engine/fourier/fit_state.h"
#include "engine/fourier/solve_sheet.h"

namespace patina {
namespace {

using Clock = std::chrono::steady_clock;

class SecondsOf {
 public:
  SecondsOf(FourierFitStats& stats, std::string stage)
      : stats_(stats), stage_(std::move(stage)), start_(Clock::now()) {}
  ~SecondsOf() { stats_.seconds[stage_] += std::chrono::duration<double>(Clock::now() - start_).count(); }

 private:
  FourierFitStats& stats_;
  std::string stage_;
  Clock::time_point start_;
};

std::size_t peakBytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::size_t>(usage.ru_maxrss) * 1024;
}

Result<std::unique_ptr<FourierFitState>> runFit(const FourierCapture& capture,
                                                const FourierFitOptions& options, const JobContext& job) {
  auto state = std::make_unique<FourierFitState>();
  state->capture = capture;
  state->options = options;
  state->frame = ScreenFrame(capture.screen);
  if (!capture.screen.emission)
    job.warn(
        "the bundle has no screen.emission; the screen is taken to emit evenly in all directions, which "
        "biases albedos");

  {
    SecondsOf timer(state->stats, "read");
    auto plan = planMeasurements(capture, job);
    if (!plan) return plan.error();
    auto sites = makeSites(capture, options.size);
    if (!sites) return sites.error();
    auto measured = measure(capture, std::move(*plan), std::move(*sites), job);
    if (!measured) return measured.error();
    state->measurements = std::move(*measured);
  }
  const FourierMeasurements& m = state->measurements;
  const int mapSize = options.size > 0 ? options.size : resolvedSize(capture, m.sites);
  state->stats.noiseShot = m.noise.shot;
  state->stats.noiseRead = m.noise.read;
  state->stats.clippedSamples = m.clippedSamples;
  {
    SecondsOf timer(state->stats, "geometry");
    std::vector<Eigen::Vector2d> frequencies = {Eigen::Vector2d::Zero()};
    for (const auto& group : m.plan.fitted) frequencies.push_back(group.frequency.cast<double>());
    state->diffuse = std::make_unique<DiffuseTransform>(
        state->frame, Eigen::Vector2d(capture.sampleWidthMm, capture.sampleHeightMm), frequencies,
        state->diffuseMethod());
  }
  {
    SecondsOf timer(state->stats, "solve");
    solveSheet(*state, job);
  }
  if (state->stats.texels == 0) {
    if (job.cancelled())
      return Error{ErrorCode::Cancelled, "the fit was cancelled before any texel was done", "", ""};
    return Error{ErrorCode::Invalid, "no texel could be fitted", capture.folder.string(),
                 "check the calibration in capture.json: screen and camera poses, and that the window "
                 "photograph is lit"};
  }
  {
    SecondsOf timer(state->stats, "maps");
    state->maps = mapsFromSites(*state, mapSize, job);
    for (const float value : state->maps.status.samples())
      ++state->stats.statusCounts[statusName(static_cast<TexelStatus>(static_cast<int>(value)))];
  }
  for (const bool holdout : {false, true}) {
    if (job.cancelled() || (holdout && m.plan.heldOut.empty())) continue;
    SecondsOf timer(state->stats, holdout ? "holdout" : "predict");
    const auto error = photoError(*state, holdout, job);
    if (!error && error.error().code != ErrorCode::Cancelled) return error.error();
    if (!error) break;
    (holdout ? state->stats.holdoutRms : state->stats.fitRms) = error->rms;
    (holdout ? state->stats.noiseFloorHoldout : state->stats.noiseFloorFit) = error->noiseFloor;
  }
  state->stats.cancelled = job.cancelled();
  return state;
}

}  // namespace

FourierFitState::Weights FourierFitState::weights(std::size_t site) const {
  Weights out;
  for (int c = 0; c < 3; ++c) {
    if (options.weights == MeasurementWeights::Noise) {
      out.ac[c] = 1 / measurements.variance(site, c);
      out.dc[c] = 1 / measurements.dcVariance(site, c);
    } else {
      const double w = 160 / measurements.fullScale;  // App. E, for a full scale of 1
      out.ac[c] = out.dc[c] = w * w;
    }
  }
  return out;
}

const char* statusName(TexelStatus status) {
  switch (status) {
    case TexelStatus::NotMeasured:
      return "not measured";
    case TexelStatus::Converged:
      return "converged";
    case TexelStatus::IterationLimit:
      return "iteration limit";
    case TexelStatus::MirrorOffScreen:
      return "mirror point off the screen";
    case TexelStatus::Clipped:
      return "clipped";
    case TexelStatus::Failed:
      return "failed";
    case TexelStatus::Cancelled:
      return "cancelled";
  }
  return "unknown";
}

Result<std::shared_ptr<const FourierFit>> fitFourier(const FourierCapture& capture,
                                                     const FourierFitOptions& options,
                                                     const JobContext& job) {
  const auto problems = options.validate();
  if (!problems.empty()) {
    std::string all;
    for (const auto& problem : problems) all += (all.empty() ? "" : "; ") + problem;
    return Error{ErrorCode::Invalid, all, "fit options", "see --help for ranges"};
  }
  // An arena of our own, so that two fits in one program keep to their own thread counts.
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  std::optional<Result<std::unique_ptr<FourierFitState>>> state;
  const auto start = Clock::now();
  arena.execute([&] { state.emplace(runFit(capture, options, job)); });
  if (!*state) return state->error();
  FourierFitStats& stats = (**state)->stats;
  stats.threads = std::min(arena.max_concurrency(), tbb::info::default_concurrency());
  stats.seconds["total"] = std::chrono::duration<double>(Clock::now() - start).count();
  stats.peakBytes = peakBytes();
  return makeFourierFit(std::move(**state));
}

}  // namespace patina
