#include "engine/fourier/fit.h"

#include <sys/resource.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <iterator>
#include <optional>

#include "engine/base/cache_folder.h"
#include "engine/fourier/emission_expansion.h"
#include "engine/fourier/fit_state.h"
#include "engine/fourier/levels.h"
#include "engine/fourier/solve_sheet.h"

namespace patina {
namespace {

using Clock = std::chrono::steady_clock;

/// The lobe that stands for all of a sheet that isn't solved yet.
constexpr float kFlatSheetSigma = 0.1f;

std::size_t peakBytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::size_t>(usage.ru_maxrss) * 1024;
}

/// Bytes that everything but the store takes. Measured arrays, solutions and what works on them; maps with
/// what writing them takes; the image's table of sites.
std::uint64_t arrayBytes(std::size_t sites, std::size_t texels, std::size_t pixels) {
  constexpr std::uint64_t kMeasured = 160, kTexel = 120, kPixel = 13;
  constexpr std::uint64_t kSolved = 2 * sizeof(SiteSolution) + sizeof(SvbrdfParameters) + 64;
  return sites * (kMeasured + kSolved) + texels * kTexel + pixels * kPixel;
}

/// The sites, grouped where single pixels would take more than the memory limit; `size` becomes that of the
/// maps then.
Result<SiteSet> sitesWithinMemory(const FourierCapture& capture, const FourierFitOptions& options,
                                  const MeasurementPlan& plan, const JobContext& job, FourierFitStats& stats,
                                  int& size) {
  auto sites = makeSites(capture, size);
  if (!sites) return sites;
  const double longest = std::max(capture.sampleWidthMm, capture.sampleHeightMm);
  const double aspect = std::min(capture.sampleWidthMm, capture.sampleHeightMm) / longest;
  const std::size_t pixels = sites->siteOfPixel.size();
  const int finest = resolvedSize(capture, *sites);
  const auto needed = [&](std::size_t count, int longestTexels) {
    const auto texels = static_cast<std::size_t>(static_cast<double>(longestTexels) * longestTexels * aspect);
    const std::uint64_t store = MeasurementStore::bytesFor(count, static_cast<int>(plan.fitted.size()));
    const std::uint64_t limit = options.memoryLimitBytes;
    const std::uint64_t grid = options.schedule == FitSchedule::Paper
                                   ? paperScheduleBytes(std::min(longestTexels, finest), aspect,
                                                        static_cast<int>(plan.fitted.size()))
                                   : 0;
    return grid + arrayBytes(count, texels, pixels) + (store <= limit / 2 ? store : 0) + limit / 8;
  };
  const int wanted = size > 0 ? size : finest;
  if (needed(sites->size(), wanted) <= options.memoryLimitBytes) return sites;
  // Twice the pixels' pitch at least: below, groups would hold one pixel or none. Then halved until it fits.
  int coarser = std::min(wanted, finest / 2);
  for (; coarser >= 1; coarser = coarser * 7 / 8) {
    const auto count = static_cast<std::size_t>(static_cast<double>(coarser) * coarser * aspect) + 1;
    if (needed(count, coarser) > options.memoryLimitBytes) continue;
    auto grouped = makeSites(capture, coarser);
    if (!grouped) return grouped;
    if (!grouped->grouped() || needed(grouped->size(), coarser) > options.memoryLimitBytes) continue;
    job.warn("the " + std::to_string(sites->size()) +
             " pixels of the sample would take more than the memory limit of " +
             std::to_string(options.memoryLimitBytes >> 20) + " MiB; they are averaged to " +
             std::to_string(grouped->size()) + " points, and the maps have " + std::to_string(coarser) +
             " texels on their longest side. Raise the limit (--memory) for finer maps");
    stats.coarserSites = true;
    size = coarser;
    return grouped;
  }
  return Error{ErrorCode::Invalid,
               "the photographs are too large for the memory limit of " +
                   std::to_string(options.memoryLimitBytes >> 20) + " MiB",
               "fit options", "raise the limit (--memory)"};
}

/// Every problem with corrections, one sentence each.
std::vector<std::string> problemsOf(const FourierCorrections& corrections, LobeMapping mapping) {
  std::vector<std::string> problems;
  constexpr float kSmallestDeterminant = 1e-3f;
  if (!corrections.unmix.allFinite() || !(std::abs(corrections.unmix.determinant()) > kSmallestDeterminant))
    problems.push_back("corrections.unmix can't be inverted");
  if (!std::ranges::all_of(corrections.photoGain, [](float g) { return g > 0 && std::isfinite(g); }))
    problems.push_back("every corrections.photoGain must be positive");
  if (!std::ranges::all_of(corrections.photoOffset, [](const auto& o) { return o.isFinite().all(); }))
    problems.push_back("every corrections.photoOffset must be finite");
  if (!(corrections.saturation >= 0)) problems.push_back("corrections.saturation must not be negative");
  if (corrections.lobeTerms && mapping != LobeMapping::ExactMoments)
    problems.push_back("corrections.lobeTerms need the exact mapping of the lobe");
  constexpr float kMostStretch = 5;  // a ratio of 150
  const auto possible = [](const LobeTerms& t) {
    return std::hypot(t.stretch[0], t.stretch[1]) < kMostStretch && t.thirdShare >= 0 && t.thirdShare < 1 &&
           t.thirdRatio > 0 && std::isfinite(t.thirdRatio);
  };
  if (corrections.lobeTerms && !std::ranges::all_of(*corrections.lobeTerms, possible))
    problems.push_back("corrections.lobeTerms must be finite, with a third Gaussian's share in 0..1");
  return problems;
}

/// Solves the sheet, from the corrections' solutions where they have one for each site.
void solveFrom(FourierFitState& state, const FourierCorrections* corrections, const JobContext& job) {
  std::span<const SvbrdfParameters> start;
  if (corrections && corrections->sites && corrections->sites->size() == state.measurements.sites.size())
    start = *corrections->sites;
  const auto expand = [&](std::span<const SvbrdfParameters> solutions) {
    if (!state.frame.logEmission) return;
    const StageClock timer(state.stats, "geometry");
    state.expandEmissions(solutions);
  };
  expand(start);
  solveSheet(state, job, start);  // stages "levels" and "solve"
  // Without solutions to begin with, emission was expanded where a flat sheet mirrors it: once more, now that
  // there are some.
  if (state.frame.logEmission && start.empty() && !job.cancelled()) {
    const std::vector<SvbrdfParameters> found = state.sites;
    expand(found);
    solveSheet(state, job, found);
  }
  expand(state.sites);  // predictions are made where the lobes are now
}

Result<std::unique_ptr<FourierFitState>> runFit(const FourierCapture& capture,
                                                const FourierFitOptions& options, const JobContext& job,
                                                const FourierFitStorage& storage) {
  auto state = std::make_unique<FourierFitState>();
  state->capture = capture;
  state->options = options;
  state->frame = ScreenFrame(capture.screen);
  const FourierCorrections* corrections = options.corrections.get();
  if (corrections) {
    state->frame.logEmission = corrections->logEmission;
    state->shape = {corrections->heightMm, capture.camera.positionMm()};
  }
  if (!capture.screen.emission)
    job.warn(
        "the bundle has no screen.emission; the screen is taken to emit evenly in all directions, which "
        "biases albedos");

  const MeasurementStorage measurementStorage{options.memoryLimitBytes, storage.scratchFolder};
  int siteSize = options.size;
  {
    const StageClock timer(state->stats, "read");
    auto plan = planMeasurements(capture, job);
    if (!plan) return plan.error();
    auto sites = sitesWithinMemory(capture, options, *plan, job, state->stats, siteSize);
    if (!sites) return sites.error();
    auto measured =
        measure(capture, std::move(*plan), std::move(*sites), job, measurementStorage, corrections);
    if (!measured) return measured.error();
    state->measurements = std::move(*measured);
  }
  const FourierMeasurements& m = state->measurements;
  if (corrections && corrections->lobeTerms) {
    state->lobeTerms = corrections->lobeTerms;
    if (state->lobeTerms->size() != 1 && state->lobeTerms->size() != m.sites.size())
      return Error{ErrorCode::Invalid, "corrections.lobeTerms must have one element, or one for each site",
                   "fit options", ""};
  }
  const int mapSize = siteSize > 0 ? siteSize : resolvedSize(capture, m.sites);
  state->stats.noiseShot = m.noise.shot;
  state->stats.noiseRead = m.noise.read;
  state->stats.clippedSamples = m.clippedSamples;
  state->stats.droppedRows = m.store.droppedRowCount();
  state->stats.clippedSites =
      static_cast<std::size_t>(std::count(m.clipped.begin(), m.clipped.end(), std::uint8_t{1}));
  state->stats.measurementsOnDisk = !m.store.inMemory();
  // What acts on the capture is not in a fingerprint: such a fit keeps nothing, and takes nothing over.
  if (!storage.keepFolder.empty() && !corrections) {
    auto finished = FinishedTiles::open(storage.keepFolder, fitFingerprint(capture, options, m.sites.size()));
    if (finished) {
      state->finished = std::move(*finished);
    } else {
      job.warn("a fit that is stopped can't be resumed: " + finished.error().sentence());
    }
  }
  {
    const StageClock timer(state->stats, "geometry");
    state->makeDiffuse();
  }
  solveFrom(*state, corrections, job);
  if (const auto failure = m.store.failure()) return *failure;
  const auto notKept = state->finished.failure();
  state->finished = {};  // lets go of the file: the next fit may want it while this one is looked at
  if (notKept) {
    job.warn("a fit that is stopped now starts over: " + notKept->sentence());
    removeUnfinished(storage.keepFolder);
  }
  if (state->stats.texels == 0) {
    if (job.cancelled())
      return Error{ErrorCode::Cancelled, "the fit was cancelled before any texel was done", "", ""};
    return Error{ErrorCode::Invalid, "no texel could be fitted", capture.folder.string(),
                 "check the calibration in capture.json: screen and camera poses, and that the window "
                 "photograph is lit"};
  }
  {
    const StageClock timer(state->stats, "maps");
    state->maps = mapsFromSites(*state, mapSize, job);
    for (const float value : state->maps.status.samples())
      ++state->stats.statusCounts[statusName(static_cast<TexelStatus>(static_cast<int>(value)))];
  }
  for (const bool holdout : {false, true}) {
    if (job.cancelled() || (holdout && m.plan.heldOut.empty())) continue;
    const StageClock timer(state->stats, holdout ? "holdout" : "predict");
    const auto error = photoError(*state, holdout, job, measurementStorage);
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

void FourierFitState::makeDiffuse() {
  std::vector<Eigen::Vector2d> frequencies = {Eigen::Vector2d::Zero()};
  for (const auto& group : measurements.plan.fitted) frequencies.push_back(group.frequency.cast<double>());
  diffuse = std::make_unique<DiffuseTransform>(frame,
                                               Eigen::Vector2d(capture.sampleWidthMm, capture.sampleHeightMm),
                                               frequencies, diffuseMethod(), shape);
}

void FourierFitState::expandEmissions(std::span<const SvbrdfParameters> solutions) {
  emission.clear();
  if (!frame.logEmission) return;
  std::vector<EmissionExpansion> all(measurements.sites.size());
  SvbrdfParameters flat;
  flat.sigma = kFlatSheetSigma;
  tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t s) {
    all[s] = expandEmission(frame, geometry(s), s < solutions.size() ? solutions[s] : flat, options.lobe);
  });
  emission = std::move(all);
}

SiteGeometry FourierFitState::geometry(const Eigen::Vector2d& pointMm) const {
  const Eigen::Vector3d point = shape.pointMm(pointMm), cameraMm = capture.camera.positionMm();
  SiteGeometry out = siteGeometry(frame, point, cameraMm);
  if (frame.logEmission) {
    SvbrdfParameters flat;
    flat.sigma = kFlatSheetSigma;
    const EmissionExpansion expansion = expandEmission(frame, out, flat, options.lobe);
    out = siteGeometry(frame, point, cameraMm, &expansion);
  }
  if (lobeTerms && lobeTerms->size() == 1) out.lobe = lobeTerms->front();
  return out;
}

LobeVariant FourierFitState::lobeVariant() const {
  LobeVariant variant;
  variant.skewedLight = !emission.empty() && options.lobe == LobeMapping::ExactMoments;
  if (lobeTerms) {
    variant.stretched = std::ranges::any_of(*lobeTerms, &LobeTerms::stretched);
    variant.third = std::ranges::any_of(*lobeTerms, [](const LobeTerms& t) { return t.thirdShare > 0; });
  }
  return variant;
}

void removeUnfinished(const std::filesystem::path& keepFolder) {
  if (keepFolder.empty()) return;
  std::error_code code;
  std::filesystem::remove(keepFolder / FinishedTiles::kFileName, code);
  std::filesystem::remove(keepFolder, code);  // only if nothing else lies in it
}

std::filesystem::path unfinishedInCache(const FourierCapture& capture) {
  const std::filesystem::path cache = cacheFolder();
  if (cache.empty()) return {};
  std::error_code code;
  const auto bundle = std::filesystem::weakly_canonical(capture.folder, code).string();
  return cache / "unfinished" / std::to_string(std::hash<std::string>{}(bundle));
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
                                                     const FourierFitOptions& options, const JobContext& job,
                                                     const FourierFitStorage& storage) {
  auto problems = options.validate();
  if (options.corrections)
    std::ranges::copy(problemsOf(*options.corrections, options.lobe), std::back_inserter(problems));
  if (!problems.empty()) {
    std::string all;
    for (const auto& problem : problems) all += (all.empty() ? "" : "; ") + problem;
    return Error{ErrorCode::Invalid, all, "fit options", "see --help for ranges"};
  }
  // An arena of our own, so that two fits in one program keep to their own thread counts.
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  std::optional<Result<std::unique_ptr<FourierFitState>>> state;
  const auto start = Clock::now();
  arena.execute([&] { state.emplace(runFit(capture, options, job, storage)); });
  if (!*state) return state->error();
  FourierFitStats& stats = (**state)->stats;
  stats.threads = std::min(arena.max_concurrency(), tbb::info::default_concurrency());
  stats.seconds["total"] = std::chrono::duration<double>(Clock::now() - start).count();
  stats.peakBytes = peakBytes();
  return makeFourierFit(std::move(**state));
}

}  // namespace patina
