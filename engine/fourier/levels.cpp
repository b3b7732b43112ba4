#include "engine/fourier/levels.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>

#include "engine/fourier/levels_data.h"
#include "engine/fourier/levels_optimise.h"
#include "engine/fourier/levels_problem.h"
#include "engine/fourier/upsample.h"

namespace patina {
namespace {

using Vector = LevelProblem::Vector;
constexpr std::size_t kTile = 64;  // texels a task: whole SIMD batches, short enough to poll for a stop

constexpr int kFirstDimension = 32, kLastDimension = 128;
// The paper's are 12, 3 and 3; ours cost a thousandth, and end sooner where nothing is left to gain.
constexpr int kFirstIterations = 15, kLaterIterations = 5;

int halfOf(int texels) {
  return std::max(1, texels / 2);
}

/// What the sites resolve, texels on the longest side.
int siteResolution(const FourierFitState& state) {
  const SiteSet& sites = state.measurements.sites;
  if (sites.grouped()) return sites.cellsOnLongestSide;
  const int resolved = resolvedSize(state.capture, sites);
  return state.options.size > 0 ? std::min(state.options.size, resolved) : resolved;
}

std::pair<int, int> gridFor(const FourierFitState& state, int longestSide) {
  const double longest = std::max(state.capture.sampleWidthMm, state.capture.sampleHeightMm);
  auto side = [&](double mm) {
    return std::max(1, static_cast<int>(std::lround(longestSide * mm / longest)));
  };
  return {side(state.capture.sampleWidthMm), side(state.capture.sampleHeightMm)};
}

Vector vectorOf(const SiteSolution& s) {
  Vector v;
  v << s.lobe.logSigma, s.lobe.logKurtosis, s.lobe.slopeX, s.lobe.slopeY, s.diffuse[0], s.diffuse[1],
      s.diffuse[2], s.specular[0], s.specular[1], s.specular[2];
  return v;
}

SiteSolution solutionOf(const Vector& v, const LevelProblem::Local& local, const LevelReport& report,
                        const LevelOptions& options) {
  SiteSolution s;
  s.lobe = {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2]),
            static_cast<float>(v[3])};
  for (int c = 0; c < 3; ++c) {
    s.diffuse[c] = static_cast<float>(v[4 + c]);
    s.specular[c] = static_cast<float>(v[7 + c]);
  }
  s.cost = static_cast<float>(local.cost);
  s.dataCost = static_cast<float>(local.dataCost);
  s.iterations = report.iterations;
  s.outcome = !std::isfinite(local.cost)                  ? SolveOutcome::Failed
              : report.iterations < options.maxIterations ? SolveOutcome::Converged
                                                          : SolveOutcome::IterationLimit;
  return s;
}

/// Every texel by itself from three widths of lobe, the best of them: where App. D's guess is far off, the
/// coupled search starts from here instead.
std::vector<Vector> independentSolutions(const LevelProblem& problem, const SolverSetup& setup,
                                         const JobContext& job) {
  std::vector<Vector> x(problem.size());
  tbb::parallel_for(std::size_t{0}, (x.size() + kTile - 1) / kTile, [&](std::size_t t) {
    if (job.cancelled()) return;
    const std::size_t first = t * kTile, count = std::min(kTile, x.size() - first);
    std::vector<SiteSolution> best(count), found(count);
    for (const float sigma : {0.03f, 0.1f, 0.01f}) {
      const std::vector<LobeParameters> start(count, {std::log(sigma), std::log(0.03f), 0, 0});
      solveSites(setup, {problem.sites().data() + first, count}, start, found);
      for (std::size_t i = 0; i < count; ++i)
        if (found[i].outcome != SolveOutcome::Failed &&
            (best[i].outcome == SolveOutcome::Failed || found[i].cost < best[i].cost))
          best[i] = found[i];
    }
    for (std::size_t i = 0; i < count; ++i) x[first + i] = vectorOf(best[i]);
  });
  return x;
}

/// Rows that every site of a texel dropped, as the solution predicts them: upsampling compares whole spectra.
void predictMissingRows(const FourierFitState& state, const SolverSetup& setup, const LevelProblem& problem,
                        std::span<const Vector> x, LevelData& level) {
  const std::size_t rows = level.zStride() / 3;
  const MirrorPhase phase(state);
  tbb::parallel_for(std::size_t{0}, problem.size(), [&](std::size_t i) {
    const std::size_t t = problem.texels()[i];
    const auto count = std::span(level.rowCount).subspan(t * rows, rows);
    if (std::ranges::find(count, 0u) == count.end()) return;
    std::vector<float> columns(static_cast<std::size_t>(problem.rows()) * kModelColumns), z(level.zStride());
    SiteData whole = problem.sites()[i];
    whole.dropped = {};  // the model leaves such rows out
    const LobeParameters lobe = solutionOf(x[i], {}, {}, {}).lobe;
    modelColumns(setup, {&whole, 1}, {&lobe, 1}, columns.data());
    for (std::size_t row = 0; row < rows; ++row)
      for (int c = 0; c < 3; ++c)
        z[row * 3 + c] = static_cast<float>(x[i][4 + c] * columns[row * kModelColumns] +
                                            x[i][7 + c] * columns[row * kModelColumns + 1]);
    phase.turn(level.pointMm[t], z.data(), z.data());
    for (std::size_t row = 0; row < rows; ++row)
      if (count[row] == 0) std::copy_n(z.data() + row * 3, 3, level.z.data() + (t * rows + row) * 3);
  });
}

/// Costs of solutions that come from elsewhere, by each site's own measurements and weights.
void fillCosts(const FourierFitState& state, const SolverSetup& setup, std::span<SiteSolution> solutions,
               const JobContext& job) {
  const FourierMeasurements& m = state.measurements;
  const auto frequencies = static_cast<std::size_t>(m.frequencyCount());
  const std::size_t rows = 2 * frequencies + 1, stride = (frequencies + 1) * 6;
  auto square = [](float x) { return x * x; };
  const FourierPriors& p = setup.priors;
  std::atomic<std::int64_t> done{0};
  tbb::parallel_for(std::size_t{0}, (solutions.size() + kTile - 1) / kTile, [&](std::size_t tile) {
    if (job.cancelled()) return;
    const std::size_t first = tile * kTile, count = std::min(kTile, solutions.size() - first);
    const SiteRows block(m, first, count);
    std::vector<float> diffuse(count * stride), columns(count * rows * kModelColumns);
    std::vector<SiteData> data(count);
    std::vector<LobeParameters> lobe(count);
    for (std::size_t i = 0; i < count; ++i) {
      data[i].geometry = state.geometry(first + i);
      data[i].diffuse = diffuse.data() + i * stride;
      data[i].dropped = block.dropped(first + i);
      state.diffuse->at(m.sites.pointMm[first + i].cast<double>(), diffuse.data() + i * stride);
      data[i].z = block.z(first + i);
      data[i].dc = m.dc.data() + (first + i) * 3;
      const FourierFitState::Weights weights = state.weights(first + i);
      for (int c = 0; c < 3; ++c) {
        data[i].weight[c] = static_cast<float>(weights.ac[c]);
        data[i].dcWeight[c] = static_cast<float>(weights.dc[c]);
      }
      lobe[i] = solutions[first + i].lobe;
    }
    modelColumns(setup, data, lobe, columns.data());
    for (std::size_t i = 0; i < count; ++i) {
      SiteSolution& s = solutions[first + i];
      if (s.outcome == SolveOutcome::Failed) continue;
      std::vector<char> counts(rows, 1);
      for (const auto row : data[i].dropped) counts[row] = 0;
      s.dataCost = 0;
      float prior = square((s.lobe.logSigma - p.logSigmaMean) / p.logSigmaSigma) +
                    square((s.lobe.logKurtosis - p.logKurtosisMean) / p.logKurtosisSigma) +
                    (square(s.lobe.slopeX) + square(s.lobe.slopeY)) / square(p.normalSigma);
      for (int c = 0; c < 3; ++c) {
        prior += square(s.diffuse[c] / p.diffuseSigma) + square(s.specular[c] / p.specularSigma);
        for (std::size_t row = 0; row < rows; ++row) {
          if (!counts[row]) continue;
          const bool zero = row + 1 == rows;
          const float* model = columns.data() + (i * rows + row) * kModelColumns;
          const float measured = zero ? data[i].dc[c] : data[i].z[row * 3 + c];
          s.dataCost += (zero ? data[i].dcWeight : data[i].weight)[c] *
                        square(s.diffuse[c] * model[0] + s.specular[c] * model[1] - measured);
        }
      }
      s.cost = s.dataCost + prior;
    }
    job.progress("upsample", done += static_cast<std::int64_t>(count),
                 static_cast<std::int64_t>(solutions.size()), "texels");
  });
}

Error cancelledError() {
  return {ErrorCode::Cancelled, "the fit was cancelled before the coarse levels were solved", "", ""};
}

/// Grids of the levels, coarsest first; each has twice the texels of the one before.
std::vector<LevelData> measureLevels(const FourierFitState& state, const JobContext& job) {
  const int resolution = siteResolution(state);
  int dimension = std::min(kFirstDimension, std::max(1, resolution / 2));
  int doublings = 0;
  while (dimension << (doublings + 1) < resolution && dimension << (doublings + 1) <= kLastDimension)
    ++doublings;
  const auto [width, height] = gridFor(state, dimension);
  std::vector<LevelData> levels;
  levels.push_back(measureLevel(state, width << doublings, height << doublings, true, job));
  for (int k = 0; k < doublings; ++k) levels.insert(levels.begin(), halved(levels.front()));
  for (auto& level : levels) finishScatter(level);
  return levels;
}

}  // namespace

Result<LevelSolution> solveLevels(const FourierFitState& state, const SolverSetup& setup,
                                  const JobContext& job) {
  std::vector<LevelData> levels = measureLevels(state, job);
  if (job.cancelled()) return cancelledError();
  LevelSolution solution;
  for (std::size_t k = 0; k < levels.size(); ++k) {
    const LevelProblem problem(state, setup, levels[k]);
    std::vector<SiteSolution> texels(levels[k].size());
    std::vector<Vector> x;
    std::vector<LevelProblem::Local> local;
    LevelOptions options;
    options.maxIterations = k == 0 ? kFirstIterations : kLaterIterations;
    LevelReport report;
    if (k == 0) {
      x = problem.initialGuess();
      report = optimiseLevel(problem, options, solveByConjugateGradients, x, local, job);
      std::vector<Vector> other = independentSolutions(problem, setup, job);
      std::vector<LevelProblem::Local> otherLocal;
      if (!job.cancelled()) {
        LevelReport second =
            optimiseLevel(problem, options, solveByConjugateGradients, other, otherLocal, job);
        second.startCost = report.startCost;
        second.seconds += report.seconds;
        if (second.cost < report.cost) x = std::move(other), local = std::move(otherLocal), report = second;
      }
    } else {
      upsampleToLevel(state, solution, levels[k], texels, job);
      for (const auto t : problem.texels()) x.push_back(vectorOf(texels[t]));
      if (!job.cancelled())
        report = optimiseLevel(problem, options, solveByConjugateGradients, x, local, job);
    }
    if (job.cancelled()) break;
    report.dimension = std::max(levels[k].width, levels[k].height);
    for (std::size_t i = 0; i < problem.size(); ++i)
      texels[problem.texels()[i]] = solutionOf(x[i], local[i], report, options);
    predictMissingRows(state, setup, problem, x, levels[k]);
    solution.reports.push_back(report);
    solution.texels = std::move(texels);
    solution.data = std::move(levels[k]);
    job.progress("levels", static_cast<std::int64_t>(k + 1), static_cast<std::int64_t>(levels.size()),
                 "levels");
  }
  if (const auto failure = state.measurements.store.failure()) return *failure;
  if (solution.texels.empty()) return cancelledError();
  return solution;
}

std::uint64_t paperScheduleBytes(int longestTexels, double aspect, int frequencyCount) {
  const double longest = halfOf(longestTexels);
  const auto texels = static_cast<std::size_t>(longest * std::max(1.0, std::round(longest * aspect)));
  return levelBytes(texels, frequencyCount, false) +
         texels * (sizeof(SiteSolution) + sizeof(std::uint32_t));  // which of them have sites
}

Status paperSchedule(const FourierFitState& state, const SolverSetup& setup, std::span<SiteSolution> out,
                     const JobContext& job) {
  auto coarse = solveLevels(state, setup, job);
  if (!coarse) return coarse.error();
  LevelSolution half;
  const auto [width, height] = gridFor(state, halfOf(siteResolution(state)));
  half.data = measureLevel(state, width, height, false, job);
  half.reports = std::move(coarse->reports);
  half.texels.resize(half.data.size());
  upsampleToLevel(state, *coarse, half.data, half.texels, job);
  std::vector<std::uint32_t> texels;
  for (std::uint32_t t = 0; t < half.data.size(); ++t)
    if (half.data.siteCount[t] > 0) texels.push_back(t);
  const MirrorPhase phase(state);
  std::atomic<std::int64_t> done{0};
  tbb::parallel_for(std::size_t{0}, (texels.size() + kTile - 1) / kTile, [&](std::size_t tile) {
    if (job.cancelled()) return;
    const std::size_t first = tile * kTile, count = std::min(kTile, texels.size() - first);
    const auto part = std::span(texels).subspan(first, count);
    const LevelTile input(state, phase, half.data, part);
    std::vector<LobeParameters> start(count);
    for (std::size_t i = 0; i < count; ++i) start[i] = half.texels[part[i]].lobe;
    std::vector<SiteSolution> found(count);
    solveSites(setup, input.data, start, found);
    refitAlbedos(setup, input.data, found);  // the same albedos, with their standard deviations
    for (std::size_t i = 0; i < count; ++i)
      if (found[i].outcome != SolveOutcome::Failed) half.texels[part[i]] = found[i];
    job.progress("solve", done += static_cast<std::int64_t>(count), static_cast<std::int64_t>(texels.size()),
                 "texels");
  });
  upsampleToSites(state, half, out, job);
  fillCosts(state, setup, out, job);
  if (const auto failure = state.measurements.store.failure()) return *failure;
  return Done{};
}

}  // namespace patina
