// The solver of single texels against a straightforward fit with Ceres: same sites, same measurements,
// weights, priors, starts, tolerance, one core.
#include <benchmark/benchmark.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include "engine/fourier/fit_state.h"
#include "engine/fourier/measurements.h"
#include "engine/fourier/operation_count.h"
#include "engine/fourier/solve_sheet.h"
#include "engine/fourier/solver.h"
#include "engine/fourier/tile.h"
#include "tests/bench/bench_capture.h"
#include "tests/bench/fourier_baseline.h"
#include "tests/results/machine_rate.h"

namespace patina::bench {
namespace {

/// App. D's lobe, a broad and a sharp one: where the fit of a sheet begins without coarser levels.
constexpr float kStartSigma[] = {0.03f, 0.1f, 0.01f};
constexpr int kSites = 64;
/// Rounds of ours, so that its time is well above the clock's steps.
constexpr int kRounds = 20;
/// Ours is as good where its cost is no more than this above theirs: single against double precision.
constexpr double kEqualCost = 1e-3;

Result<std::unique_ptr<FourierFitState>> measuredState(const FourierCapture& capture) {
  auto state = std::make_unique<FourierFitState>();
  state->capture = capture;
  state->frame = ScreenFrame(capture.screen);
  auto plan = planMeasurements(capture, {});
  if (!plan) return plan.error();
  auto sites = makeSites(capture, 0);
  if (!sites) return sites.error();
  auto measured = measure(capture, std::move(*plan), std::move(*sites), {});
  if (!measured) return measured.error();
  state->measurements = std::move(*measured);
  std::vector<Eigen::Vector2d> frequencies = {Eigen::Vector2d::Zero()};
  for (const auto& group : state->measurements.plan.fitted)
    frequencies.push_back(group.frequency.cast<double>());
  state->diffuse = std::make_unique<DiffuseTransform>(
      state->frame, Eigen::Vector2d(capture.sampleWidthMm, capture.sampleHeightMm), frequencies,
      state->diffuseMethod());
  return state;
}

/// Processor time of this thread: what else runs on the machine is not counted.
double secondsOf(const auto& work) {
  const auto now = [] {
    timespec time{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
  };
  const double start = now();
  work();
  return now() - start;
}

double median(std::vector<double> values) {
  std::ranges::nth_element(values, values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2));
  return values[values.size() / 2];
}

/// The share of frequencies at which a texel's lobe hasn't decayed: the others are left out of its step.
double litShare(const SolverSetup& setup, std::span<const SiteData> data,
                std::span<const SiteSolution> found) {
  std::vector<LobeParameters> lobes;
  for (const SiteSolution& solution : found) lobes.push_back(solution.lobe);
  const std::size_t rows = 2 * setup.frequency.size() + 1;
  std::vector<float> columns(data.size() * rows * kModelColumns);
  modelColumns(setup, data, lobes, columns.data());
  double lit = 0;
  for (std::size_t i = 0; i < data.size(); ++i)
    for (std::size_t row = 0; row + 1 < rows; row += 2) {
      const float* at = columns.data() + (i * rows + row) * kModelColumns;
      lit += at[1] != 0 || at[kModelColumns + 1] != 0;
    }
  return lit / static_cast<double>(data.size() * setup.frequency.size());
}

// Counters: microseconds a texel of each (all three starts), their ratio, the share of texels whose cost is
// no higher than the baseline's, and the baseline's and our mean cost; microseconds a step of ours, at how
// many of the frequencies the lobe is there at the end, and a step's operations then; microseconds a texel to
// gather what the solver needs of neighbouring texels, and to find the albedos from its own measurements.
void BM_TexelAgainstCeres(benchmark::State& state) {
  const Result<FourierCapture>& capture = benchCapture();
  if (!capture) return state.SkipWithError(capture.error().sentence().c_str());
  auto sheet = measuredState(*capture);
  if (!sheet) return state.SkipWithError(sheet.error().sentence().c_str());
  std::mt19937 random(20130721);
  std::vector<std::uint32_t> sites;
  const auto count = (*sheet)->measurements.sites.size();
  for (int i = 0; i < kSites; ++i) sites.push_back(static_cast<std::uint32_t>(random() % count));
  const Tile tile(**sheet, sites, false);
  const SolverSetup setup = solverSetup(**sheet);

  std::vector<double> ours(sites.size()), theirs(sites.size());
  double ourSeconds = 0, theirSeconds = 0, ourSteps = 0, theirSteps = 0;
  for (auto _ : state) {
    ours.assign(sites.size(), std::numeric_limits<double>::infinity());
    theirs = ours;
    for (const float sigma : kStartSigma) {
      const LobeParameters start{std::log(sigma), std::log(0.03f), 0, 0};
      const std::vector<LobeParameters> starts(sites.size(), start);
      std::vector<SiteSolution> found(sites.size());
      ourSeconds += secondsOf([&] {
                      for (int round = 0; round < kRounds; ++round)
                        solveSites(setup, tile.data, starts, found);
                    }) /
                    kRounds;
      for (std::size_t i = 0; i < sites.size(); ++i) {
        // What the baseline says of our solution, so that both are measured with one ruler.
        ours[i] = std::min(ours[i], baselineCost(setup, tile.data[i], found[i]));
        ourSteps += found[i].iterations;
      }
      theirSeconds += secondsOf([&] {
        for (std::size_t i = 0; i < sites.size(); ++i) {
          const BaselineSolution solution = solveWithCeres(setup, tile.data[i], start);
          theirs[i] = std::min(theirs[i], solution.cost);
          theirSteps += solution.iterations;
        }
      });
    }
  }
  const auto runs = static_cast<double>(state.iterations() * static_cast<std::int64_t>(sites.size()));
  double notWorse = 0, ourCost = 0, theirCost = 0;
  for (std::size_t i = 0; i < sites.size(); ++i) {
    notWorse += ours[i] <= theirs[i] * (1 + kEqualCost);
    ourCost += ours[i], theirCost += theirs[i];
  }
  // A step by itself: enough texels that lanes don't run idle.
  constexpr int kMany = 2048;
  std::vector<std::uint32_t> many;
  for (int i = 0; i < kMany; ++i) many.push_back(static_cast<std::uint32_t>(random() % count));
  const Tile manyTile(**sheet, many, false);
  const std::vector<LobeParameters> manyStarts(many.size(),
                                               {std::log(kStartSigma[0]), std::log(0.03f), 0, 0});
  std::vector<SiteSolution> manyFound(many.size());
  solveSites(setup, manyTile.data, manyStarts, manyFound);
  double manySteps = 0;
  for (const SiteSolution& found : manyFound) manySteps += found.iterations;
  const double lit = litShare(setup, manyTile.data, manyFound);
  state.counters["lit"] = lit;
  const double operations = solverOperations(setup, lit);
  // In turn with the machine's rate, and the median of many turns: what else runs here disturbs both.
  constexpr int kTurns = 21;
  std::vector<double> step, rate, times;
  for (int turn = 0; turn < kTurns; ++turn) {
    rate.push_back(test::multiplyAddRate());
    step.push_back(secondsOf([&] { solveSites(setup, manyTile.data, manyStarts, manyFound); }) / manySteps);
    times.push_back(step.back() * rate.back() * 2 / operations);
  }
  state.counters["operations"] = operations;
  state.counters["us_step"] = 1e6 * median(step);
  state.counters["multiply_adds"] = median(rate);
  state.counters["floor_times"] = median(times);
  // What a stage does besides: runs of texels as `solveSheet` takes them.
  const std::size_t run = std::min<std::size_t>(256, count / 2);
  std::vector<double> gather, albedos;
  for (int turn = 0; turn < kTurns; ++turn) {
    std::vector<std::uint32_t> together(run);
    std::iota(together.begin(), together.end(), static_cast<std::uint32_t>(random() % (count - run)));
    gather.push_back(secondsOf([&] { benchmark::DoNotOptimize(Tile(**sheet, together, true)); }));
    albedos.push_back(secondsOf(
        [&] { refitAlbedos(setup, std::span(manyTile.own).first(run), std::span(manyFound).first(run)); }));
  }
  state.counters["us_gather"] = 1e6 * median(gather) / static_cast<double>(run);
  state.counters["us_albedos"] = 1e6 * median(albedos) / static_cast<double>(run);

  const auto n = static_cast<double>(sites.size());
  state.counters["us_texel"] = 1e6 * ourSeconds / runs;
  state.counters["us_texel_ceres"] = 1e6 * theirSeconds / runs;
  state.counters["times_faster"] = theirSeconds / ourSeconds;
  state.counters["not_worse"] = notWorse / n;
  state.counters["cost"] = ourCost / n;
  state.counters["cost_ceres"] = theirCost / n;
  state.counters["steps"] = ourSteps / runs;
  state.counters["steps_ceres"] = theirSteps / runs;
}
BENCHMARK(BM_TexelAgainstCeres)->Unit(benchmark::kSecond)->UseRealTime()->Iterations(1);

}  // namespace
}  // namespace patina::bench
