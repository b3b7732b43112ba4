// What a fit costs that knows of an effect, beside the plain fit: processor seconds by stage on one core.
#include <benchmark/benchmark.h>
#include <time.h>

#include <cmath>
#include <functional>
#include <map>
#include <mutex>
#include <string>

#include "engine/base/job.h"
#include "engine/fourier/corrections.h"
#include "engine/fourier/fit_access.h"
#include "tests/bench/bench_capture.h"

namespace patina::bench {
namespace {

/// Processor time by what the fit says it is doing: what else runs on the machine is not counted.
class StageTimes : public ProgressSink {
 public:
  void progress(std::string_view stage, std::int64_t, std::int64_t, std::string_view) override {
    std::scoped_lock lock(mutex_);
    pass(stage);
  }
  void finish() { pass(""); }
  std::map<std::string, double> seconds;

 private:
  void pass(std::string_view stage) {
    timespec time{};
    ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    const double now = static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
    // The time up to the stage's first word belongs to it, too.
    if (last_ > 0) seconds[std::string(stage.empty() ? stage_ : std::string(stage))] += now - last_;
    last_ = now;
    stage_ = stage;
  }
  std::mutex mutex_;
  double last_ = 0;
  std::string stage_;
};

struct Timed {
  std::shared_ptr<const FourierFit> fit;
  std::map<std::string, double> seconds;
  double solve() const {
    double all = 0;
    for (const char* stage : {"solve", "rescue"})
      if (const auto found = seconds.find(stage); found != seconds.end()) all += found->second;
    return all;
  }
  double total() const {
    double all = 0;
    for (const auto& [stage, value] : seconds) all += value;
    return all;
  }
};

Timed timedFit(const FourierCapture& capture, const FourierFitOptions& options) {
  StageTimes times;
  JobContext job;
  job.threads = 1;
  job.progressSink = &times;
  times.progress("read", 0, 1, "");
  const auto fit = fitFourier(capture, options, job);
  times.finish();
  return {fit ? *fit : nullptr, times.seconds};
}

/// The plain fit, once.
const Timed& plainFit(const FourierCapture& capture) {
  static const Timed plain = timedFit(capture, {});
  return plain;
}

using Fill = std::function<void(FourierCorrections&, const FourierCapture&)>;

// Counters: processor seconds of solving (with rescues; without coarse levels also with the geometry before
// it, 0.2 s) and of everything, ratios to the plain fit's, Newton
// steps a texel.
void correctedFit(benchmark::State& state, bool warm, const Fill& fill) {
  const Result<FourierCapture>& capture = benchCapture();
  if (!capture) return state.SkipWithError(capture.error().sentence().c_str());
  const Timed& plain = plainFit(*capture);
  if (!plain.fit) return state.SkipWithError("the plain fit failed");
  FourierCorrections corrections;
  fill(corrections, *capture);
  if (warm)
    corrections.sites = std::make_shared<const std::vector<SvbrdfParameters>>(fitState(*plain.fit).sites);
  FourierFitOptions options;
  options.corrections = std::make_shared<const FourierCorrections>(std::move(corrections));
  Timed timed;
  for (auto _ : state) timed = timedFit(*capture, options);
  if (!timed.fit) return state.SkipWithError("the corrected fit failed");
  state.counters["solve"] = timed.solve();
  state.counters["solve/plain"] = timed.solve() / plain.solve();
  state.counters["all"] = timed.total();
  state.counters["all/plain"] = timed.total() / plain.total();
  state.counters["steps"] = timed.fit->stats().meanIterations;
  state.counters["steps/plain"] = timed.fit->stats().meanIterations / plain.fit->stats().meanIterations;
  for (const auto& [stage, seconds] : timed.seconds) state.counters["seconds/" + stage] = seconds;
}

void nothing(FourierCorrections&, const FourierCapture&) {}

void camera(FourierCorrections& c, const FourierCapture& capture) {
  c.linearFromPhoto = [](float x) { return std::copysign(std::pow(std::abs(x), 1.02f), x); };
  c.unmix << 1.01f, -0.01f, 0, 0, 1.01f, -0.01f, 0, -0.01f, 1.01f;
  for (std::size_t i = 0; i < capture.photos.size(); ++i) {
    c.photoGain.push_back(1 + 0.001f * static_cast<float>(i % 7));
    c.photoOffset.push_back(Eigen::Array3f::Constant(1e-5f * static_cast<float>(i % 5)));
  }
}

void emission(FourierCorrections& c, const FourierCapture&) {
  c.logEmission = [](const Eigen::Vector2d& x, const Eigen::Vector2d& foot, double distance) {
    const double tangent2 = (x - foot).squaredNorm() / (distance * distance);
    return std::log(1 - 0.1 * tangent2 / (1 + tangent2)) + 0.02 * x.x();
  };
}

void height(FourierCorrections& c, const FourierCapture&) {
  c.heightMm = [](const Eigen::Vector2d& p) { return 1e-4 * p.x() * p.x(); };
}

void extra(FourierCorrections& c, const FourierCapture&) {
  c.extra = [](std::size_t, bool, float* z, float* even, float* window) {
    z[0] += 1e-6f, even[0] += 1e-6f, window[0] += 1e-6f;
  };
}

void stretched(FourierCorrections& c, const FourierCapture&) {
  c.lobeTerms = std::make_shared<const std::vector<LobeTerms>>(1, LobeTerms{{0.02f, 0.01f}, 0, 1});
}

void third(FourierCorrections& c, const FourierCapture&) {
  c.lobeTerms = std::make_shared<const std::vector<LobeTerms>>(1, LobeTerms{{0.02f, 0.01f}, 0.02f, 4});
}

#define PATINA_CORRECTED(NAME, WARM, FILL)           \
  void BM_Corrected##NAME(benchmark::State& state) { \
    correctedFit(state, WARM, FILL);                 \
  }                                                  \
  BENCHMARK(BM_Corrected##NAME)->Unit(benchmark::kSecond)->MeasureProcessCPUTime()->Iterations(1)
PATINA_CORRECTED(ByNothing, false, nothing);
PATINA_CORRECTED(ByNothingFromThePlainFit, true, nothing);
PATINA_CORRECTED(Camera, false, camera);
PATINA_CORRECTED(CameraFromThePlainFit, true, camera);
PATINA_CORRECTED(EmissionFromThePlainFit, true, emission);
PATINA_CORRECTED(EmissionTwice, false, emission);
PATINA_CORRECTED(Height, false, height);
PATINA_CORRECTED(HeightFromThePlainFit, true, height);
PATINA_CORRECTED(ExtraFromThePlainFit, true, extra);
PATINA_CORRECTED(Stretched, false, stretched);
PATINA_CORRECTED(StretchedFromThePlainFit, true, stretched);
PATINA_CORRECTED(StretchedAndThird, false, third);
PATINA_CORRECTED(StretchedAndThirdFromThePlainFit, true, third);
#undef PATINA_CORRECTED

}  // namespace
}  // namespace patina::bench
