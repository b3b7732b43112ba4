// Speed and memory of the engine on a simulated capture. Not a test: nothing here passes or fails.
//
// patina-bench: everything; the capture is simulated at the first run, and kept.
//
// patina-bench --benchmark_filter=Fit: only the fits.
//
// PATINA_BENCH_PIXELS=96 patina-bench: a smaller camera.
//
// PATINA_BENCH_BUNDLE=FOLDER patina-bench: another capture bundle.
#include <benchmark/benchmark.h>

#include <cstdlib>
#include <fstream>
#include <iostream>
#include <string>
#include <thread>

#include "devices/simulated/simulated_rig.h"
#include "devices/simulated/simulated_sheet.h"
#include "engine/base/job.h"
#include "engine/capture/capture.h"
#include "engine/fourier/fit.h"
#include "engine/image/exr.h"
#include "tests/bench/bench_capture.h"

namespace patina::bench {
namespace {

namespace fs = std::filesystem;

constexpr int kDefaultPixels = 256;  // a side; the size that figures are quoted for

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

int cameraPixels() {
  const int asked = std::atoi(environment("PATINA_BENCH_PIXELS").c_str());
  return asked > 0 ? asked : kDefaultPixels;
}

Result<SimulatedCaptureReport> simulateBundle(const fs::path& folder, int pixels, const JobContext& job) {
  const SimulatedSheet sheet = simulatedScene("laminate");
  SimulatedCaptureOptions options;
  options.samplesPerPixelSide =
      1;  // the fit's work is the same, and the simulation takes a quarter of the time
  return simulateCapture(folder, SimulatedRig::desk(pixels, sheet.widthMm, sheet.heightMm), sheet, options,
                         job);
}

}  // namespace

const Result<FourierCapture>& benchCapture() {
  static const Result<FourierCapture> capture = []() -> Result<FourierCapture> {
    const std::string asked = environment("PATINA_BENCH_BUNDLE");
    if (!asked.empty()) return readFourierCapture(asked);
    const int pixels = cameraPixels();
    const fs::path folder = fs::path(PATINA_BENCH_CACHE) / ("laminate_" + std::to_string(pixels));
    if (!fs::exists(folder / "capture.json")) {
      std::cerr << "Simulating a capture of " << pixels << " x " << pixels << " pixels; kept in "
                << folder.string() << "\n";
      std::error_code failure;
      fs::create_directories(folder.parent_path(), failure);
      const Result<SimulatedCaptureReport> made = simulateBundle(folder, pixels, {});
      if (!made) return made.error();
    }
    return readFourierCapture(folder);
  }();
  return capture;
}

namespace {

// The most memory that this process held at once, since `forgetPeak`. 0 where the system doesn't tell.
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

std::size_t fileBytes(const fs::path& file) {
  std::error_code failure;
  const auto size = fs::file_size(file, failure);
  return failure ? 0 : size;
}

// One whole fit an iteration: reading, measuring, geometry, solving, maps, held-out error. `seconds/<stage>`
// are the fit's own.
void fitWith(benchmark::State& state, int threads, const FourierFitOptions& options) {
  const Result<FourierCapture>& capture = benchCapture();
  if (!capture) return state.SkipWithError(capture.error().sentence().c_str());
  JobContext job;
  job.threads = threads;
  FourierFitStats total;
  forgetPeak();
  for (auto _ : state) {
    const Result<std::shared_ptr<const FourierFit>> fit = fitFourier(*capture, options, job);
    if (!fit) return state.SkipWithError(fit.error().sentence().c_str());
    const FourierFitStats& stats = (*fit)->stats();
    total.texels += stats.texels;
    total.meanIterations = stats.meanIterations;
    total.holdoutRms = stats.holdoutRms;
    total.noiseFloorHoldout = stats.noiseFloorHoldout;
    for (const auto& [stage, seconds] : stats.seconds) total.seconds[stage] += seconds;
  }
  using benchmark::Counter;
  state.counters["texels"] = Counter(static_cast<double>(total.texels), Counter::kAvgIterations);
  state.counters["texels/s"] = Counter(static_cast<double>(total.texels), Counter::kIsRate);
  for (const auto& [stage, seconds] : total.seconds) {
    state.counters["seconds/" + stage] = Counter(seconds, Counter::kAvgIterations);
    if (stage == "solve" && seconds > 0)
      state.counters["solved/s"] = static_cast<double>(total.texels) / seconds;
  }
  state.counters["steps/texel"] = total.meanIterations;
  if (total.holdoutRms >= 0) state.counters["heldout/noise"] = total.holdoutRms / total.noiseFloorHoldout;
  state.counters["peak_MiB"] = peakMebibytes();
}

void BM_FitOnAllCores(benchmark::State& state) {
  fitWith(state, static_cast<int>(std::thread::hardware_concurrency()), {});
}
BENCHMARK(BM_FitOnAllCores)->Unit(benchmark::kSecond)->UseRealTime()->MeasureProcessCPUTime()->Iterations(1);

void BM_FitOnOneCore(benchmark::State& state) {
  fitWith(state, 1, {});
}
BENCHMARK(BM_FitOnOneCore)->Unit(benchmark::kSecond)->UseRealTime()->MeasureProcessCPUTime()->Iterations(1);

// The paper's first-order map of the lobe instead of exact moments, to know what exactness costs.
void BM_FitPaperAffine(benchmark::State& state) {
  FourierFitOptions options;
  options.lobe = LobeMapping::PaperAffine;
  fitWith(state, static_cast<int>(std::thread::hardware_concurrency()), options);
}
BENCHMARK(BM_FitPaperAffine)->Unit(benchmark::kSecond)->UseRealTime()->MeasureProcessCPUTime()->Iterations(1);

void BM_ReadCaptureDescription(benchmark::State& state) {
  const Result<FourierCapture>& capture = benchCapture();
  if (!capture) return state.SkipWithError(capture.error().sentence().c_str());
  for (auto _ : state) {
    const Result<FourierCapture> again = readFourierCapture(capture->folder);
    if (!again) return state.SkipWithError(again.error().sentence().c_str());
    benchmark::DoNotOptimize(again->photos.data());
  }
}
BENCHMARK(BM_ReadCaptureDescription)->Unit(benchmark::kMillisecond);

void BM_ReadOnePhotograph(benchmark::State& state) {
  const Result<FourierCapture>& capture = benchCapture();
  if (!capture) return state.SkipWithError(capture.error().sentence().c_str());
  std::size_t bytes = 0, pixels = 0;
  for (auto _ : state) {
    const Result<Image> photo = readExr(capture->folder / capture->photos.front().file, {"R", "G", "B"});
    if (!photo) return state.SkipWithError(photo.error().sentence().c_str());
    pixels += photo->pixelCount();
    bytes += fileBytes(capture->folder / capture->photos.front().file);
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(pixels));
  state.SetBytesProcessed(static_cast<std::int64_t>(bytes));
}
BENCHMARK(BM_ReadOnePhotograph)->Unit(benchmark::kMillisecond);

void BM_ReadEveryPhotograph(benchmark::State& state) {
  const Result<FourierCapture>& capture = benchCapture();
  if (!capture) return state.SkipWithError(capture.error().sentence().c_str());
  std::size_t bytes = 0;
  for (auto _ : state) {
    for (const FourierPhoto& photo : capture->photos) {
      const Result<Image> image = readPhoto(*capture, photo);
      if (!image) return state.SkipWithError(image.error().sentence().c_str());
      benchmark::DoNotOptimize(image->samples().data());
      bytes += fileBytes(capture->folder / photo.file);
    }
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations() * capture->photos.size()));
  state.SetBytesProcessed(static_cast<std::int64_t>(bytes));
}
BENCHMARK(BM_ReadEveryPhotograph)->Unit(benchmark::kMillisecond);

// The simulated rig, on a small camera: the demo's first wait.
void BM_SimulateCapture(benchmark::State& state) {
  const int pixels = 32;
  const fs::path folder = fs::path(PATINA_BENCH_CACHE) / "simulated";
  forgetPeak();
  for (auto _ : state) {
    const Result<SimulatedCaptureReport> made = simulateBundle(folder, pixels, {});
    if (!made) return state.SkipWithError(made.error().sentence().c_str());
  }
  state.SetItemsProcessed(state.iterations() * pixels * pixels);
  state.counters["peak_MiB"] = peakMebibytes();
}
BENCHMARK(BM_SimulateCapture)
    ->Unit(benchmark::kSecond)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Iterations(1);

}  // namespace
}  // namespace patina::bench

BENCHMARK_MAIN();
