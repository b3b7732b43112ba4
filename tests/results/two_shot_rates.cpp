// How often closing the loop is right on two-shot captures: draws captures, simulates them, explains them,
// compares with what was done, and writes the part "closing-loop two-shot" of docs/results.md. Run by
// packaging/rates two-shot. Goes on where it was stopped: each outcome is a line of a file.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <thread>

#include "engine/diagnosis/two_shot_explain.h"
#include "engine/diagnosis/two_shot_odds.h"
#include "engine/twoshot/basis_subset.h"
#include "engine/twoshot/fit.h"
#include "tests/base/temp_folder.h"
#include "tests/diagnosis/two_shot_draws.h"
#include "tests/results/page_part.h"
#include "tests/results/two_shot_rates_page.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;

struct Plan {
  int bundles = 100, first = 0, threads = 0;
  std::uint64_t seed = 1;
  double singles = 0.6, pairs = 0.1;  // the rest is clean
  bool pageOnly = false;
  std::vector<std::string> only;
  fs::path log, page, images;
};

/// What is in capture number `i` of a seed: nothing, one effect or two, of a strength between a third and
/// three times what one meets.
struct Draw {
  unsigned seed = 0;
  double scale = 1;
  std::vector<std::string> effects;
};

/// Effects that pairs are made of: those that single captures show.
bool pairable(const std::string& a, const std::string& b) {
  const auto light = [](const std::string& id) {
    return id == "stray-light" || id == "black-level" || id == "glare";
  };
  return a != b && !(light(a) && light(b));
}

Draw drawOf(const Plan& plan, int i) {
  Draw draw;
  draw.seed = static_cast<unsigned>(plan.seed * 100000 + static_cast<std::uint64_t>(i));
  std::mt19937_64 bits(draw.seed * 31ull + 7);
  const auto uniform = [&] { return static_cast<double>(bits() >> 11) * 0x1p-53; };
  const double kind = uniform();
  draw.scale = std::exp((2 * uniform() - 1) * std::log(3.0));
  std::vector<std::string> ids = plan.only;
  if (ids.empty()) {
    // What a rig has oftenest comes twice as often.
    ids = drawnEffectIds();
    for (const char* often : {"sample-tilt", "near-light", "vignetting", "stray-light", "exposure-mismatch",
                              "clearcoat", "retroreflection"})
      ids.emplace_back(often);
  }
  const auto any = [&] { return ids[bits() % ids.size()]; };
  if (kind < plan.singles) {
    draw.effects = {any()};
  } else if (kind < plan.singles + plan.pairs) {
    draw.effects = {any(), any()};
    while (!pairable(draw.effects[0], draw.effects[1])) draw.effects[1] = any();
  }
  return draw;
}

nlohmann::json evidenceJson(const TwoShotEvidence& e) {
  return {{"id", e.id},
          {"variant", e.variant},
          {"surface", e.surface},
          {"lobe", e.lobe},
          {"heldOnly", e.heldOnly},
          {"free", e.free},
          {"refined", e.refined},
          {"held", e.held},
          {"sensible", e.sensible},
          {"lnEvidence", e.lnEvidence},
          {"lnHeld", e.lnHeld},
          {"lnAround", e.lnAround},
          {"reach", e.reach},
          {"first", e.first},
          {"firstSd", e.firstSd},
          {"grain", e.grain},
          {"fine", e.fine},
          {"broad", e.broad},
          {"fitRatio", e.fitRatio},
          {"heldRatio", e.heldRatio},
          {"heldBetter", e.heldBetter},
          {"heldWorst", e.heldWorst},
          {"whole", e.wholeRatio},
          {"wholeSum", e.wholeSumRatio},
          {"wholeFit", e.wholeFitRatio}};
}

TwoShotEvidence evidenceOfJson(nlohmann::json line) {
  // What isn't finite was written as null: it says nothing.
  for (auto it = line.begin(); it != line.end();) it = it->is_null() ? line.erase(it) : std::next(it);
  TwoShotEvidence e;
  e.id = line.value("id", ""), e.variant = line.value("variant", "");
  e.surface = line.value("surface", false), e.lobe = line.value("lobe", false);
  e.heldOnly = line.value("heldOnly", e.variant == "of held-out photographs");
  e.free = line.value("free", e.id == "basis-deviation");
  e.refined = line.value("refined", false), e.held = line.value("held", false);
  e.sensible = line.value("sensible", true);
  e.lnEvidence = line.value("lnEvidence", 0.0), e.lnHeld = line.value("lnHeld", 0.0);
  e.lnAround = line.value("lnAround", 0.0), e.reach = line.value("reach", 0.0);
  e.fitRatio = line.value("fitRatio", 1.0), e.heldRatio = line.value("heldRatio", 1.0);
  e.heldBetter = line.value("heldBetter", 0.0), e.heldWorst = line.value("heldWorst", 1.0);
  return e;
}

/// Fits the weights of the evidence to the first rounds of all captures in the logs, and prints them with
/// what they would have answered.
int weigh(const std::vector<fs::path>& logs) {
  std::vector<WeighedCapture> captures;
  std::vector<std::string> names;
  std::vector<std::vector<std::string>> ids;
  for (const fs::path& log : logs) {
    std::ifstream in(log);
    for (std::string text; std::getline(in, text);) {
      const auto line = nlohmann::json::parse(text, nullptr, false);
      if (!line.is_object() || !line.contains("rounds") || line.at("rounds").empty()) continue;
      std::set<std::string> truth;
      for (const std::string id : line.at("truth")) {
        truth.insert(id);
        if (id == "black-level") truth.insert("stray-light");  // one group where all exposures are alike
      }
      if (truth.contains("saturation")) continue;  // told by its plateau, not by evidence
      std::vector<TwoShotEvidence> round;
      double around = 0;
      for (const auto& one : line.at("rounds").front()) {
        const TwoShotEvidence e = evidenceOfJson(one);
        if (!answerable(e)) continue;
        around = std::max(around, e.lnAround);
        round.push_back(e);
      }
      WeighedCapture capture;
      ids.emplace_back();
      for (const TwoShotEvidence& e : round) {
        capture.tried.push_back(featuresOf(e, around));
        capture.right.push_back(truth.contains(e.id));
        ids.back().push_back(e.id);
      }
      captures.push_back(std::move(capture));
      const TwoShotOutcome o = outcomeOfLine(text);
      names.push_back(o.kind + " " + o.sentence());
    }
  }
  const EvidenceFeatures w = fitEvidenceWeights(captures, evidenceWeightsBefore(), 1.0);
  for (std::size_t c = 0; c < captures.size(); ++c) {
    std::vector<double> odds;
    for (const EvidenceFeatures& x : captures[c].tried) odds.push_back(w.dot(x));
    const std::vector<double> p = probabilitiesOf(odds);
    std::map<std::string, double> share;
    double nothing = 1;
    for (std::size_t i = 0; i < p.size(); ++i) share[ids[c][i]] += p[i], nothing -= p[i];
    std::vector<std::pair<double, std::string>> order{{nothing, "nothing"}};
    for (const auto& [id, value] : share) order.emplace_back(value, id);
    std::sort(order.rbegin(), order.rend());
    std::printf("%s |", names[c].c_str());
    for (std::size_t k = 0; k < std::min<std::size_t>(3, order.size()); ++k)
      std::printf(" %s %.2f", order[k].second.c_str(), order[k].first);
    std::printf("\n");
  }
  std::printf("%zu captures:", captures.size());
  for (const double value : w) std::printf(" %.3f,", value);
  std::printf("\n");
  return 0;
}

double medianShare(const fs::path& bundle, const BasisPtr& basis, const JobContext& job) {
  const auto capture = readTwoShotCapture(bundle, job);
  if (!capture) return -1;
  const auto fit = fitTwoShot(*capture, basis, {}, job);
  return fit ? (*fit)->stats.holdoutRms : -1;
}

/// The first effect's parameter as the search writes it, for a look at its uncertainty; 0 where they can't be
/// compared.
double trueFirst(const TwoShotDraw& draw) {
  if (draw.effects.size() != 1) return 0;
  const TwoShotEffects& e = draw.scene.effects;
  const std::string& id = draw.effects[0];
  if (id == "sample-tilt") return -e.normalLeansDeg.y();
  if (id == "near-light") return 1000 / e.lightDistanceMm;
  if (id == "vignetting") return 2 * e.vignetting;
  if (id == "glare") return e.glareShare;
  return 0;
}

/// One capture, explained; a line of the log.
std::string lineOf(const Plan& plan, const Draw& draw, const BasisPtr& whole) {
  const TwoShotDraw made = drawTwoShot(draw.seed, draw.effects, draw.scale);
  nlohmann::json line{{"seed", draw.seed},         {"scale", draw.scale},   {"truth", draw.effects},
                      {"material", made.material}, {"family", made.family}, {"draw", kTwoShotDrawVersion}};
  line["first"] = trueFirst(made);
  const TempFolder folder;
  JobContext job;
  job.seed = draw.seed, job.threads = plan.threads;
  const BasisPtr basis = made.leftOut >= 0 ? basisWithout(whole, {made.leftOut}) : whole;
  const auto fail = [&](const std::string& why) {
    line["failure"] = why;
    return line.dump();
  };
  if (const auto simulated = simulateTwoShot(made.scene, folder / "b", job); !simulated)
    return fail("simulation: " + simulated.error().sentence());
  const auto start = std::chrono::steady_clock::now();
  ExplainOptions options;
  options.pictures = false;
  TwoShotRounds rounds;
  const auto found = explainTwoShotWith(basis, {folder / "b"}, options, job, &rounds);
  if (!found) return fail(found.error().sentence());
  line["seconds"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const Explanation& e = **found;
  line["named"] = nlohmann::json::array(), line["confidence"] = nlohmann::json::array();
  for (const EffectFinding& effect : e.effects) {
    line["named"].push_back(effect.id);
    line["confidence"].push_back(effect.confidence);
  }
  line["confusable"] = e.confusable;
  line["noise"] = e.noiseFloorHoldout;
  line["before"] = e.before.holdoutRms, line["after"] = e.after.holdoutRms;
  line["clean"] = e.before.holdoutRms;
  if (!draw.effects.empty()) {
    const auto simulated = simulateTwoShot(made.clean, folder / "clean", job);
    line["clean"] = simulated ? medianShare(folder / "clean", basis, job) : -1.0;
  }
  for (const auto& round : rounds) {
    nlohmann::json list = nlohmann::json::array();
    for (const TwoShotEvidence& one : round) list.push_back(evidenceJson(one));
    line["rounds"].push_back(std::move(list));
  }
  return line.dump();
}

int run(const Plan& plan) {
  std::map<unsigned, std::string> known;
  if (std::ifstream in(plan.log); in)
    for (std::string text; std::getline(in, text);) {
      const auto line = nlohmann::json::parse(text, nullptr, false);
      if (line.is_object() && line.value("draw", 0) == kTwoShotDrawVersion)
        known[line.at("seed").get<unsigned>()] = text;
    }
  if (!plan.pageOnly) {
    const auto basis = builtInBasis({});
    if (!basis) {
      std::cerr << basis.error().sentence() << "\n";
      return 1;
    }
    std::ofstream out(plan.log, std::ios::app);
    for (int i = plan.first; i < plan.first + plan.bundles; ++i) {
      const Draw draw = drawOf(plan, i);
      if (known.contains(draw.seed)) continue;
      const std::string line = lineOf(plan, draw, *basis);
      known[draw.seed] = line;
      out << line << std::endl;
      const TwoShotOutcome outcome = outcomeOfLine(line);
      std::fprintf(stderr, "%d  %s\n", i, outcome.sentence().c_str());
    }
  }
  std::vector<TwoShotOutcome> outcomes;
  for (const auto& [seed, line] : known)
    if (seed / 100000 == plan.seed) outcomes.push_back(outcomeOfLine(line));
  const int threads = plan.threads > 0 ? plan.threads : static_cast<int>(std::thread::hardware_concurrency());
  const LoopPage page = twoShotLoopPage(outcomes, plan.seed, machineDescription(threads));
  std::error_code error;
  fs::create_directories(plan.images, error);
  for (const auto& [name, chart] : page.charts) std::ofstream(plan.images / name) << chart;
  std::cout << page.markdown;
  if (!replacePagePart(plan.page, "closing-loop two-shot", page.markdown)) {
    std::cerr << "could not write " << plan.page << "\n";
    return 1;
  }
  return page.markdown.find("**missed**") == std::string::npos ? 0 : 2;
}

}  // namespace
}  // namespace patina::test

int main(int argc, char** argv) {
  using namespace patina::test;
  namespace fs = std::filesystem;
  Plan plan;
  plan.log = fs::temp_directory_path() / "patina-two-shot-rates.jsonl";
  plan.page = fs::path(PATINA_SOURCE_DIR) / "docs/results.md";
  plan.images = fs::path(PATINA_SOURCE_DIR) / "docs/images";
  CLI::App app(
      "Draws two-shot captures with effects that nobody declares, explains them, and writes how often that "
      "was right");
  app.add_option("--bundles", plan.bundles, "Captures [default: 100]")->check(CLI::Range(0, 99999));
  app.add_option("--first", plan.first, "Number of the first one [default: 0]");
  app.add_option("--seed", plan.seed, "Of the draw; a new one for every release [default: 1]");
  app.add_option("--singles", plan.singles, "Share with one effect [default: 0.6]");
  app.add_option("--pairs", plan.pairs, "Share with two [default: 0.1]; the rest has none");
  app.add_option("--threads", plan.threads, "0: one a core [default: 0]");
  app.add_option("--log", plan.log, "File with a line a capture, gone on with where it exists");
  app.add_option("--page", plan.page, "The page whose part is written");
  app.add_option("--images", plan.images, "Folder for its charts");
  app.add_option("--only", plan.only, "Only these effects");
  app.add_flag("--page-only", plan.pageOnly, "Only write the page from what is in the log");
  std::vector<fs::path> logs;
  app.add_option(
      "--weigh", logs,
      "Only fits the weights of the evidence (two_shot_odds.cpp) to the captures of these logs, and "
      "prints them");
  CLI11_PARSE(app, argc, argv);
  if (!logs.empty()) return weigh(logs);
  return run(plan);
}
