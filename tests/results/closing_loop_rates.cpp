// How often closing the loop is right: draws captures, simulates them, explains them, compares with what was
// done, and writes the part "closing-loop" of docs/results.md. Run by packaging/rates. Goes on where it was
// stopped.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <iterator>
#include <mutex>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "engine/base/job.h"
#include "engine/capture/capture.h"
#include "engine/diagnosis/explanation.h"
#include "engine/fourier/fit.h"
#include "tests/results/closing_loop_draw.h"
#include "tests/results/closing_loop_scores.h"
#include "tests/results/page_part.h"
#include "tests/results/truth_compare.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;

struct Plan {
  int bundles = 100;
  std::uint64_t seed = 1;
  std::string strength = "both";
  bool pairs = false, clean = false, curve = false, again = false, fitOnly = false, simulateOnly = false,
       told = false;
  int pixels = 0, threads = 0;
  fs::path cache, page, images, csv;
};

/// A bundle to be: what is drawn, and under which name it is kept.
struct Item {
  std::string kind, name;
  double factor = 1;
  DrawnCapture drawn;
};

/// The effects in an order that the seed gives, so that every one comes up equally often.
std::vector<std::string> shuffled(std::vector<std::string> list, std::uint64_t seed) {
  std::mt19937_64 bits(seed * 31 + 7);
  for (std::size_t i = list.size(); i > 1; --i) std::swap(list[i - 1], list[bits() % i]);
  return list;
}

/// Pairs that no photograph of the capture tells apart from either alone aren't asked for.
bool tellable(const std::string& a, const std::string& b) {
  const auto is = [&](const char* x, const char* y) { return (a == x && b == y) || (a == y && b == x); };
  return a != b && !is("saturation", "camera-response") && !is("screen-pose", "sample-height");
}

std::vector<Item> itemsOf(const Plan& plan) {
  std::vector<Item> items;
  const auto add = [&](const std::string& kind, int number, const std::vector<std::string>& effects,
                       DrawStrength strength, double factor = 1) {
    const std::uint64_t group = kind == "strong"  ? 1
                                : kind == "weak"  ? 2
                                : kind == "pairs" ? 3
                                : kind == "clean" ? 4
                                                  : 5;
    const std::uint64_t seed = (plan.seed * 10 + group) * 100000 + static_cast<std::uint64_t>(number);
    Item item{kind,
              kind + "_" + std::to_string(seed) + (plan.pixels > 0 ? "_" + std::to_string(plan.pixels) : ""),
              factor, drawCapture(seed, effects, strength, plan.pixels, factor)};
    items.push_back(std::move(item));
  };
  const std::vector<std::string> strong = shuffled(drawnEffects(DrawStrength::Strong), plan.seed),
                                 weak = shuffled(drawnEffects(DrawStrength::Weak), plan.seed);
  for (int i = 0; i < plan.bundles; ++i) {
    const auto n = static_cast<std::size_t>(i);
    if (plan.strength == "strong" || plan.strength == "both")
      add("strong", i, {strong[n % strong.size()]}, DrawStrength::Strong);
    if (plan.strength == "weak" || plan.strength == "both")
      add("weak", i, {weak[n % weak.size()]}, DrawStrength::Weak);
    if (plan.clean) add("clean", i, {}, DrawStrength::Weak);
    if (plan.pairs) {
      const std::string& first = strong[n % strong.size()];
      std::size_t step = 1 + (n / strong.size()) % (strong.size() - 1);
      while (!tellable(first, strong[(n + step) % strong.size()])) ++step;
      add("pairs", i, {first, strong[(n + step) % strong.size()]}, DrawStrength::Strong);
    }
    if (plan.curve) {
      constexpr double kFactors[] = {0.125, 0.25, 0.5, 1, 2, 4};
      // Each effect goes through all strengths before the next round of effects.
      const std::size_t which = n / std::size(kFactors);
      add("curve", i, {weak[which % weak.size()]}, DrawStrength::Weak, kFactors[n % std::size(kFactors)]);
    }
  }
  return items;
}

std::string readText(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

void mapErrors(const FourierFit& fit, const fs::path& bundle, double& normalDeg, double& sigma) {
  const Result<TruthMaps> truth = readTruth(bundle);
  if (!truth) return;
  const TruthErrors errors = compareWithTruth(fit.maps(), *truth);
  if (errors.compared == 0) return;
  normalDeg = errors.normalDeg.median;
  sigma = errors.sigma.median;
}

void fitAlone(const fs::path& bundle, const JobContext& job, LoopOutcome& outcome) {
  const Result<FourierCapture> capture = readFourierCapture(bundle, job);
  if (!capture) {
    outcome.failure = capture.error().sentence();
    return;
  }
  const auto fit = fitFourier(*capture, FourierFitOptions{}, job);
  if (!fit) {
    outcome.failure = fit.error().sentence();
    return;
  }
  outcome.noiseFloor = (*fit)->stats().noiseFloorHoldout;
  outcome.holdoutBefore = (*fit)->stats().holdoutRms;
  mapErrors(**fit, bundle, outcome.normalBeforeDeg, outcome.sigmaBefore);
}

#ifdef PATINA_HAS_EXPLAIN
/// What a fit reaches that is told which effects are in the photographs.
void tellIt(const fs::path& bundle, const JobContext& job, LoopOutcome& outcome) {
  ExplainOptions options;
  options.pictures = false;
  const Result<ExplanationPtr> told = explainWith({bundle}, outcome.truth, options, job);
  if (!told) return;  // an effect that no fit can be told of: no figure
  outcome.holdoutTold = (*told)->after.holdoutRms;
  if ((*told)->fourierAfter)
    mapErrors(*(*told)->fourierAfter, bundle, outcome.normalToldDeg, outcome.sigmaTold);
}
#endif

void explainIt(const fs::path& bundle, const JobContext& job, LoopOutcome& outcome) {
#ifdef PATINA_HAS_EXPLAIN
  ExplainOptions options;
  options.pictures = false;
  const Result<ExplanationPtr> explained = explain({bundle}, options, job);
  if (!explained) {
    outcome.failure = explained.error().sentence();
    return;
  }
  const Explanation& e = **explained;
  for (const EffectFinding& finding : e.effects) {
    outcome.named.push_back(finding.id);
    outcome.confidence.push_back(finding.confidence);
  }
  outcome.confusable = e.confusable;
  if (!e.considered.empty()) outcome.runnerUp = e.considered.front().id;
  outcome.noiseFloor = e.noiseFloorHoldout;
  outcome.holdoutBefore = e.before.holdoutRms;
  outcome.holdoutAfter = e.after.holdoutRms;
  if (e.fourierBefore) mapErrors(*e.fourierBefore, bundle, outcome.normalBeforeDeg, outcome.sigmaBefore);
  if (e.fourierAfter) mapErrors(*e.fourierAfter, bundle, outcome.normalAfterDeg, outcome.sigmaAfter);
#else
  fitAlone(bundle, job, outcome);
#endif
}

/// What the sensor's noise alone leaves of the held-out photographs' relative error, from the noise that was
/// simulated: a fit's own estimate takes flicker for noise. -1 where the bundle has no truth.
double trueNoiseFloor(const fs::path& bundle) {
  const nlohmann::json truth = nlohmann::json::parse(readText(bundle / "truth/truth.json"), nullptr, false);
  const Result<FourierCapture> capture = readFourierCapture(bundle);
  if (!truth.is_object() || !capture) return -1;
  const double full = truth.at("camera_full_scale"), shot = truth.at("noise").at("shot"),
               read = truth.at("noise").at("read");
  double variance = 0, energy = 0;
  for (const FourierPhoto& photo : capture->photos) {
    if (!photo.holdout) continue;
    const Result<Image> image = readPhoto(*capture, photo);
    if (!image) return -1;
    for (const float sample : image->samples()) {
      variance += full * shot * std::max(0.0f, sample) + read * read * full * full;
      energy += static_cast<double>(sample) * sample;
    }
  }
  return energy > 0 ? std::sqrt(variance / energy) : -1;
}

/// How far a strong effect must raise the held-out error over the noise, and how it is made stronger until
/// then.
constexpr double kStrongRise = 1.5;
constexpr double kFactors[] = {1, 1.6, 2.5, 4};
constexpr int kOtherSheets = 4;  ///< a matte sheet never shows some effects; then another is drawn

/// Whether what was asked for happened: a sensor that clips above everything that it was shown did nothing.
bool happened(const DrawnCapture& drawn, const fs::path& bundle) {
  if (std::ranges::find(drawn.effects, "saturation") == drawn.effects.end()) return true;
  const double level = drawn.options.effects.saturation.level;
  const nlohmann::json truth = nlohmann::json::parse(readText(bundle / "truth/truth.json"), nullptr, false);
  const Result<FourierCapture> capture = readFourierCapture(bundle);
  if (!truth.is_object() || !capture) return false;
  const double full = truth.at("camera_full_scale");
  std::size_t clipped = 0;
  for (const FourierPhoto& photo : capture->photos) {
    const Result<Image> image = readPhoto(*capture, photo);
    if (!image) return false;
    for (const float sample : image->samples()) clipped += sample >= 0.999 * level * full;
  }
  return clipped >= 200;  // samples: a few pixels of a few photographs
}

/// Makes a strong item strong: the smallest factor, on the first sheet, for which a fit is half more wrong
/// than the noise. Remembers it beside the bundle. False where nothing is strong enough.
bool strengthen(Item& item, const Plan& plan, const JobContext& job) {
  const fs::path bundle = plan.cache / item.name, file = plan.cache / (item.name + ".factor");
  const std::uint64_t seed = item.drawn.seed;
  const auto drawAgain = [&](int sheet, double factor) {
    return drawCapture(seed + static_cast<std::uint64_t>(sheet) * 50000, item.drawn.effects,
                       DrawStrength::Strong, plan.pixels, factor);
  };
  int sheet = 0;
  double factor = 0;
  if (std::ifstream in(file); in >> sheet >> factor && factor > 0) {
    item.drawn = drawAgain(sheet, factor), item.factor = factor;
    return true;
  }
  for (sheet = 0; sheet < kOtherSheets; ++sheet) {
    double last = -1;
    for (const double tried : kFactors) {
      const DrawnCapture drawn = drawAgain(sheet, tried);
      if (drawn.strength == last) break;  // as strong as one meets
      last = drawn.strength;
      if (!simulateDrawn(drawn, bundle, job) || !happened(drawn, bundle)) continue;
      LoopOutcome fitted;
      fitAlone(bundle, job, fitted);
      const double floor = trueNoiseFloor(bundle);
      if (!fitted.failure.empty() || !(fitted.holdoutBefore >= kStrongRise * floor)) continue;
      item.drawn = drawn, item.factor = tried;
      std::ofstream(file) << sheet << ' ' << tried << '\n';
      return true;
    }
  }
  return false;
}

/// A weak item whose effect does something: on the first of some sheets. False where none of them.
bool makeHappen(Item& item, const Plan& plan, const JobContext& job) {
  const std::uint64_t seed = item.drawn.seed;
  for (int sheet = 0; sheet < kOtherSheets; ++sheet) {
    if (sheet > 0)
      item.drawn = drawCapture(seed + static_cast<std::uint64_t>(sheet) * 50000, item.drawn.effects,
                               DrawStrength::Weak, plan.pixels, item.factor);
    if (simulateDrawn(item.drawn, plan.cache / item.name, job) &&
        happened(item.drawn, plan.cache / item.name))
      return true;
  }
  return false;
}

/// Keeps what the engine says of its search, for whoever looks into an answer.
class LogFile : public LogSink {
 public:
  explicit LogFile(const fs::path& file) : out_(file) {}
  void log(Level, std::string_view sentence) override {
    const std::lock_guard lock(mutex_);
    out_ << sentence << '\n';
  }

 private:
  std::mutex mutex_;
  std::ofstream out_;
};

/// What is known of an item: from the file of an earlier run, or worked out now. False where it was stopped.
bool outcomeOf(Item& item, const Plan& plan, LoopOutcome& outcome) {
  const fs::path bundle = plan.cache / item.name,
                 file = plan.cache / (item.name + (plan.fitOnly ? ".fit.json" : ".json"));
  JobContext job;
  job.threads = plan.threads;
  const bool strong = item.kind == "strong" || item.kind == "pairs";
  const bool strongEnough =
      strong ? strengthen(item, plan, job) : item.kind != "weak" || makeHappen(item, plan, job);
  const std::vector<std::string> truth = item.drawn.options.effects.ids();
  if (!plan.again && outcomeFromJson(readText(file), outcome) && outcome.strength == item.drawn.strength &&
      outcome.field == item.drawn.strengthField)
    return true;
  outcome = {};
  outcome.kind = item.kind, outcome.seed = item.drawn.seed, outcome.truth = item.drawn.effects;
  outcome.field = item.drawn.strengthField, outcome.strength = item.drawn.strength,
  outcome.factor = item.factor;
  if (truth.size() != item.drawn.effects.size()) {
    outcome.failure = "the draw switched on something else than was asked for";
    return true;
  }
  if (!strongEnough) {
    outcome.kind = "never strong";  // counted, and in no rate
    return true;
  }
  if (const Status made = simulateDrawn(item.drawn, bundle, job); !made) {
    outcome.failure = "simulation: " + made.error().sentence();
    return true;
  }
  if (plan.simulateOnly) return true;
  const auto start = std::chrono::steady_clock::now();
  if (plan.fitOnly) {
    fitAlone(bundle, job, outcome);
  } else {
    LogFile log(plan.cache / (item.name + ".log"));
    JobContext logged = job;
    logged.logSink = &log;
    explainIt(bundle, logged, outcome);
#ifdef PATINA_HAS_EXPLAIN
    if (plan.told && outcome.failure.empty() && (item.kind == "strong" || item.kind == "pairs"))
      tellIt(bundle, job, outcome);
#endif
  }
  if (const double floor = trueNoiseFloor(bundle); floor > 0) outcome.noiseFloor = floor;
  outcome.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const fs::path partial = file.string() + ".new";
  std::ofstream(partial) << outcomeJson(outcome);
  std::error_code error;
  fs::rename(partial, file, error);
  return !error;
}

int run(const Plan& plan) {
  std::error_code error;
  fs::create_directories(plan.cache, error);
  std::vector<Item> items = itemsOf(plan);
  std::vector<LoopOutcome> outcomes;
  for (std::size_t i = 0; i < items.size(); ++i) {
    LoopOutcome outcome;
    if (!outcomeOf(items[i], plan, outcome)) {
      std::cerr << "the result could not be kept in " << plan.cache << "\n";
      return 1;
    }
    std::fprintf(stderr, "%zu of %zu  %s  %s ->", i + 1, items.size(), items[i].name.c_str(),
                 items[i].drawn.summary.c_str());
    for (std::size_t k = 0; k < outcome.named.size(); ++k)
      std::fprintf(stderr, " %s (%.2f)", outcome.named[k].c_str(), outcome.confidence[k]);
    std::fprintf(stderr, "%s held out %.3f -> %.3f of the noise, %.0f s\n",
                 !outcome.failure.empty() ? (" " + outcome.failure).c_str()
                 : outcome.named.empty()  ? " nothing"
                                          : "",
                 outcome.holdoutBefore / outcome.noiseFloor, outcome.holdoutAfter / outcome.noiseFloor,
                 outcome.seconds);
    outcomes.push_back(std::move(outcome));
  }
  if (plan.simulateOnly) return 0;
  std::ofstream(plan.csv) << loopCsv(outcomes);
  if (plan.fitOnly) return 0;
  const int threads = plan.threads > 0 ? plan.threads : static_cast<int>(std::thread::hardware_concurrency());
  const LoopPage page = loopPage(outcomes, plan.seed, machineDescription(threads));
  fs::create_directories(plan.images, error);
  for (const auto& [name, chart] : page.charts) std::ofstream(plan.images / name) << chart;
  if (!replacePagePart(plan.page, "closing-loop", page.markdown)) {
    std::cerr << "could not write " << plan.page << "\n";
    return 1;
  }
  std::cout << page.markdown;
  return page.markdown.find("**missed**") == std::string::npos ? 0 : 2;
}

}  // namespace
}  // namespace patina::test

int main(int argc, char** argv) {
  using namespace patina::test;
  namespace fs = std::filesystem;
  Plan plan;
  plan.cache = fs::temp_directory_path() / "patina-closing-loop";
  plan.page = fs::path(PATINA_SOURCE_DIR) / "docs/results.md";
  plan.images = fs::path(PATINA_SOURCE_DIR) / "docs/images";
  CLI::App app(
      "Draws captures with effects that nobody declares, explains them, and writes how often that was right");
  app.add_option("--bundles", plan.bundles, "Captures of each kind [default: 100]")
      ->check(CLI::Range(1, 99999));
  app.add_option("--seed", plan.seed, "Of the draw; a new one for every release [default: 1]");
  app.add_option("--strength", plan.strength,
                 "Captures with one effect: strong, weak, both or none [default: both]")
      ->check(CLI::IsMember({"strong", "weak", "both", "none"}));
  app.add_flag("--pairs", plan.pairs, "Also captures with two effects");
  app.add_flag("--clean", plan.clean, "Also captures without any");
  app.add_flag("--curve", plan.curve, "Also captures from an eighth to four times the weak strength");
  app.add_option("--pixels", plan.pixels, "Side of the pictures; 0: 40 to 64, drawn [default: 0]");
  app.add_option("--threads", plan.threads, "0: one a core [default: 0]");
  app.add_option("--cache", plan.cache, "Folder where captures and what came out are kept");
  app.add_option("--page", plan.page, "The page whose part is written");
  app.add_option("--images", plan.images, "Folder for its charts");
  app.add_option("--csv", plan.csv, "Table, a line a capture [default: results.csv in the cache]");
  app.add_flag("--told", plan.told, "Also fit with the effects that are in it told, for the errors' ratio");
  app.add_flag("--again", plan.again, "Explain again what was explained already (the captures stay)");
  app.add_flag("--fit-only", plan.fitOnly,
               "Only fit: how far each effect raises the held-out error; no page");
  app.add_flag("--simulate-only", plan.simulateOnly, "Only make the captures");
  CLI11_PARSE(app, argc, argv);
  if (plan.csv.empty()) plan.csv = plan.cache / (plan.fitOnly ? "fits.csv" : "results.csv");
  return run(plan);
}
