#include "engine/fourier/solve_sheet.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numeric>

#include "engine/fourier/fit_state.h"
#include "engine/fourier/levels.h"
#include "engine/fourier/tile.h"
#include "engine/fourier/upsample.h"

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
  if (state.diffuse) {
    const std::vector<char> counts = state.diffuse->counts();  // the zero frequency first
    setup.diffuseCounts.assign(counts.begin() + 1, counts.end());
  }
  return setup;
}

namespace {

/// Sites a task: enough to keep the lanes full until the end, few enough to poll for a stop every few milliseconds.
constexpr std::size_t kTile = 256;

/// App. D's lobe (sigma 0.03, gamma 1.03, normal up), then a broad and a sharp one: one start alone leaves
/// some texels in a wrong minimum.
constexpr std::array<float, 3> kStartSigma = {0.03f, 0.1f, 0.01f};
LobeParameters defaultStart(float sigma) {
  return {std::log(sigma), std::log(0.03f), 0, 0};
}

/// Progress of one stage, counted from several threads.
struct Counter {
  std::string_view stage;
  std::int64_t total;
  std::atomic<std::int64_t> done{0};
  void add(const JobContext& job, std::size_t count) {
    job.progress(stage, done += static_cast<std::int64_t>(count), total, "texels");
  }
};

/// Where a site's search begins.
struct Task {
  std::uint32_t site;
  LobeParameters start;
};

class SheetSolver {
 public:
  SheetSolver(FourierFitState& state, const JobContext& job)
      : state_(state), job_(job), setup_(solverSetup(state)), solution_(state.measurements.sites.size()) {}

  void run() {
    if (state_.options.schedule == FitSchedule::Paper) {
      // Only a stop before anything was known fails; the sites are then marked as cancelled.
      static_cast<void>(paperSchedule(state_, setup_, solution_, job_));
    } else {
      start();
      std::vector<Task> tasks(solution_.size());
      for (std::size_t s = 0; s < tasks.size(); ++s)
        tasks[s] = {static_cast<std::uint32_t>(s),
                    hasStart_[s] ? solution_[s].lobe : defaultStart(kStartSigma[0])};
      Counter solving{"solve", static_cast<std::int64_t>(tasks.size())};
      solve(tasks, solving);
      if (state_.options.neighbourRestarts) rescue();
    }
  }

  std::vector<SiteSolution> take() { return std::move(solution_); }
  const std::vector<char>& solved() const { return solved_; }
  std::int64_t iterations() const { return iterations_; }

 private:
  /// Fills `solution_` with the upsampled coarse levels where there are any: the starts, and what a cancelled fit shows
  /// of texels whose turn never came.
  void start() {
    solved_.assign(solution_.size(), 0);
    hasStart_.assign(solution_.size(), 0);
    const Result<LevelSolution> levels = solveLevels(state_, setup_, job_);
    if (!levels) return;  // cancelled
    upsampleToSites(state_, *levels, solution_, job_);
    for (std::size_t s = 0; s < solution_.size(); ++s)
      hasStart_[s] = solution_[s].outcome != SolveOutcome::Failed && std::isfinite(solution_[s].lobe.logSigma);
  }

  /// Runs the tasks and keeps for each site the better of the old and the new solution. The lobe comes from pooled
  /// measurements, the albedos, which vary from pixel to pixel, from each pixel's own.
  void solve(std::span<const Task> tasks, Counter& counter) {
    if (solved_.empty()) solved_.assign(solution_.size(), 0);
    const std::size_t tiles = (tasks.size() + kTile - 1) / kTile;
    tbb::parallel_for(std::size_t{0}, tiles, [&](std::size_t t) {
      if (job_.cancelled()) return;
      const auto part = tasks.subspan(t * kTile, std::min(kTile, tasks.size() - t * kTile));
      std::vector<std::uint32_t> sites;
      std::vector<LobeParameters> starts;
      for (const Task& task : part) sites.push_back(task.site), starts.push_back(task.start);
      const Tile tile(state_, sites, state_.options.poolNeighbours);
      std::vector<SiteSolution> found(part.size());
      solveSites(setup_, tile.data, starts, found);
      refitAlbedos(setup_, tile.own, found);
      std::int64_t iterations = 0;
      for (std::size_t i = 0; i < part.size(); ++i) {
        const auto s = sites[i];
        iterations += found[i].iterations;
        if (found[i].outcome == SolveOutcome::Failed) continue;
        if (!solved_[s] || found[i].cost < solution_[s].cost) solution_[s] = found[i];
        solved_[s] = 1;
      }
      iterations_ += iterations;
      counter.add(job_, part.size());
    });
  }

  void rescue() {
    probe();
    constexpr int kRounds = 6;  // an offer travels one texel a round
    for (int round = 0; round < kRounds && !job_.cancelled(); ++round) {
      const std::vector<Task> tasks = neighbourOffers();
      if (tasks.empty()) break;
      Counter rescuing{"rescue", static_cast<std::int64_t>(tasks.size())};
      solve(tasks, rescuing);
    }
  }

  /// Every start at some of the sites that ended far above what most cost, at those without a solution, and, where sites
  /// are few, at all of them. Where one helps, the neighbours are offered what it found.
  void probe() {
    const SiteSet& set = state_.measurements.sites;
    std::vector<float> costs;
    for (std::size_t s = 0; s < solution_.size(); ++s)
      if (solved_[s]) costs.push_back(solution_[s].cost);
    if (costs.empty()) return;
    std::nth_element(costs.begin(), costs.begin() + static_cast<std::ptrdiff_t>(costs.size() / 2), costs.end());
    constexpr float kPoor = 2;
    constexpr int kLattice = 4;
    const float limit = kPoor * costs[costs.size() / 2];
    std::vector<Task> tasks;
    for (std::size_t s = 0; s < solution_.size(); ++s) {
      const bool onLattice = set.grouped() || (static_cast<int>(set.pixel[s].x()) % kLattice == 0 &&
                                               static_cast<int>(set.pixel[s].y()) % kLattice == 0);
      if (solved_[s] && !(onLattice && solution_[s].cost > limit)) continue;
      for (const float sigma : kStartSigma) {
        LobeParameters start = defaultStart(sigma);
        tasks.push_back({static_cast<std::uint32_t>(s), start});
        if (!solved_[s]) continue;
        // the normal that was found, with another width
        start.slopeX = solution_[s].lobe.slopeX;
        start.slopeY = solution_[s].lobe.slopeY;
        tasks.push_back({static_cast<std::uint32_t>(s), start});
      }
    }
    // One start at a time: two tasks of one tile must not be of the same site.
    std::stable_sort(tasks.begin(), tasks.end(), [](const Task& a, const Task& b) { return a.site < b.site; });
    Counter rescuing{"rescue", static_cast<std::int64_t>(tasks.size())};
    solveGrouped(tasks, rescuing);
  }

  /// As `solve` for tasks sorted by site, several for each: the best start of each site is kept.
  void solveGrouped(std::span<const Task> tasks, Counter& counter) {
    std::vector<std::size_t> border = {0};
    for (std::size_t i = 1; i < tasks.size(); ++i)
      if (tasks[i].site != tasks[i - 1].site && i - border.back() >= kTile) border.push_back(i);
    border.push_back(tasks.size());
    tbb::parallel_for(std::size_t{0}, border.size() - 1, [&](std::size_t t) {
      solve(tasks.subspan(border[t], border[t + 1] - border[t]), counter);
    });
  }

  /// Sites whose neighbour found a much better explanation from elsewhere, and that neighbour's lobe.
  std::vector<Task> neighbourOffers() const {
    const SiteSet& set = state_.measurements.sites;
    std::vector<std::int64_t> best(set.size(), -1);
    tbb::parallel_for(0, set.imageHeight, [&](int y) {
      for (int x = 0; x < set.imageWidth; ++x) {
        const auto here = set.siteOfPixel[static_cast<std::size_t>(y) * set.imageWidth + x];
        if (here < 0 || (set.grouped() && best[here] >= 0)) continue;
        for (const auto& [dx, dy] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
          if (x + dx < 0 || y + dy < 0 || x + dx >= set.imageWidth || y + dy >= set.imageHeight) continue;
          const auto there = set.siteOfPixel[static_cast<std::size_t>(y + dy) * set.imageWidth + x + dx];
          if (there < 0 || there == here || !solved_[there]) continue;
          const SiteSolution& a = solution_[here];
          const SiteSolution& b = solution_[there];
          if (solved_[here] && b.cost > 0.9f * a.cost) continue;
          const bool elsewhere = !solved_[here] || std::abs(a.lobe.logSigma - b.lobe.logSigma) > 0.1f ||
                                 std::abs(a.lobe.slopeX - b.lobe.slopeX) > 0.01f ||
                                 std::abs(a.lobe.slopeY - b.lobe.slopeY) > 0.01f;
          if (elsewhere && (best[here] < 0 || b.cost < solution_[best[here]].cost)) best[here] = there;
        }
      }
    });
    std::vector<Task> offers;
    for (std::size_t s = 0; s < best.size(); ++s)
      if (best[s] >= 0) offers.push_back({static_cast<std::uint32_t>(s), solution_[best[s]].lobe});
    return offers;
  }

  FourierFitState& state_;
  const JobContext& job_;
  const SolverSetup setup_;
  std::vector<SiteSolution> solution_;
  std::vector<char> solved_, hasStart_;
  std::atomic<std::int64_t> iterations_{0};
};

}  // namespace
}  // namespace patina
