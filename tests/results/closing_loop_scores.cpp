#include "tests/results/closing_loop_scores.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>

#include "tests/results/svg_chart.h"

namespace patina::test {
namespace {

using Json = nlohmann::json;

std::string number(double value, int digits) {
  std::array<char, 48> text;
  std::snprintf(text.data(), text.size(), "%.*f", digits, value);
  return text.data();
}

bool holds(const std::vector<std::string>& list, const std::string& id) {
  return std::find(list.begin(), list.end(), id) != list.end();
}

/// Whether two effects stand in a group of no more than these two.
bool tied(const LoopOutcome& outcome, const std::string& a, const std::string& b) {
  return std::any_of(outcome.confusable.begin(), outcome.confusable.end(), [&](const auto& group) {
    return group.size() <= 2 && holds(group, a) && holds(group, b);
  });
}

std::string joined(const std::vector<std::string>& words, const char* between) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : between) + word;
  return text;
}

double medianOf(std::vector<double> values) {
  if (values.empty()) return -1;
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

/// 90th percentile, nearest rank.
double highOf(std::vector<double> values) {
  if (values.empty()) return -1;
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1,
                         static_cast<std::size_t>(0.9 * static_cast<double>(values.size())))];
}

}  // namespace

std::string outcomeJson(const LoopOutcome& o) {
  return Json{{"kind", o.kind},
              {"seed", o.seed},
              {"truth", o.truth},
              {"field", o.field},
              {"strength", o.strength},
              {"factor", o.factor},
              {"named", o.named},
              {"confidence", o.confidence},
              {"confusable", o.confusable},
              {"runner_up", o.runnerUp},
              {"noise_floor", o.noiseFloor},
              {"holdout", {o.holdoutBefore, o.holdoutAfter, o.holdoutTold}},
              {"normal_deg", {o.normalBeforeDeg, o.normalAfterDeg, o.normalToldDeg}},
              {"sigma", {o.sigmaBefore, o.sigmaAfter, o.sigmaTold}},
              {"seconds", o.seconds},
              {"failure", o.failure}}
             .dump(1) +
         "\n";
}

bool outcomeFromJson(const std::string& text, LoopOutcome& o) {
  const Json json = Json::parse(text, nullptr, false);
  if (!json.is_object()) return false;
  try {
    json.at("kind").get_to(o.kind);
    json.at("seed").get_to(o.seed);
    json.at("truth").get_to(o.truth);
    json.at("field").get_to(o.field);
    json.at("strength").get_to(o.strength);
    json.at("factor").get_to(o.factor);
    json.at("named").get_to(o.named);
    json.at("confidence").get_to(o.confidence);
    json.at("confusable").get_to(o.confusable);
    json.at("runner_up").get_to(o.runnerUp);
    json.at("noise_floor").get_to(o.noiseFloor);
    const auto three = [&](const char* key, double& a, double& b, double& c) {
      json.at(key).at(0).get_to(a), json.at(key).at(1).get_to(b), json.at(key).at(2).get_to(c);
    };
    three("holdout", o.holdoutBefore, o.holdoutAfter, o.holdoutTold);
    three("normal_deg", o.normalBeforeDeg, o.normalAfterDeg, o.normalToldDeg);
    three("sigma", o.sigmaBefore, o.sigmaAfter, o.sigmaTold);
    json.at("seconds").get_to(o.seconds);
    json.at("failure").get_to(o.failure);
  } catch (const Json::exception&) {
    return false;  // cut off, or of another version: made again
  }
  return o.confidence.size() == o.named.size();
}

bool foundEffect(const LoopOutcome& outcome, const std::string& effect) {
  return std::any_of(outcome.named.begin(), outcome.named.end(), [&](const std::string& named) {
    return named == effect || tied(outcome, named, effect);
  });
}

bool namedFirst(const LoopOutcome& outcome) {
  if (outcome.named.empty()) return false;
  const std::string& first = outcome.named.front();
  return std::any_of(outcome.truth.begin(), outcome.truth.end(), [&](const std::string& effect) {
    return first == effect || tied(outcome, first, effect);
  });
}

bool rightAnswer(const LoopOutcome& outcome) {
  if (!outcome.failure.empty()) return false;
  if (outcome.truth.empty()) return outcome.named.empty();
  return namedFirst(outcome) &&
         std::all_of(outcome.truth.begin(), outcome.truth.end(),
                     [&](const std::string& effect) { return foundEffect(outcome, effect); });
}

// Source: Wilson (1927); z = 1.96.
double Rate::low() const {
  if (all == 0) return 0;
  const double n = all, p = share(), z = 1.96;
  return std::max(
      0.0, (p + z * z / (2 * n) - z * std::sqrt(p * (1 - p) / n + z * z / (4 * n * n))) / (1 + z * z / n));
}
double Rate::high() const {
  if (all == 0) return 1;
  const double n = all, p = share(), z = 1.96;
  return std::min(
      1.0, (p + z * z / (2 * n) + z * std::sqrt(p * (1 - p) / n + z * z / (4 * n * n))) / (1 + z * z / n));
}
std::string Rate::text() const {
  return std::to_string(right) + " of " + std::to_string(all) + " (" + number(low(), 2) + " to " +
         number(high(), 2) + ")";
}

ConfusionMatrix confusionOf(const std::vector<LoopOutcome>& outcomes) {
  ConfusionMatrix matrix;
  for (const LoopOutcome& outcome : outcomes) {
    if (outcome.truth.size() > 1 || !outcome.failure.empty()) continue;
    const std::string truth = outcome.truth.empty() ? "clean" : outcome.truth.front();
    std::string named = outcome.named.empty() ? "nothing" : outcome.named.front();
    if (!outcome.truth.empty() && named != truth && tied(outcome, named, truth))
      named = truth;  // a tie of two counts
    matrix.add(truth, named);
  }
  return matrix;
}

std::string ConfusionMatrix::markdown() const {
  std::set<std::string> columns;
  for (const auto& [truth, row] : count)
    for (const auto& [named, n] : row) columns.insert(named);
  columns.erase("nothing");
  std::string text = "| truth \\ named first | nothing |", rule = "| --- | ---: |";
  for (const std::string& column : columns) text += " " + column + " |", rule += " ---: |";
  text += "\n" + rule + "\n";
  for (const auto& [truth, row] : count) {
    text += "| " + truth + " |";
    const auto cell = [&](const std::string& named) {
      const auto at = row.find(named);
      if (at == row.end()) return std::string(" |");
      const bool right = named == truth || (truth == "clean" && named == "nothing");
      const std::string value = std::to_string(at->second);
      return " " + (right ? "**" + value + "**" : value) + " |";
    };
    text += cell("nothing");
    for (const std::string& column : columns) text += cell(column);
    text += "\n";
  }
  return text;
}

std::vector<CalibrationBin> calibrationOf(const std::vector<LoopOutcome>& outcomes) {
  constexpr double kEdges[] = {0, 0.5, 0.7, 0.8, 0.9, 0.97, 1.0001};
  std::vector<CalibrationBin> bins;
  for (std::size_t i = 0; i + 1 < std::size(kEdges); ++i) {
    CalibrationBin bin{kEdges[i], std::min(1.0, kEdges[i + 1]), 0, {}};
    for (const LoopOutcome& outcome : outcomes)
      for (std::size_t k = 0; k < outcome.named.size() && outcome.failure.empty(); ++k) {
        if (outcome.confidence[k] < kEdges[i] || outcome.confidence[k] >= kEdges[i + 1]) continue;
        ++bin.rate.all;
        bin.meanConfidence += outcome.confidence[k];
        const bool right =
            std::any_of(outcome.truth.begin(), outcome.truth.end(), [&](const std::string& effect) {
              return effect == outcome.named[k] || tied(outcome, effect, outcome.named[k]);
            });
        bin.rate.right += right;
      }
    if (bin.rate.all > 0) {
      bin.meanConfidence /= bin.rate.all;
      bins.push_back(bin);
    }
  }
  return bins;
}

namespace {

struct Section {
  const char* kind;
  const char* title;
  double bound;
};
constexpr Section kSections[] = {
    {"strong", "one effect, strong (raises the held-out error by half or more): named first", 0.95},
    {"weak", "one effect, weak: named first", 0.80},
    {"pairs", "two effects: both found", 0.80},
    {"clean", "none: nothing added", 0.97},
};

Rate rateOf(const std::vector<LoopOutcome>& outcomes, const std::string& kind, const auto& right) {
  Rate rate;
  for (const LoopOutcome& outcome : outcomes)
    if (outcome.kind == kind) ++rate.all, rate.right += outcome.failure.empty() && right(outcome);
  return rate;
}

bool counts(const LoopOutcome& outcome) {
  if (outcome.truth.empty()) return outcome.named.empty();
  if (outcome.truth.size() == 1) return namedFirst(outcome);
  return std::all_of(outcome.truth.begin(), outcome.truth.end(),
                     [&](const std::string& e) { return foundEffect(outcome, e); });
}

std::string ratesTable(const std::vector<LoopOutcome>& outcomes) {
  std::string text =
      "| bundles with | right (95 % interval) | bound | failures of the program |\n| --- | --- | --- | ---: "
      "|\n";
  for (const Section& section : kSections) {
    const Rate rate = rateOf(outcomes, section.kind, counts);
    if (rate.all == 0) continue;
    const auto failed = std::count_if(outcomes.begin(), outcomes.end(), [&](const LoopOutcome& o) {
      return o.kind == section.kind && !o.failure.empty();
    });
    text += std::string("| ") + section.title + " | " + rate.text() + " | " + number(section.bound, 2) +
            (rate.share() >= section.bound ? "" : " **missed**") + " | " + std::to_string(failed) + " |\n";
  }
  return text;
}

/// Named first by effect and kind.
std::string byEffect(const std::vector<LoopOutcome>& outcomes) {
  std::map<std::string, std::map<std::string, Rate>> rates;
  for (const LoopOutcome& outcome : outcomes)
    if (outcome.truth.size() == 1 && (outcome.kind == "strong" || outcome.kind == "weak")) {
      Rate& rate = rates[outcome.truth.front()][outcome.kind];
      ++rate.all, rate.right += outcome.failure.empty() && namedFirst(outcome);
    }
  if (rates.empty()) return {};
  std::string text = "| effect | strong | weak |\n| --- | --- | --- |\n";
  for (const auto& [effect, kinds] : rates) {
    const auto cell = [&](const char* kind) {
      const auto at = kinds.find(kind);
      return at == kinds.end() ? std::string("")
                               : std::to_string(at->second.right) + " of " + std::to_string(at->second.all);
    };
    text += "| " + effect + " | " + cell("strong") + " | " + cell("weak") + " |\n";
  }
  return text;
}

std::string errorsTable(const std::vector<LoopOutcome>& outcomes) {
  std::string text =
      "| bundles with | held-out / noise before | after | after / told | normal before | after | after / "
      "told | sigma "
      "before | after |\n| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n";
  bool any = false;
  for (const Section& section : kSections) {
    std::map<std::string, std::vector<double>> values;
    const auto put = [&](const char* name, double value, double over = 1) {
      if (value >= 0 && over > 0) values[name].push_back(value / over);
    };
    for (const LoopOutcome& o : outcomes) {
      if (o.kind != section.kind || !o.failure.empty()) continue;
      put("before", o.holdoutBefore, o.noiseFloor), put("after", o.holdoutAfter, o.noiseFloor);
      put("told", o.holdoutTold > 0 ? o.holdoutAfter : -1, o.holdoutTold);
      put("normal", o.normalBeforeDeg), put("normalAfter", o.normalAfterDeg);
      put("normalTold", o.normalToldDeg > 0 ? o.normalAfterDeg : -1, o.normalToldDeg);
      put("sigma", o.sigmaBefore), put("sigmaAfter", o.sigmaAfter);
    }
    if (values["before"].empty()) continue;
    any = true;
    const auto cell = [&](const char* name, int digits, const char* unit = "", double scale = 1) {
      const std::vector<double>& list = values[name];
      if (list.empty()) return std::string(" |");
      return " " + number(scale * medianOf(list), digits) + " (" + number(scale * highOf(list), digits) +
             ")" + unit + " |";
    };
    text += std::string("| ") + section.kind + " |" + cell("before", 3) + cell("after", 3) + cell("told", 3) +
            cell("normal", 2, " deg") + cell("normalAfter", 2, " deg") + cell("normalTold", 2) +
            cell("sigma", 1, " %", 100) + cell("sigmaAfter", 1, " %", 100) + "\n";
  }
  return any ? text : std::string();
}

/// Share named first over the strength, in percent of the weak strength.
std::string detectionChart(const std::vector<LoopOutcome>& outcomes) {
  static const std::map<std::string, std::vector<std::string>> stages = {
      {"screen", {"emission-angular", "emission-spatial", "screen-response", "screen-drift", "flicker"}},
      {"geometry", {"screen-pose", "sample-height"}},
      {"surface",
       {"anisotropy", "third-lobe", "fresnel", "sheen", "clearcoat", "subsurface", "self-shadowing"}},
      {"lens", {"glare", "defocus"}},
      {"sensor", {"camera-response", "black-level", "ambient-drift", "stray-light", "saturation"}}};
  constexpr const char* kColours[] = {"#1b6ca8", "#c0392b", "#2e8b57", "#8e5ea2", "#d17a00", "#222222"};
  std::map<std::string, std::map<double, Rate>> curves;
  std::set<double> factors;
  for (const LoopOutcome& o : outcomes) {
    if (o.kind != "curve" || o.truth.size() != 1) continue;
    factors.insert(100 * o.factor);
    const bool right = o.failure.empty() && namedFirst(o);
    for (const auto& [stage, ids] : stages)
      if (holds(ids, o.truth.front())) {
        Rate& rate = curves[stage][100 * o.factor];
        ++rate.all, rate.right += right;
      }
    Rate& all = curves["all"][100 * o.factor];
    ++all.all, all.right += right;
  }
  if (factors.size() < 2) return {};
  std::vector<ChartLine> lines;
  std::size_t colour = 0;
  for (const auto& [name, curve] : curves) {
    ChartLine line{name, kColours[colour++ % std::size(kColours)], name == "all", {}};
    for (const auto& [factor, rate] : curve) line.points.emplace_back(factor, rate.share());
    lines.push_back(line);
  }
  return svgChart("Effects named first, by strength", "percent of the weak strength", "share named first",
                  {factors.begin(), factors.end()}, 1, lines);
}

std::string calibrationChart(const std::vector<CalibrationBin>& bins) {
  if (bins.size() < 2) return {};
  ChartLine seen{"answers", "#1b6ca8", false, {}}, ideal{"as it should be", "#999", true, {}};
  std::vector<double> ticks;
  for (const CalibrationBin& bin : bins) {
    const double x = 100 * std::max(0.01, bin.meanConfidence);
    ticks.push_back(x);
    seen.points.emplace_back(x, bin.rate.share());
    ideal.points.emplace_back(x, bin.meanConfidence);
  }
  return svgChart("Confidence against the share that is right", "confidence, percent", "share right", ticks,
                  1, {seen, ideal});
}

}  // namespace

LoopPage loopPage(const std::vector<LoopOutcome>& outcomes, std::uint64_t seed, const std::string& machine) {
  LoopPage page;
  double seconds = 0;
  for (const LoopOutcome& o : outcomes) seconds += o.seconds;
  std::string& text = page.markdown;
  text = "## Closing the loop\n\n" + std::to_string(outcomes.size()) +
         " captures drawn at random (materials, reliefs, rigs, noise, effects, strengths; seed " +
         std::to_string(seed) +
         "), simulated by integrating the true reflectance over the screen, and explained by this program, "
         "which is "
         "not told what is in them. `packaging/rates` makes this part; it is meant to be run with a new seed "
         "for "
         "every release. " +
         (outcomes.empty() ? std::string()
                           : number(seconds / static_cast<double>(outcomes.size()), 1) + " s a capture on " +
                                 machine + ".") +
         "\n\nRight is: the effect is named first, or stands with the one named first in a group of two that "
         "the "
         "photographs can't tell apart.\n\n";
  text += ratesTable(outcomes) + "\n";
  if (const auto never = std::count_if(outcomes.begin(), outcomes.end(),
                                       [](const LoopOutcome& o) { return o.kind == "never strong"; });
      never > 0)
    text += std::to_string(never) +
            " further draws with a strong effect raised the error by less than half at any strength that one "
            "meets, on any of four sheets, and are in no rate.\n\n";
  if (const std::string table = byEffect(outcomes); !table.empty())
    text += "### By effect\n\n" + table + "\n";
  if (const std::string table = errorsTable(outcomes); !table.empty())
    text +=
        "### Errors before and after\n\nMedians, 90th percentiles in brackets; told: a fit that was told the "
        "effect. "
        "Normals and sigma against the truth.\n\n" +
        table + "\n";
  std::vector<LoopOutcome> single;
  for (const LoopOutcome& o : outcomes)
    if (o.kind != "curve") single.push_back(o);
  text += "### Named first, by truth\n\n" + confusionOf(single).markdown() + "\n";
  if (const std::string chart = detectionChart(outcomes); !chart.empty()) {
    page.charts["closing_loop_detection.svg"] = chart;
    text += "### By strength\n\n![share named first over strength](images/closing_loop_detection.svg)\n\n";
  }
  const std::vector<CalibrationBin> bins = calibrationOf(outcomes);
  if (!bins.empty()) {
    text += "### Confidence\n\n| confidence | answers | right (95 % interval) |\n| --- | ---: | --- |\n";
    for (const CalibrationBin& bin : bins)
      text += "| " + number(bin.low, 2) + " to " + number(bin.high, 2) + " (mean " +
              number(bin.meanConfidence, 2) + ") | " + std::to_string(bin.rate.all) + " | " +
              bin.rate.text() + " |\n";
    text += "\n";
    if (const std::string chart = calibrationChart(bins); !chart.empty()) {
      page.charts["closing_loop_calibration.svg"] = chart;
      text += "![confidence against the share that is right](images/closing_loop_calibration.svg)\n\n";
    }
  }
  return page;
}

std::string loopCsv(const std::vector<LoopOutcome>& outcomes) {
  std::string text =
      "kind,seed,truth,field,strength,factor,named,confidence,confusable,right,noise_floor,holdout_before,"
      "holdout_after,"
      "holdout_told,normal_before_deg,normal_after_deg,normal_told_deg,sigma_before,sigma_after,sigma_told,"
      "seconds,failure\n";
  for (const LoopOutcome& o : outcomes) {
    std::string confidence, groups;
    for (const double c : o.confidence) confidence += (confidence.empty() ? "" : "+") + number(c, 3);
    for (const auto& group : o.confusable) groups += (groups.empty() ? "" : "+") + joined(group, "=");
    std::string failure = o.failure;
    std::replace_if(
        failure.begin(), failure.end(), [](char c) { return c == ',' || c == '\n' || c == '"'; }, ' ');
    text += o.kind + "," + std::to_string(o.seed) + "," + joined(o.truth, "+") + "," + o.field + "," +
            number(o.strength, 6) + "," + number(o.factor, 3) + "," + joined(o.named, "+") + "," +
            confidence + "," + groups + "," + (counts(o) && o.failure.empty() ? "1" : "0");
    for (const double value :
         {o.noiseFloor, o.holdoutBefore, o.holdoutAfter, o.holdoutTold, o.normalBeforeDeg, o.normalAfterDeg,
          o.normalToldDeg, o.sigmaBefore, o.sigmaAfter, o.sigmaTold})
      text += "," + (value >= 0 ? number(value, 6) : std::string());
    text += "," + number(o.seconds, 1) + "," + failure + "\n";
  }
  return text;
}

}  // namespace patina::test
