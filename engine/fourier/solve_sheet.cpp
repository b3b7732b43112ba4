#include "engine/fourier/solve_sheet.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numeric>

#include "engine/fourier/fit_state.h"
#include "engine/fourier/tile.h"

namespace patina {

SolverSetup solverSetup(const FourierFitState& state) {
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

namespace {

constexpr std::size_t kTile =
    64;  // sites a task: a whole number of SIMD batches, short enough to poll for a stop

/// App. D's lobe (sigma 0.03, gamma 1.03, normal up), then a broad and a sharp one: one start alone leaves
/// some texels in a wrong minimum.
constexpr std::array<float, 3> kStartSigma = {0.03f, 0.1f, 0.01f};
const float kStartLogKurtosis = std::log(0.03f);

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

}  // namespace

void solveSheet(FourierFitState& state, const JobContext& job) {
  const std::size_t count = state.measurements.sites.size();
  const SolverSetup setup = solverSetup(state);
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

}  // namespace patina
