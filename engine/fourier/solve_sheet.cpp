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
  setup.variant = state.lobeVariant();
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

/// Sites a task: enough to keep the lanes full until the end, few enough to poll for a stop every few
/// milliseconds.
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
      : state_(state),
        job_(job),
        setup_(solverSetup(state)),
        solution_(state.measurements.sites.size()),
        solved_(solution_.size(), 0),
        hasStart_(solution_.size(), 0),
        changed_(solution_.size(), 0) {}

  void run(std::span<const SvbrdfParameters> known) {
    if (state_.options.schedule == FitSchedule::Paper) {
      const StageClock clock(state_.stats, "solve");
      // Only a stop before anything was known fails; the sites are then marked as cancelled.
      static_cast<void>(paperSchedule(state_, setup_, solution_, job_));
      for (std::size_t s = 0; s < solution_.size(); ++s) {
        solved_[s] = solution_[s].outcome != SolveOutcome::Failed;
        iterations_ += solution_[s].iterations;
      }
    } else {
      {
        const StageClock clock(state_.stats, "levels");
        if (known.size() == solution_.size()) {
          startFrom(known);
        } else {
          start();
        }
      }
      const StageClock clock(state_.stats, "solve");
      Counter solving{"solve", static_cast<std::int64_t>(solution_.size())};
      solveAll(solving);
      if (state_.options.neighbourRestarts) rescue();
    }
  }

  std::vector<SiteSolution> take() { return std::move(solution_); }
  const std::vector<char>& solved() const { return solved_; }
  std::int64_t iterations() const { return iterations_; }
  std::size_t resumed() const { return resumed_; }

 private:
  /// Fills `solution_` with the upsampled coarse levels where there are any: the starts, and what a cancelled
  /// fit shows of texels whose turn never came.
  void start() {
    const Result<LevelSolution> levels = solveLevels(state_, setup_, job_);
    if (!levels)
      return;  // a stop; or the scratch file's failure, which the fit asks the store for at the end
    upsampleToSites(state_, *levels, solution_, job_);
    for (std::size_t s = 0; s < solution_.size(); ++s)
      hasStart_[s] =
          solution_[s].outcome != SolveOutcome::Failed && std::isfinite(solution_[s].lobe.logSigma);
  }

  /// As `start`, from solutions that are known already.
  void startFrom(std::span<const SvbrdfParameters> known) {
    constexpr float kSmallestExcess = 1e-3f;  // of gamma over 1: its logarithm is what is solved for
    for (std::size_t s = 0; s < solution_.size(); ++s) {
      const SvbrdfParameters& p = known[s];
      SiteSolution& to = solution_[s];
      to.lobe = {std::log(p.sigma), std::log(std::max(p.kurtosis - 1, kSmallestExcess)),
                 p.normal.x() / p.normal.z(), p.normal.y() / p.normal.z()};
      for (int c = 0; c < 3; ++c) to.diffuse[c] = p.diffuse[c], to.specular[c] = p.specular[c];
      hasStart_[s] = std::isfinite(to.lobe.logSigma) && std::isfinite(to.lobe.logKurtosis) &&
                     std::isfinite(to.lobe.slopeX) && std::isfinite(to.lobe.slopeY);
      if (hasStart_[s]) to.outcome = SolveOutcome::IterationLimit;
    }
  }

  /// Every site once, run by run; runs that an earlier, unfinished fit left are taken over, the others kept
  /// for the next.
  void solveAll(Counter& counter) {
    constexpr int kStage = 0;
    const std::size_t count = solution_.size();
    tbb::parallel_for(std::size_t{0}, (count + kTile - 1) / kTile, [&](std::size_t t) {
      const SiteRun run{t * kTile, std::min(kTile, count - t * kTile)};
      const std::span<SiteSolution> part(solution_.data() + run.first, run.count);
      if (state_.finished.load(kStage, run, part)) {
        for (std::size_t i = 0; i < run.count; ++i)
          solved_[run.first + i] = changed_[run.first + i] = part[i].outcome != SolveOutcome::Failed;
        resumed_ += run.count;
        counter.add(job_, run.count);
        return;
      }
      std::vector<Task> tasks;
      for (std::size_t s = run.first; s < run.end(); ++s)
        tasks.push_back(
            {static_cast<std::uint32_t>(s), hasStart_[s] ? solution_[s].lobe : defaultStart(kStartSigma[0])});
      if (!solveTile(tasks, counter)) return;
      for (std::size_t i = 0; i < run.count; ++i)
        if (!solved_[run.first + i]) part[i].outcome = SolveOutcome::Failed;
      state_.finished.save(kStage, run, part);
    });
  }

  /// Runs the tasks and keeps for each site the better of the old and the new solution. The lobe comes from
  /// pooled measurements, the albedos, which vary from pixel to pixel, from each pixel's own.
  void solve(std::span<const Task> tasks, Counter& counter) {
    const std::size_t tiles = (tasks.size() + kTile - 1) / kTile;
    tbb::parallel_for(std::size_t{0}, tiles, [&](std::size_t t) {
      solveTile(tasks.subspan(t * kTile, std::min(kTile, tasks.size() - t * kTile)), counter);
    });
  }

  /// False where a stop came first.
  bool solveTile(std::span<const Task> tasks, Counter& counter) {
    if (job_.cancelled()) return false;
    std::vector<std::uint32_t> sites;
    std::vector<LobeParameters> starts;
    for (const Task& task : tasks) sites.push_back(task.site), starts.push_back(task.start);
    const Tile tile(state_, sites, state_.options.poolNeighbours);
    std::vector<SiteSolution> found(tasks.size());
    solveSites(setup_, tile.data, starts, found);
    refitAlbedos(setup_, tile.own, found);
    std::int64_t iterations = 0;
    for (std::size_t i = 0; i < tasks.size(); ++i) {
      const auto s = sites[i];
      iterations += found[i].iterations;
      if (found[i].outcome == SolveOutcome::Failed) continue;
      if (solved_[s] && !(found[i].cost < solution_[s].cost)) continue;
      solution_[s] = found[i];
      solved_[s] = changed_[s] = 1;
    }
    iterations_ += iterations;
    counter.add(job_, tasks.size());
    return true;
  }

  void rescue() {
    probe();
    constexpr int kRounds = 6;  // an offer travels one texel a round
    for (int round = 0; round < kRounds && !job_.cancelled(); ++round) {
      const std::vector<Task> tasks = neighbourOffers();
      if (tasks.empty()) break;
      std::fill(changed_.begin(), changed_.end(), 0);
      Counter rescuing{"rescue", static_cast<std::int64_t>(tasks.size())};
      solve(tasks, rescuing);
    }
  }

  /// Every start at some of the sites that ended far above what most cost, at those without a solution, and,
  /// where sites are few, at all of them. Where one helps, the neighbours are offered what it found.
  void probe() {
    const SiteSet& set = state_.measurements.sites;
    std::vector<float> costs;
    for (std::size_t s = 0; s < solution_.size(); ++s)
      if (solved_[s]) costs.push_back(solution_[s].cost);
    if (costs.empty()) return;
    std::nth_element(costs.begin(), costs.begin() + static_cast<std::ptrdiff_t>(costs.size() / 2),
                     costs.end());
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
      solveTile(tasks.subspan(border[t], border[t + 1] - border[t]), counter);
    });
  }

  /// Sites whose neighbour found a better explanation elsewhere since the last round, better by more than
  /// noise would make it, and that neighbour's lobe.
  std::vector<Task> neighbourOffers() const {
    const SiteSet& set = state_.measurements.sites;
    const float spread =
        std::sqrt(6.0f * static_cast<float>(2 * setup_.frequency.size() + 1));  // of a chi-square
    const float byChance = state_.options.weights == MeasurementWeights::Noise ? spread : 0;
    constexpr std::uint32_t kNone = ~std::uint32_t{0};
    std::vector<std::uint32_t> best(set.size(), kNone);
    // Serial: a group's pixels lie in several rows, and this is a few milliseconds for a million sites.
    for (int y = 0; y < set.imageHeight; ++y) {
      for (int x = 0; x < set.imageWidth; ++x) {
        const auto here = set.siteOfPixel[static_cast<std::size_t>(y) * set.imageWidth + x];
        if (here < 0) continue;
        for (const auto& [dx, dy] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
          if (x + dx < 0 || y + dy < 0 || x + dx >= set.imageWidth || y + dy >= set.imageHeight) continue;
          const auto there = set.siteOfPixel[static_cast<std::size_t>(y + dy) * set.imageWidth + x + dx];
          if (there < 0 || there == here || !solved_[there] || !changed_[there]) continue;
          const SiteSolution& a = solution_[here];
          const SiteSolution& b = solution_[there];
          if (solved_[here] && a.cost - b.cost < std::max(0.1f * a.cost, byChance)) continue;
          const bool elsewhere = !solved_[here] || std::abs(a.lobe.logSigma - b.lobe.logSigma) > 0.1f ||
                                 std::abs(a.lobe.slopeX - b.lobe.slopeX) > 0.01f ||
                                 std::abs(a.lobe.slopeY - b.lobe.slopeY) > 0.01f;
          if (elsewhere && (best[here] == kNone || b.cost < solution_[best[here]].cost))
            best[here] = static_cast<std::uint32_t>(there);
        }
      }
    }
    std::vector<Task> offers;
    for (std::size_t s = 0; s < best.size(); ++s)
      if (best[s] != kNone) offers.push_back({static_cast<std::uint32_t>(s), solution_[best[s]].lobe});
    return offers;
  }

  FourierFitState& state_;
  const JobContext& job_;
  const SolverSetup setup_;
  std::vector<SiteSolution> solution_;
  std::vector<char> solved_, hasStart_, changed_;
  std::atomic<std::int64_t> iterations_{0};
  std::atomic<std::size_t> resumed_{0};
};

/// Sum of a site's squared measurements in units of their weights: what a residual is relative to.
double weightedEnergy(const FourierFitState& state, const float* z, std::size_t site) {
  const FourierMeasurements& m = state.measurements;
  const FourierFitState::Weights weights = state.weights(site);
  const auto dropped = m.droppedRows(site);
  double energy = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    energy += weights.dc[c] * m.dc[site * 3 + c] * m.dc[site * 3 + c];
    double sum = 0;
    for (std::size_t row = 0; row < 2 * static_cast<std::size_t>(m.frequencyCount()); ++row) {
      if (!dropped.empty() && std::binary_search(dropped.begin(), dropped.end(), row)) continue;
      sum += static_cast<double>(z[row * 3 + c]) * z[row * 3 + c];
    }
    energy += weights.ac[c] * sum;
  }
  return energy;
}

SiteUncertainty uncertaintyOf(const SiteSolution& found) {
  SiteUncertainty sd;
  auto root = [](float variance) { return std::sqrt(std::max(variance, 0.0f)); };
  for (int c = 0; c < 3; ++c) sd.diffuse[c] = found.diffuseSd[c], sd.specular[c] = found.specularSd[c];
  // upper triangle, row by row: 0, 4, 7 and 9 are the diagonal
  sd.sigma = std::exp(found.lobe.logSigma) * root(found.lobeCovariance[0]);
  sd.kurtosis = std::exp(found.lobe.logKurtosis) * root(found.lobeCovariance[4]);
  sd.normal = {root(found.lobeCovariance[7]), root(found.lobeCovariance[9])};
  return sd;
}

void fillSite(FourierFitState& state, std::size_t s, const SiteSolution& found, bool solved, bool cancelled,
              const float* z) {
  SvbrdfParameters& p = state.sites[s];
  // A site whose turn never came shows the coarse solution, if there was one.
  const bool known = std::isfinite(found.lobe.logSigma) && found.outcome != SolveOutcome::Failed;
  if (solved || known) {
    p.sigma = std::exp(found.lobe.logSigma);
    p.kurtosis = 1 + std::exp(found.lobe.logKurtosis);
    p.normal = Eigen::Vector3f(found.lobe.slopeX, found.lobe.slopeY, 1).normalized();
    for (int c = 0; c < 3; ++c) p.diffuse[c] = found.diffuse[c], p.specular[c] = found.specular[c];
  } else {
    p.sigma = kStartSigma[0];
    p.kurtosis = 1.03f;
  }
  if (!solved) {
    state.siteStatus[s] = cancelled ? TexelStatus::Cancelled : TexelStatus::Failed;
    return;
  }
  state.siteSd[s] = uncertaintyOf(found);
  const double energy = weightedEnergy(state, z, s);
  state.siteResidual[s] = energy > 0 ? static_cast<float>(std::sqrt(found.dataCost / energy)) : 0.0f;
  const Eigen::Vector2f mirror = mirrorOnScreen(state.frame, state.geometry(s), p.normal);
  const bool off =
      std::abs(mirror.x()) > state.frame.halfExtent.x() || std::abs(mirror.y()) > state.frame.halfExtent.y();
  state.siteStatus[s] = state.measurements.clipped[s] != 0              ? TexelStatus::Clipped
                        : off                                           ? TexelStatus::MirrorOffScreen
                        : found.outcome == SolveOutcome::IterationLimit ? TexelStatus::IterationLimit
                                                                        : TexelStatus::Converged;
}

}  // namespace

void solveSheet(FourierFitState& state, const JobContext& job, std::span<const SvbrdfParameters> start) {
  const std::size_t count = state.measurements.sites.size();
  SheetSolver solver(state, job);
  solver.run(start);
  const std::vector<SiteSolution> solution = solver.take();
  state.sites.resize(count);
  state.siteStatus.assign(count, TexelStatus::Cancelled);
  state.siteResidual.assign(count, 0);
  state.siteSd.assign(count, {});
  constexpr std::size_t kBlock = 4096;
  tbb::parallel_for(std::size_t{0}, (count + kBlock - 1) / kBlock, [&](std::size_t b) {
    const std::size_t first = b * kBlock, end = std::min(count, first + kBlock);
    const SiteBlock block = state.measurements.store.block(first, end - first, MeasurementStore::kZ);
    for (std::size_t s = first; s < end; ++s)
      fillSite(state, s, solution[s], solver.solved()[s] != 0, job.cancelled(), block.z(s));
  });
  const auto solved = static_cast<std::size_t>(std::count(solver.solved().begin(), solver.solved().end(), 1));
  state.stats.texels = solved;
  state.stats.resumedTexels = solver.resumed();
  state.stats.meanIterations =
      solved > 0 ? static_cast<double>(solver.iterations()) / static_cast<double>(solved) : 0;
}

}  // namespace patina
