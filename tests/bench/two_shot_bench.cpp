// Speed and memory of the two-shot half: equation 15 against its direct form, the search for directions, a
// basis from files, a reconstruction from two photographs of two megapixels.
#include <benchmark/benchmark.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <thread>

#include "devices/simulated/two_shot_rig.h"
#include "engine/base/dense.h"
#include "engine/brdf/brdf_file.h"
#include "engine/brdf/neural_brdf.h"
#include "engine/brdf/tabulated_brdf.h"
#include "engine/capture/two_shot_capture.h"
#include "engine/twoshot/basis.h"
#include "engine/twoshot/basis_format.h"
#include "engine/twoshot/fit.h"
#include "engine/twoshot/metric.h"
#include "engine/twoshot/plan.h"

namespace patina::bench {
namespace {

namespace fs = std::filesystem;
using Eigen::MatrixXd;

double peakMebibytes() {
  std::ifstream status("/proc/self/status");
  for (std::string key; status >> key;) {
    double kibibytes = 0;
    if (key == "VmHWM:" && status >> kibibytes) return kibibytes / 1024.0;
  }
  return 0;
}

void forgetPeak() {
  std::ofstream("/proc/self/clear_refs") << "5\n";
}

const Result<BasisPtr>& benchBasis() {
  static const Result<BasisPtr> basis = builtInBasis({});
  return basis;
}

ShotDirections shotAt(double thetaHDeg, double thetaDDeg, double phiDDeg) {
  constexpr double kDegree = M_PI / 180;
  return shotFromHalfDiff({thetaHDeg * kDegree, thetaDDeg * kDegree, phiDDeg * kDegree});
}
const ShotDirections kFirst = shotAt(8, 38.5, 88.5), kSecond = shotAt(22, 78.5, 91.5);

double seconds(const auto& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// One evaluation of equation 15 for two near-field pictures of 300 points: rows looked up, reduced, error.
// `against_direct`: how many times as long the direct form takes on one core, whose error vectors run over
// the cells of the grid that are above the surface (1.1 million; the paper says 1.458 million): |Q d_i| for
// 300 columns, with the d_i given.
void BM_EquationFifteen(benchmark::State& state) {
  const Result<BasisPtr>& basis = benchBasis();
  if (!basis) return state.SkipWithError(basis.error().sentence().c_str());
  const ErrorMetric metric(*basis, BasisRegion::All);
  const double tolerance = state.range(0) == 0 ? kSearchTolerance : kExactTolerance;
  double fast = 0, error = 0;
  std::int64_t count = 0, rank = 0;
  for (auto _ : state) {
    fast += seconds([&] {
      const RowFactor first = rowsOfShot(**basis, kFirst, {25, 300}, tolerance),
                      second = rowsOfShot(**basis, kSecond, {25, 300}, tolerance);
      const RowFactor both = stack({&first, &second});
      rank = both.rank();
      error = metric.training(both);
    });
    ++count;
  }
  fast /= static_cast<double>(count);

  // The direct form, on every twentieth slab of cells, timed without the look-up of its rows.
  const MatrixXd& c = (*basis)->columnCoefficients();
  std::vector<HalfDiffAngles> angles;
  double direct = 0;
  std::size_t cells = 0, looked = 0, slab = 0;
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(c.cols());
  const auto work = [&] {
    const BasisRows rows = (*basis)->rows(angles);
    direct += seconds(
        [&] { sums += product(rows.components, false, c, false).colwise().squaredNorm().transpose(); });
    looked += angles.size();
  };
  for (std::size_t cell = 0; cell < kFoldedCells; ++cell) {
    if (!foldedCellReachable(cell)) continue;
    angles.push_back(foldedCentre(cell));
    ++cells;
    if (angles.size() < 2048) continue;
    if (slab++ % 20 == 0) work();
    angles.clear();
  }
  benchmark::DoNotOptimize(sums.data());
  // Both halves of phiD: folding them is not the direct form's.
  direct *= 2.0 * static_cast<double>(cells) / static_cast<double>(looked);
  state.counters["training"] = error;
  state.counters["rank"] = static_cast<double>(rank);
  state.counters["direct_s"] = direct;
  state.counters["against_direct"] = direct / fast;
}
BENCHMARK(BM_EquationFifteen)->Unit(benchmark::kMillisecond)->Arg(0)->Arg(1)->ArgName("exact");

void BM_ConditionNumber(benchmark::State& state) {
  const Result<BasisPtr>& basis = benchBasis();
  if (!basis) return state.SkipWithError(basis.error().sentence().c_str());
  MatrixXd rows(600, (*basis)->componentCount());
  rows << (*basis)->rows(discDirections(kFirst, {25, 300})).components,
      (*basis)->rows(discDirections(kSecond, {25, 300})).components;
  for (auto _ : state) benchmark::DoNotOptimize(conditionNumber(rows));
}
BENCHMARK(BM_ConditionNumber)->Unit(benchmark::kMillisecond);

// Two pictures, 25 degrees, 500 candidates, to convergence, with the default restarts.
void BM_PlanTwoShots(benchmark::State& state) {
  const Result<BasisPtr>& basis = benchBasis();
  if (!basis) return state.SkipWithError(basis.error().sentence().c_str());
  for (auto _ : state) {
    const Result<Plan> plan = planDirections(*basis, PlanOptions{}, {});
    if (!plan) return state.SkipWithError(plan.error().sentence().c_str());
    state.counters["training"] = plan->expected.training;
    state.counters["restarts"] = PlanOptions{}.restarts;
  }
}
BENCHMARK(BM_PlanTwoShots)->Unit(benchmark::kSecond)->UseRealTime()->MeasureProcessCPUTime()->Iterations(1);

// A hundred MERL files: ten tables, each under ten names (links), so that the disk holds 0.35 GB of them.
Result<std::vector<fs::path>> merlFolder() {
  const fs::path folder = fs::path(PATINA_BENCH_CACHE) / "merl";
  std::error_code failure;
  fs::create_directories(folder, failure);
  std::vector<fs::path> files;
  for (int i = 0; i < 100; ++i) {
    const fs::path file = folder / ("material_" + std::to_string(i) + ".binary");
    files.push_back(file);
    if (fs::exists(file)) continue;
    if (i < 10) {
      Result<std::shared_ptr<const TabulatedBrdf>> table = tabulate(*builtInMaterials()[7 * i]);
      if (!table) return table.error();
      Status written = writeMerl(file, **table);
      if (!written) return written.error();
    } else {
      fs::create_hard_link(files[i % 10], file, failure);
    }
  }
  return files;
}

// 300 columns from files, reading included; `read_s` is what reading alone takes.
void BM_BasisFromFiles(benchmark::State& state) {
  const Result<std::vector<fs::path>> files = merlFolder();
  if (!files) return state.SkipWithError(files.error().sentence().c_str());
  const double reading = seconds([&] {
    for (const fs::path& file : *files) benchmark::DoNotOptimize(readBrdf(file).ok());
  });
  forgetPeak();
  for (auto _ : state) {
    const Result<BasisPtr> built =
        buildBasis(*files, fs::path(PATINA_BENCH_CACHE) / "from_files.basis", {}, {});
    if (!built) return state.SkipWithError(built.error().sentence().c_str());
    state.counters["components"] = (*built)->componentCount();
  }
  state.counters["read_s"] = reading;
  state.counters["peak_MiB"] = peakMebibytes();
}
BENCHMARK(BM_BasisFromFiles)->Unit(benchmark::kSecond)->UseRealTime()->MeasureProcessCPUTime()->Iterations(1);

void BM_BuiltInBasisFromWeights(benchmark::State& state) {
  forgetPeak();
  for (auto _ : state) {
    const Result<BasisPtr> built =
        buildBasis(builtInMaterials(), fs::path(PATINA_BENCH_CACHE) / "built_in.basis", {}, {});
    if (!built) return state.SkipWithError(built.error().sentence().c_str());
  }
  state.counters["peak_MiB"] = peakMebibytes();
}
BENCHMARK(BM_BuiltInBasisFromWeights)
    ->Unit(benchmark::kSecond)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Iterations(1);

// Two photographs of `pixels` squared (1414: two megapixels) and their white references, basis loaded.
void BM_ReconstructTwoShots(benchmark::State& state) {
  const Result<BasisPtr>& basis = benchBasis();
  if (!basis) return state.SkipWithError(basis.error().sentence().c_str());
  const auto pixels = static_cast<int>(state.range(0));
  const fs::path folder = fs::path(PATINA_BENCH_CACHE) / ("two_shot_" + std::to_string(pixels));
  if (!fs::exists(folder / "capture.json")) {
    TwoShotScene scene;
    scene.name = "bench";
    scene.brdfs = {builtInMaterials()[56]};
    scene.pixels = pixels;
    scene.samplesPerPixelSide = 1;
    scene.poses = {{kFirst, {1.0}, false}, {kSecond, {1.0}, false}};
    const Result<TwoShotSimulationReport> made = simulateTwoShot(scene, folder, {});
    if (!made) return state.SkipWithError(made.error().sentence().c_str());
  }
  const Result<TwoShotCapture> capture = readTwoShotCapture(folder);
  if (!capture) return state.SkipWithError(capture.error().sentence().c_str());
  std::map<std::string, double> stages;
  forgetPeak();
  for (auto _ : state) {
    const auto fit = fitTwoShot(*capture, *basis, {}, {});
    if (!fit) return state.SkipWithError(fit.error().sentence().c_str());
    for (const auto& [stage, time] : (*fit)->stats.seconds) stages[stage] += time;
  }
  for (const auto& [stage, time] : stages) {
    state.counters["seconds/" + stage] = benchmark::Counter(time, benchmark::Counter::kAvgIterations);
  }
  state.counters["peak_MiB"] = peakMebibytes();
}
BENCHMARK(BM_ReconstructTwoShots)
    ->Unit(benchmark::kSecond)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Iterations(3)
    ->Arg(160)
    ->Arg(1414)
    ->ArgName("pixels");

}  // namespace
}  // namespace patina::bench
