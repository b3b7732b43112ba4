#include "tests/results/two_shot_rates_page.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

#include "tests/results/svg_chart.h"

namespace patina::test {
namespace {

std::string number(double value, int digits) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

std::string kindOf(const TwoShotOutcome& o) {
  if (o.truth.empty()) return "clean";
  if (o.truth.size() > 1) return "pairs";
  const double rise = o.rise();
  return rise >= 1.5 ? "strong" : rise >= 1.2 ? "moderate" : "faint";
}

bool counts(const TwoShotOutcome& o) {
  if (!o.failure.empty()) return false;
  if (o.truth.empty()) return o.named.empty();
  if (o.truth.size() == 1) return namedFirst(o);
  return std::all_of(o.truth.begin(), o.truth.end(), [&](const std::string& e) { return foundEffect(o, e); });
}

template <typename Pick>
Rate rateOf(const std::vector<TwoShotOutcome>& outcomes, Pick&& pick) {
  Rate rate;
  for (const TwoShotOutcome& o : outcomes)
    if (pick(o)) ++rate.all, rate.right += counts(o);
  return rate;
}

std::string ratesTable(const std::vector<TwoShotOutcome>& outcomes) {
  struct Section {
    const char *kind, *title;
    double bound;
  };
  std::string text = "| captures with | right (95 % interval) | bound |\n| --- | --- | --- |\n";
  for (const Section& s :
       {Section{"strong", "one effect that raises the held-out error by half or more: named first", 0.95},
        {"moderate", "one effect that raises it by a fifth to a half: named first", 0.80},
        {"faint", "one effect that raises it by less: named first", -1},
        {"pairs", "two effects: both found", 0.80},
        {"clean", "none: nothing added", 0.97}}) {
    const Rate rate = rateOf(outcomes, [&](const TwoShotOutcome& o) { return o.kind == s.kind; });
    if (rate.all == 0) continue;
    text += std::string("| ") + s.title + " | " + rate.text() + " | " +
            (s.bound < 0 ? "none" : number(s.bound, 2)) + (rate.share() >= s.bound ? "" : " **missed**") +
            " |\n";
  }
  Rate wrong;
  for (const TwoShotOutcome& o : outcomes)
    if (o.truth.size() == 1 && o.failure.empty() && !o.named.empty())
      ++wrong.all, wrong.right += !namedFirst(o);
  if (wrong.all > 0)
    text += "| one effect and something was named: it was the wrong one | " + wrong.text() + " | none |\n";
  return text;
}

/// Rows: what `name` says of an outcome; columns: kinds.
template <typename Name>
std::string byTable(const std::vector<TwoShotOutcome>& outcomes, const std::string& head,
                    const std::vector<const char*>& kinds, Name&& name) {
  std::map<std::string, std::map<std::string, Rate>> rates;
  for (const TwoShotOutcome& o : outcomes) {
    const std::string row = name(o);
    if (row.empty()) continue;
    Rate& rate = rates[row][o.kind];
    ++rate.all, rate.right += counts(o);
  }
  std::string text = "| " + head + " |", rule = "| --- |";
  for (const char* kind : kinds) text += std::string(" ") + kind + " |", rule += " --- |";
  text += "\n" + rule + "\n";
  for (const auto& [row, cells] : rates) {
    text += "| " + row + " |";
    for (const char* kind : kinds) {
      const auto at = cells.find(kind);
      text += at == cells.end()
                  ? std::string(" |")
                  : " " + std::to_string(at->second.right) + " of " + std::to_string(at->second.all) + " |";
    }
    text += "\n";
  }
  return text;
}

std::string detectionChart(const std::vector<TwoShotOutcome>& outcomes) {
  constexpr double kEdges[] = {1, 1.1, 1.2, 1.5, 2, 3, 5, 1e9};
  ChartLine line{"named first", "#1b6ca8", false, {}};
  std::vector<double> ticks;
  for (std::size_t i = 0; i + 1 < std::size(kEdges); ++i) {
    Rate rate;
    double mean = 0;
    for (const TwoShotOutcome& o : outcomes) {
      const double rise = std::max(1.0, o.rise());
      if (o.truth.size() != 1 || rise < kEdges[i] || rise >= kEdges[i + 1]) continue;
      ++rate.all, rate.right += counts(o), mean += std::log(rise);
    }
    if (rate.all < 3) continue;
    const double x = 100 * std::exp(mean / rate.all);
    ticks.push_back(std::round(x));
    line.points.emplace_back(x, rate.share());
  }
  if (ticks.size() < 2) return {};
  return svgChart("Two-shot captures: effects named first, by what they do to the error",
                  "held-out error, percent of that without the effect", "share named first", ticks, 1,
                  {line});
}

}  // namespace

std::string TwoShotOutcome::sentence() const {
  std::string text = family + " " + material + ": ";
  for (const std::string& effect : truth) text += effect + " ";
  if (truth.empty()) text += "nothing ";
  text += "x " + number(scale, 2) + " ->";
  for (std::size_t i = 0; i < named.size(); ++i)
    text += " " + named[i] + " (" + number(confidence[i], 2) + ")";
  if (named.empty()) text += " nothing";
  text += ", held out " + number(holdoutClean, 3) + " clean, " + number(holdoutBefore, 3) + " -> " +
          number(holdoutAfter, 3) + ", " + number(seconds, 0) + " s";
  if (!failure.empty()) text += " FAILED: " + failure;
  return (counts(*this) ? "  " : "! ") + text;
}

TwoShotOutcome outcomeOfLine(const std::string& text) {
  TwoShotOutcome o;
  const auto line = nlohmann::json::parse(text, nullptr, false);
  if (!line.is_object()) {
    o.failure = "not a line of a log";
    return o;
  }
  o.seed = line.value("seed", 0u);
  o.truth = line.value("truth", std::vector<std::string>{});
  o.material = line.value("material", ""), o.family = line.value("family", "");
  o.scale = line.value("scale", 1.0);
  o.failure = line.value("failure", "");
  o.named = line.value("named", std::vector<std::string>{});
  o.confidence = line.value("confidence", std::vector<double>{});
  o.confidence.resize(o.named.size(), 0);
  o.confusable = line.value("confusable", std::vector<std::vector<std::string>>{});
  o.noiseFloor = line.value("noise", -1.0);
  o.holdoutBefore = line.value("before", -1.0), o.holdoutAfter = line.value("after", -1.0);
  o.holdoutClean = line.value("clean", -1.0);
  o.seconds = line.value("seconds", 0.0);
  o.kind = kindOf(o);
  return o;
}

LoopPage twoShotLoopPage(std::vector<TwoShotOutcome> outcomes, std::uint64_t seed,
                         const std::string& machine) {
  LoopPage page;
  double seconds = 0;
  for (TwoShotOutcome& o : outcomes) o.kind = kindOf(o), seconds += o.seconds;
  std::string& text = page.markdown;
  text = "## Closing the loop on two-shot captures\n\n" + std::to_string(outcomes.size()) +
         " captures drawn at random (seed " + std::to_string(seed) +
         "): materials (of the basis; taken out of it; measured ones of other makers; another model's fits; "
         "microfacet models), directions, two to four fitted photographs, noise, surroundings, and an effect "
         "from a third to three times its usual strength. The simulator shares no formula with the search. "
         "`packaging/rates two-shot` makes this part; it is meant to be run with a new seed for every "
         "release. " +
         (outcomes.empty() ? std::string()
                           : number(seconds / static_cast<double>(outcomes.size()), 1) + " s a capture on " +
                                 machine + ".") +
         "\n\nRight is: the effect is named first, or stands with the one named first in a group of two that "
         "the photographs can't tell apart.\n\n";
  text += ratesTable(outcomes) + "\n";
  const std::vector<const char*> kinds{"strong", "moderate", "faint"};
  text +=
      "### Two-shot captures, by effect\n\n" +
      byTable(outcomes, "effect", kinds,
              [](const TwoShotOutcome& o) { return o.truth.size() == 1 ? o.truth.front() : std::string(); }) +
      "\n";
  text += "### Two-shot captures, by the material's origin\n\n" +
          byTable(outcomes, "material", {"strong", "moderate", "faint", "pairs", "clean"},
                  [](const TwoShotOutcome& o) { return o.family; }) +
          "\n";
  std::vector<LoopOutcome> single(outcomes.begin(), outcomes.end());
  text += "### Two-shot captures, named first, by truth\n\n" + confusionOf(single).markdown() + "\n";
  if (const std::string chart = detectionChart(outcomes); !chart.empty()) {
    page.charts["two_shot_detection.svg"] = chart;
    text += "![share named first over the rise of the error](images/two_shot_detection.svg)\n\n";
  }
  const std::vector<CalibrationBin> bins = calibrationOf(single);
  if (!bins.empty()) {
    text +=
        "### Two-shot captures, confidence\n\n| confidence | answers | right (95 % interval) |\n"
        "| --- | ---: | --- |\n";
    ChartLine seen{"answers", "#1b6ca8", false, {}}, ideal{"as it should be", "#999", true, {}};
    std::vector<double> ticks;
    for (const CalibrationBin& bin : bins) {
      text += "| " + number(bin.low, 2) + " to " + number(bin.high, 2) + " (mean " +
              number(bin.meanConfidence, 2) + ") | " + std::to_string(bin.rate.all) + " | " +
              bin.rate.text() + " |\n";
      const double x = std::max(1.0, 100 * bin.meanConfidence);
      ticks.push_back(std::round(x));
      seen.points.emplace_back(x, bin.rate.share());
      ideal.points.emplace_back(x, bin.meanConfidence);
    }
    text += "\n";
    if (bins.size() > 1) {
      page.charts["two_shot_calibration.svg"] =
          svgChart("Two-shot captures: confidence against the share that is right", "confidence, percent",
                   "share right", ticks, 1, {seen, ideal});
      text += "![confidence against the share that is right](images/two_shot_calibration.svg)\n\n";
    }
  }
  return page;
}

}  // namespace patina::test
