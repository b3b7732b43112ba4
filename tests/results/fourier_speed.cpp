// How long a fit of a large sheet takes, from the files to the maps: simulates captures of the paper's set
// of photographs, fits each in a process of its own, and writes the part "fourier-speed" of docs/results.md.
// Run by packaging/speed on a quiet machine.
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <thread>

#include "devices/simulated/simulated_rig.h"
#include "devices/simulated/simulated_sheet.h"
#include "engine/base/job.h"
#include "engine/capture/capture.h"
#include "engine/fourier/diffuse_transform.h"
#include "engine/fourier/fit.h"
#include "engine/fourier/measurements.h"
#include "engine/fourier/operation_count.h"
#include "engine/fourier/site_geometry.h"
#include "tests/results/machine_rate.h"
#include "tests/results/page_part.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr int kLarge = 2048;      // only where asked for
constexpr int kTypical = 512;     // one core against all, and where the kernel is compared with the machine
constexpr int kPaperSize = 1024;  // of the bounds
constexpr double kPaperSeconds = 2 * 3600.0;
constexpr double kSolveBound = 30, kTotalBound = 60, kMemoryBoundMib = 4096, kCeresBound = 50,
                 kFloorBound = 4;

std::string number(double value, int digits) {
  std::array<char, 64> text;
  std::snprintf(text.data(), text.size(), "%.*f", digits, value);
  return text.data();
}

// ---- captures ----

/// A camera of `pixels` x `pixels` that sees nothing but the sheet: desk's, with a longer lens.
SimulatedRig fullFrame(int pixels, const SimulatedSheet& sheet) {
  SimulatedRig rig = SimulatedRig::desk(pixels, sheet.widthMm, sheet.heightMm);
  const auto onSheet = [&](double zoom) {
    Camera camera = rig.camera;
    camera.intrinsics(0, 0) *= zoom, camera.intrinsics(1, 1) *= zoom;
    for (int i = 0; i < pixels; ++i) {
      for (const Eigen::Vector2d& at : {Eigen::Vector2d(i, 0), Eigen::Vector2d(i, pixels - 1),
                                        Eigen::Vector2d(0, i), Eigen::Vector2d(pixels - 1, i)}) {
        const auto point = camera.samplePlaneFromPixel(at);
        if (!point || std::abs(point->x()) > 0.5 * sheet.widthMm ||
            std::abs(point->y()) > 0.5 * sheet.heightMm)
          return false;
      }
    }
    return true;
  };
  double low = 1, high = 4;
  while (high - low > 1e-4) (onSheet(0.5 * (low + high)) ? high : low) = 0.5 * (low + high);
  rig.camera.intrinsics(0, 0) *= high, rig.camera.intrinsics(1, 1) *= high;
  return rig;
}

/// The capture of that size, simulated where the cache hasn't got it. The paper's set: 32 frequencies of four
/// photographs, the window and black; its 131st photograph, of mirror and marker, is no part of a fit.
Result<fs::path> captureOf(int pixels, const fs::path& cache) {
  const fs::path folder = cache / ("sheet_" + std::to_string(pixels));
  if (fs::exists(folder / "capture.json")) return folder;
  std::cerr << "Simulating " << pixels << " x " << pixels << " ...\n";
  std::error_code failure;
  fs::create_directories(cache, failure);
  const SimulatedSheet sheet = simulatedScene("laminate");
  SimulatedCaptureOptions options;
  options.samplesPerPixelSide = 1;  // what a pixel mixes doesn't change the fit's work
  options.heldOut.clear();
  const auto made = simulateCapture(folder, fullFrame(pixels, sheet), sheet, options, {});
  if (!made) return made.error();
  std::cerr << "  prepared in " << number(made->seconds.at("prepare"), 1) << " s, integrated in "
            << number(made->seconds.at("integrate"), 1) << " s, written in "
            << number(made->seconds.at("write"), 1) << " s\n";
  return folder;
}

// ---- one fit, in a process of its own ----

double peakMebibytes() {
  std::ifstream status("/proc/self/status");
  for (std::string key; status >> key;) {
    double kibibytes = 0;
    if (key == "VmHWM:" && status >> kibibytes) return kibibytes / 1024.0;
  }
  return 0;
}

struct Measured {
  std::map<std::string, double> seconds;
  double texels = 0, steps = 0, fitRms = 0, noiseFloor = 0, peakMib = 0, operations = 0;
  double total() const { return seconds.contains("total") ? seconds.at("total") : 0; }
  double stage(const char* name) const { return seconds.contains(name) ? seconds.at(name) : 0; }
  /// The coarse levels and every texel.
  double solve() const { return stage("levels") + stage("solve"); }
};

/// Operations of one step of a site for this capture's frequencies, as the engine counts them.
double operationsOfAStep(const FourierCapture& capture) {
  const auto plan = planMeasurements(capture, {});
  if (!plan) return 0;
  SolverSetup setup;
  std::vector<Eigen::Vector2d> frequencies = {Eigen::Vector2d::Zero()};
  for (const FrequencyGroup& group : plan->fitted) {
    frequencies.push_back(group.frequency.cast<double>());
    setup.frequency.push_back(group.frequency.cast<float>());
  }
  const DiffuseTransform diffuse(ScreenFrame(capture.screen),
                                 Eigen::Vector2d(capture.sampleWidthMm, capture.sampleHeightMm), frequencies,
                                 DiffuseMethod::Quadrature);
  const std::vector<char> counts = diffuse.counts();
  setup.diffuseCounts.assign(counts.begin() + 1, counts.end());
  return solverOperations(setup);
}

int fitHere(const fs::path& bundle, int threads, const fs::path& result) {
  JobContext job;
  job.threads = threads;
  const auto start = std::chrono::steady_clock::now();
  const Result<FourierCapture> capture = readFourierCapture(bundle, job);
  if (!capture) {
    std::cerr << capture.error().sentence() << "\n";
    return 3;
  }
  const auto fit = fitFourier(*capture, FourierFitOptions{}, job);
  if (!fit) {
    std::cerr << fit.error().sentence() << "\n";
    return 1;
  }
  const FourierFitStats& stats = (*fit)->stats();
  Json json = {{"seconds", stats.seconds},
               {"texels", stats.texels},
               {"steps", stats.meanIterations},
               {"fit_rms", stats.fitRms},
               {"noise_floor", stats.noiseFloorFit},
               {"peak_mib", peakMebibytes()},
               {"operations", operationsOfAStep(*capture)}};
  json["seconds"]["total"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::ofstream out(result);
  return out << json.dump() << std::flush ? 0 : 1;
}

/// Runs a program; its standard output goes to our standard error. Status, -1 where it ended otherwise.
int runProgram(const std::vector<std::string>& command, const std::vector<std::string>& environment = {}) {
  const pid_t child = ::fork();
  if (child == 0) {
    ::dup2(STDERR_FILENO, STDOUT_FILENO);
    for (const std::string& entry : environment) ::putenv(const_cast<char*>(entry.c_str()));
    std::vector<char*> arguments;
    for (const std::string& argument : command) arguments.push_back(const_cast<char*>(argument.c_str()));
    arguments.push_back(nullptr);
    ::execv(arguments[0], arguments.data());
    ::_exit(127);
  }
  int status = 0;
  if (child < 0 || ::waitpid(child, &status, 0) != child || !WIFEXITED(status)) return -1;
  return WEXITSTATUS(status);
}

std::optional<Json> readJson(const fs::path& file) {
  std::ifstream in(file);
  Json json = Json::parse(in, nullptr, false);
  if (json.is_discarded()) return std::nullopt;
  return json;
}

std::optional<Measured> fitApart(const fs::path& self, const fs::path& bundle, int threads,
                                 const fs::path& cache) {
  const fs::path result = cache / "fit.json";
  std::cerr << "Fitting " << bundle.filename().string() << " on " << threads
            << (threads == 1 ? " core" : " cores") << " ...";
  const int status = runProgram({self.string(), "--child", bundle.string(), "--threads",
                                 std::to_string(threads), "--result", result.string()});
  const std::optional<Json> json = status == 0 ? readJson(result) : std::nullopt;
  if (!json) {
    std::cerr << " failed (status " << status << ")\n";
    return std::nullopt;
  }
  Measured measured;
  measured.seconds = json->at("seconds").get<std::map<std::string, double>>();
  measured.texels = json->at("texels").get<double>();
  measured.steps = json->at("steps").get<double>();
  measured.fitRms = json->at("fit_rms").get<double>();
  measured.noiseFloor = json->at("noise_floor").get<double>();
  measured.peakMib = json->at("peak_mib").get<double>();
  measured.operations = json->at("operations").get<double>();
  std::cerr << " " << number(measured.total(), 1) << " s\n";
  return measured;
}

// ---- the baseline ----

/// The counters of patina-bench's BM_TexelAgainstCeres on the given bundle; empty where it isn't built.
std::map<std::string, double> againstCeres(const fs::path& bench, const fs::path& bundle,
                                           const fs::path& cache) {
  if (!fs::exists(bench)) return {};
  const fs::path result = cache / "bench.json";
  std::cerr << "Against Ceres ...\n";
  const int status = runProgram({bench.string(), "--benchmark_filter=AgainstCeres",
                                 "--benchmark_out=" + result.string(), "--benchmark_out_format=json"},
                                {"PATINA_BENCH_BUNDLE=" + bundle.string()});
  const std::optional<Json> json = status == 0 ? readJson(result) : std::nullopt;
  if (!json || !json->contains("benchmarks") || json->at("benchmarks").empty()) return {};
  std::map<std::string, double> counters;
  for (const auto& [key, value] : json->at("benchmarks").front().items())
    if (value.is_number()) counters[key] = value.get<double>();
  return counters;
}

// ---- the page ----

std::string bounded(double value, int digits, double bound, bool atMost, bool* within) {
  std::string text =
      number(value, digits) + " (" + (atMost ? "at most " : "at least ") + number(bound, 0) + ")";
  if (atMost ? value > bound : value < bound) {
    text += " **beyond**";
    *within = false;
  }
  return text;
}

struct Run {
  int pixels = 0, threads = 0;
  Measured measured;
};

void writeTable(std::ostream& out, const std::vector<Run>& runs, int threads, bool* within) {
  out << "| pixels | texels | read | of the solve, levels | solve, in all | maps | predict | files to maps, "
         "s | texels/s, all | "
         "us a texel, all | steps a texel | fit rms / noise | peak, MiB |\n"
         "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n";
  for (const Run& run : runs) {
    if (run.threads != threads) continue;
    const Measured& m = run.measured;
    const auto stage = [&](const char* name) {
      const auto found = m.seconds.find(name);
      return found == m.seconds.end() ? std::string("-") : number(found->second, 2);
    };
    const bool bound = run.pixels == kPaperSize;
    out << "| " << run.pixels << " x " << run.pixels << " | " << number(m.texels, 0) << " | " << stage("read")
        << " | " << stage("levels") << " | "
        << (bound ? bounded(m.solve(), 2, kSolveBound, true, within) : number(m.solve(), 2)) << " | "
        << stage("maps") << " | " << stage("predict") << " | "
        << (bound ? bounded(m.total(), 1, kTotalBound, true, within) : number(m.total(), 1)) << " | "
        << number(m.texels / m.total(), 0) << " | " << number(1e6 * m.total() / m.texels, 1) << " | "
        << number(m.steps, 1) << " | " << number(m.fitRms / m.noiseFloor, 3) << " | "
        << (bound ? bounded(m.peakMib, 0, kMemoryBoundMib, true, within) : number(m.peakMib, 0)) << " |\n";
  }
}

void writeCores(std::ostream& out, const std::vector<Run>& runs, int threads) {
  const Run *one = nullptr, *all = nullptr;
  for (const Run& run : runs) {
    if (run.pixels != kTypical) continue;
    (run.threads == 1 ? one : all) = &run;
  }
  if (!one || !all || threads == 1) return;
  out << "\nOne core against " << threads << " at " << kTypical << " x " << kTypical << ": solve "
      << number(one->measured.solve(), 1) << " s against " << number(all->measured.solve(), 1) << " s ("
      << number(one->measured.solve() / all->measured.solve(), 2) << " times), all "
      << number(one->measured.total(), 1) << " s against " << number(all->measured.total(), 1) << " s ("
      << number(one->measured.total() / all->measured.total(), 2) << " times).\n";
}

void writeMachine(std::ostream& out, const MachineRate& rate, const std::vector<Run>& runs,
                  const std::map<std::string, double>& kernel, int threads, bool* within);

int run(int argc, char** argv) {
  CLI::App app("Measures the fit of large sheets and writes its part of the results page.");
  fs::path cache = fs::temp_directory_path() / "patina-speed",
           out = fs::path(PATINA_SOURCE_DIR) / "docs/results.md";
  fs::path bench, child, result;
  std::vector<int> sizes = {128, 256, 512, 1024};
  bool large = false;
  int threads = 0;
  app.add_option("--cache", cache, "folder that keeps the simulated captures: 1 GB, with --large 5 GB")
      ->capture_default_str();
  app.add_option("--out", out, "page to write");
  app.add_option("--sizes", sizes, "pixels on a side")->delimiter(',')->capture_default_str();
  app.add_flag("--large", large, "2048 x 2048 as well");
  app.add_option("--threads", threads, "0: all cores");
  app.add_option("--bench", bench, "patina-bench; default: beside this program");
  app.add_option("--child", child, "internal: fit this bundle, write --result, end")->group("");
  app.add_option("--result", result, "internal")->group("");
  CLI11_PARSE(app, argc, argv);
  if (threads <= 0) threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  if (!child.empty()) return fitHere(child, threads, result);

  const fs::path self = fs::read_symlink("/proc/self/exe");
  if (bench.empty()) bench = self.parent_path() / "patina-bench";
  if (large) sizes.push_back(kLarge);
  const MachineRate rate = measureMachine(threads);
  std::vector<Run> runs;
  fs::path benchBundle;
  for (const int pixels : sizes) {
    const Result<fs::path> bundle = captureOf(pixels, cache);
    if (!bundle) {
      std::cerr << bundle.error().sentence() << "\n";
      return 3;
    }
    if (benchBundle.empty() || pixels == kTypical) benchBundle = *bundle;
    for (const int cores : {1, threads}) {
      if (cores != threads && pixels != kTypical) continue;
      const auto measured = fitApart(self, *bundle, cores, cache);
      if (!measured) return 1;
      runs.push_back({pixels, cores, *measured});
      if (threads == 1) break;
    }
  }
  const std::map<std::string, double> ceres = againstCeres(bench, benchBundle, cache);

  bool within = true;
  std::ostringstream page;
  page
      << "## Speed of the Fourier fit\n\n"
         "Written by `packaging/speed` (tests/results/fourier_speed.cpp), not by hand. A simulated sheet of "
         "two "
         "glossy materials fills the camera's picture; 130\n"
         "photographs, the paper's set but for that of mirror and marker, half floats in ZIP-compressed "
         "OpenEXR. Default options; each fit in "
         "a "
         "process of its own. Where a bound is set it\n"
         "stands in brackets. A step is one evaluation of model, derivatives and cost; all starts of a texel "
         "count.\n\nMachine: "
      << machineDescription(threads) << ".\n\n";
  writeTable(page, runs, threads, &within);
  writeCores(page, runs, threads);
  for (const Run& run : runs) {
    if (run.pixels != kPaperSize || run.threads != threads) continue;
    page << "\nThe paper's two hours for this size on its authors' computer of 2013: "
         << number(kPaperSeconds / run.measured.total(), 0) << " times as long.\n";
  }
  if (ceres.contains("times_faster")) {
    page << "\n### Against a straightforward fit\n\n"
            "The same texels, measurements, weights, priors, starts and tolerance with Ceres (automatic "
            "derivatives, ten parameters, bounds, dense QR, double precision): "
            "tests/bench/fourier_baseline.cpp, "
            "one core.\n\n| | us a texel | steps a texel | mean cost |\n| --- | ---: | ---: | ---: |\n| ours "
            "| "
         << number(ceres.at("us_texel"), 1) << " | " << number(ceres.at("steps"), 1) << " | "
         << number(ceres.at("cost"), 2) << " |\n| Ceres | " << number(ceres.at("us_texel_ceres"), 1) << " | "
         << number(ceres.at("steps_ceres"), 1) << " | " << number(ceres.at("cost_ceres"), 2)
         << " |\n\nTimes faster: " << bounded(ceres.at("times_faster"), 0, kCeresBound, false, &within)
         << ". Texels whose cost is no higher than the baseline's (to a part in a thousand): "
         << number(100 * ceres.at("not_worse"), 1) << " %.\n";
  }
  writeMachine(page, rate, runs, ceres, threads, &within);
  if (!replacePagePart(out, "fourier-speed", page.str())) {
    std::cerr << "The page could not be written (" << out.string() << "). Try: another --out\n";
    return 3;
  }
  std::cerr << "Written to " << out.string() << "\n";
  if (!within) std::cerr << "Some figures are beyond their bounds; they are marked in the page.\n";
  return within ? 0 : 1;
}

void writeMachine(std::ostream& out, const MachineRate& rate, const std::vector<Run>& runs,
                  const std::map<std::string, double>& kernel, int threads, bool* within) {
  const double perCore = rate.allCoresMultiplyAddsPerSecond / threads;
  out << "\n### How far from the floor\n\nMeasured in the same run: "
      << number(1e-9 * rate.multiplyAddsPerSecond, 1)
      << " thousand million multiply-adds a second on one core (" << rate.instructions << ", " << rate.lanes
      << " lanes of single precision, twelve chains over registers), "
      << number(1e-9 * rate.allCoresMultiplyAddsPerSecond, 1) << " on " << threads << " together; memory "
      << number(1e-9 * rate.bytesPerSecond, 1) << " GB/s.\n";
  for (const Run& run : runs) {
    // The usual size, or the only one that was measured.
    if (run.threads != threads || (run.pixels != kTypical && &run != &runs.back())) continue;
    const Measured& m = run.measured;
    if (!(m.operations > 0)) break;
    const bool measured = kernel.contains("floor_times");
    const double operations = measured ? kernel.at("operations") : m.operations;
    out << "\nA step of a texel takes " << number(m.operations, 0)
        << " additions and multiplications with this capture's frequencies (`solverOperations`) as long as "
           "no "
           "lobe has decayed anywhere";
    if (measured)
      out << ", " << number(operations, 0) << " at the " << number(100 * kernel.at("lit"), 0)
          << " % of frequencies where the texels' lobes are still there";
    out << ". The floor is that count at two operations a multiply-add.\n\n"
           "| | us of one core a step | of the floor, times |\n| --- | ---: | ---: |\n| the floor | "
        << number(1e6 * operations / 2 / perCore, 3) << " | 1 |\n";
    if (measured)  // its own core's rate, taken in turn with it
      out << "| the solver alone, one core, 2,048 texels from one start | " << number(kernel.at("us_step"), 3)
          << " | " << bounded(kernel.at("floor_times"), 1, kFloorBound, true, within) << " |\n";
    const double step = m.stage("solve") * threads / (m.texels * m.steps);
    out << "| everything in the stage `solve` at " << run.pixels << " x " << run.pixels << " | "
        << number(1e6 * step, 3) << " | " << number(step * perCore * 2 / operations, 1) << " |\n";
    if (measured)
      out << "\nBesides its steps, each texel of the stage is gathered with its neighbours ("
          << number(kernel.at("us_gather"), 2) << " us) and gets albedos from its own measurements ("
          << number(kernel.at("us_albedos"), 2) << " us).\n";
    out << "\nWhere the rest goes: [fourier_speed.md](fourier_speed.md).\n";
    break;
  }
}

}  // namespace
}  // namespace patina::test

int main(int argc, char** argv) {
  return patina::test::run(argc, argv);
}
