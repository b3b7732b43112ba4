#include "engine/fourier/fit.h"

#include <sys/resource.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>
#include <optional>

#include "engine/fourier/fit_state.h"
#include "engine/fourier/tile.h"

namespace patina {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::size_t kTile =
    64;  // sites a task: a whole number of SIMD batches, short enough to poll for a stop

/// App. D's lobe (sigma 0.03, gamma 1.03, normal up), then a broad and a sharp one: one start alone leaves
/// some texels in a wrong minimum.
constexpr std::array<float, 3> kStartSigma = {0.03f, 0.1f, 0.01f};
const float kStartLogKurtosis = std::log(0.03f);

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

SolverSetup makeSetup(const FourierFitState& state) {
  SolverSetup setup;
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < 3; ++j)
      setup.normalRows[k][j] = static_cast<float>(state.frame.screenFromWorld(j, k));
  for (const auto& group : state.measurements.plan.fitted)
    setup.frequency.push_back(group.frequency.cast<float>());
  for (int k = 0; k < 2; ++k) setup.halfExtent[k] = static_cast<float>(state.frame.halfExtent[k]);
  setup.lobe = state.options.lobe;
  // App. E narrows log(gamma - 1) to -1 +- 0.5 and so draws lobes near gamma = 1 to 1.3, and their width and
  // albedo with them by 15 %; with noise weights the data can be left to speak. The paper's own weights keep
  // the paper's own prior.
  if (state.options.weights == MeasurementWeights::Noise) setup.priors.logKurtosisSigma = 1.0f;
  setup.maxIterations = state.options.maxIterations;
  setup.tolerance = static_cast<float>(state.options.tolerance);
  return setup;
}

struct SolveState {
  std::vector<SiteSolution> solution;
  std::vector<char> solved;
  std::atomic<std::int64_t> iterations{0};
};

/// Progress of one stage, counted from several threads.
struct Counter {
  std::string_view stage;
  std::int64_t total;
  std::atomic<std::int64_t> done{0};
  void add(const JobContext& job, std::size_t count) {
    job.progress(stage, done += static_cast<std::int64_t>(count), total, "texels");
  }
};

/// Runs every listed site from a start that `startOf(site)` gives; keeps the better of the old and the new
/// solution.
template <typename StartOf>
void solveFrom(const FourierFitState& state, const SolverSetup& setup, std::span<const std::uint32_t> sites,
               StartOf startOf, SolveState& solve, const JobContext& job, Counter& counter) {
  const std::size_t tiles = (sites.size() + kTile - 1) / kTile;
  tbb::parallel_for(std::size_t{0}, tiles, [&](std::size_t t) {
    if (job.cancelled()) return;
    const auto part = sites.subspan(t * kTile, std::min(kTile, sites.size() - t * kTile));
    const Tile tile(state, part, state.options.poolNeighbours);
    std::vector<LobeParameters> start;
    for (const auto s : part) start.push_back(startOf(s));
    std::vector<SiteSolution> found(part.size());
    solveSites(setup, tile.data, start, found);
    std::int64_t iterations = 0;
    for (std::size_t i = 0; i < part.size(); ++i) {
      const auto s = part[i];
      iterations += found[i].iterations;
      const bool usable = found[i].outcome != SolveOutcome::Failed;
      if (usable && (!solve.solved[s] || found[i].cost < solve.solution[s].cost))
        solve.solution[s] = found[i];
      if (usable) solve.solved[s] = 1;
    }
    solve.iterations += iterations;
    counter.add(job, part.size());
  });
}

/// Sites whose neighbour found a much better explanation from elsewhere, and that neighbour's lobe.
std::vector<std::pair<std::uint32_t, LobeParameters>> neighbourOffers(const FourierFitState& state,
                                                                      const SolveState& solve) {
  const SiteSet& set = state.measurements.sites;
  std::vector<std::int64_t> best(set.size(), -1);
  for (int y = 0; y < set.imageHeight; ++y) {
    for (int x = 0; x < set.imageWidth; ++x) {
      const auto here = set.siteOfPixel[static_cast<std::size_t>(y) * set.imageWidth + x];
      if (here < 0 || !solve.solved[here]) continue;
      for (const auto& [dx, dy] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
        if (x + dx < 0 || y + dy < 0 || x + dx >= set.imageWidth || y + dy >= set.imageHeight) continue;
        const auto there = set.siteOfPixel[static_cast<std::size_t>(y + dy) * set.imageWidth + x + dx];
        if (there < 0 || there == here || !solve.solved[there]) continue;
        const SiteSolution& a = solve.solution[here];
        const SiteSolution& b = solve.solution[there];
        if (b.cost > 0.9f * a.cost) continue;
        const bool elsewhere = std::abs(a.lobe.logSigma - b.lobe.logSigma) > 0.1f ||
                               std::abs(a.lobe.slopeX - b.lobe.slopeX) > 0.01f ||
                               std::abs(a.lobe.slopeY - b.lobe.slopeY) > 0.01f;
        if (elsewhere && (best[here] < 0 || b.cost < solve.solution[best[here]].cost)) best[here] = there;
      }
    }
  }
  std::vector<std::pair<std::uint32_t, LobeParameters>> offers;
  for (std::size_t s = 0; s < best.size(); ++s)
    if (best[s] >= 0) offers.emplace_back(static_cast<std::uint32_t>(s), solve.solution[best[s]].lobe);
  return offers;
}

/// Pooled measurements gave lobes; albedos, which vary from pixel to pixel, follow from each pixel's own
/// measurements (they are linear given the lobe: no iteration). Texture finer than the pool is kept.
void ownAlbedos(const FourierFitState& state, SolverSetup setup, SolveState& solve, const JobContext& job) {
  setup.maxIterations = 0;
  const std::size_t count = solve.solution.size();
  Counter counter{"albedos", static_cast<std::int64_t>(count)};
  tbb::parallel_for(std::size_t{0}, (count + kTile - 1) / kTile, [&](std::size_t t) {
    std::vector<std::uint32_t> part;
    std::vector<LobeParameters> start;
    for (std::size_t s = t * kTile; s < std::min(count, (t + 1) * kTile); ++s) {
      if (!solve.solved[s]) continue;
      part.push_back(static_cast<std::uint32_t>(s));
      start.push_back(solve.solution[s].lobe);
    }
    const Tile tile(state, part, false);
    std::vector<SiteSolution> own(part.size());
    solveSites(setup, tile.data, start, own);
    for (std::size_t i = 0; i < part.size(); ++i) {
      SiteSolution& solution = solve.solution[part[i]];
      if (!std::isfinite(own[i].cost)) continue;
      std::ranges::copy(own[i].diffuse, solution.diffuse);
      std::ranges::copy(own[i].specular, solution.specular);
      solution.dataCost = own[i].dataCost;
    }
    counter.add(job, part.size());
  });
}

/// Sum of a site's squared measurements in units of their weights: what a residual is relative to.
double weightedEnergy(const FourierFitState& state, std::size_t site) {
  const FourierMeasurements& m = state.measurements;
  const FourierFitState::Weights weights = state.weights(site);
  const float* z = m.z.data() + site * m.frequencyCount() * 6;
  double energy = 0;
  for (int c = 0; c < 3; ++c) {
    energy += weights.dc[c] * m.dc[site * 3 + c] * m.dc[site * 3 + c];
    for (int f = 0; f < m.frequencyCount(); ++f)
      energy += weights.ac[c] * (z[f * 6 + c] * z[f * 6 + c] + z[f * 6 + 3 + c] * z[f * 6 + 3 + c]);
  }
  return energy;
}

void solveAll(FourierFitState& state, const JobContext& job) {
  const std::size_t count = state.measurements.sites.size();
  const SolverSetup setup = makeSetup(state);
  SolveState solve;
  solve.solution.resize(count);
  solve.solved.assign(count, 0);
  std::vector<std::uint32_t> all(count);
  std::iota(all.begin(), all.end(), 0u);
  // Every start over the whole sheet, one after the other: a cancelled fit leaves a whole picture behind
  // early.
  Counter solving{"solve", static_cast<std::int64_t>(count * kStartSigma.size())};
  for (const float sigma : kStartSigma) {
    const LobeParameters start{std::log(sigma), kStartLogKurtosis, 0, 0};
    solveFrom(
        state, setup, all, [&](std::uint32_t) { return start; }, solve, job, solving);
  }
  constexpr int kRounds = 4;  // an offer travels one texel a round
  for (int round = 0; state.options.neighbourRestarts && round < kRounds && !job.cancelled(); ++round) {
    const auto offers = neighbourOffers(state, solve);
    if (offers.empty()) break;
    std::vector<std::uint32_t> sites;
    std::vector<LobeParameters> starts(count);
    for (const auto& [site, lobe] : offers) sites.push_back(site), starts[site] = lobe;
    Counter rescuing{"rescue", static_cast<std::int64_t>(sites.size())};
    solveFrom(
        state, setup, sites, [&](std::uint32_t s) { return starts[s]; }, solve, job, rescuing);
  }
  if (state.options.poolNeighbours)
    ownAlbedos(state, setup, solve, job);  // quick; a cancelled fit has them too

  state.sites.resize(count);
  state.siteStatus.assign(count, TexelStatus::Cancelled);
  state.siteResidual.assign(count, 0);
  std::size_t solvedCount = 0;
  for (std::size_t s = 0; s < count; ++s) {
    SvbrdfParameters& p = state.sites[s];
    const SiteSolution& found = solve.solution[s];
    if (!solve.solved[s]) {
      state.siteStatus[s] = job.cancelled() ? TexelStatus::Cancelled : TexelStatus::Failed;
      p.sigma = kStartSigma[0];
      p.kurtosis = 1.03f;
      continue;
    }
    ++solvedCount;
    p.sigma = std::exp(found.lobe.logSigma);
    p.kurtosis = 1 + std::exp(found.lobe.logKurtosis);
    p.normal = Eigen::Vector3f(found.lobe.slopeX, found.lobe.slopeY, 1).normalized();
    for (int c = 0; c < 3; ++c) p.diffuse[c] = found.diffuse[c], p.specular[c] = found.specular[c];
    const double energy = weightedEnergy(state, s);
    state.siteResidual[s] = energy > 0 ? static_cast<float>(std::sqrt(found.dataCost / energy)) : 0.0f;
    const Eigen::Vector2f mirror = mirrorOnScreen(state.frame, state.geometry(s), p.normal);
    const bool off = std::abs(mirror.x()) > state.frame.halfExtent.x() ||
                     std::abs(mirror.y()) > state.frame.halfExtent.y();
    state.siteStatus[s] = state.measurements.clippedFraction[s] > 0       ? TexelStatus::Clipped
                          : off                                           ? TexelStatus::MirrorOffScreen
                          : found.outcome == SolveOutcome::IterationLimit ? TexelStatus::IterationLimit
                                                                          : TexelStatus::Converged;
  }
  state.stats.texels = solvedCount;
  state.stats.meanIterations =
      solvedCount ? static_cast<double>(solve.iterations) / static_cast<double>(solvedCount) : 0;
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
    solveAll(*state, job);
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
