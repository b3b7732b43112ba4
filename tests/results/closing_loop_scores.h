#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace patina::test {

/// What came out for one simulated bundle. Kept as JSON beside the bundle, so that a run can go on where it
/// stopped.
struct LoopOutcome {
  std::string kind;  ///< "strong", "weak", "pairs", "clean", "curve"
  std::uint64_t seed = 0;
  std::vector<std::string> truth;  ///< effects that are in it
  std::string field;               ///< "anisotropy.ratio"
  double strength = 0;             ///< of the first effect
  double factor = 1;               ///< kind "curve": of its weak strength
  std::vector<std::string> named;  ///< effects added, strongest first
  std::vector<double> confidence;  ///< of each of them
  std::vector<std::vector<std::string>> confusable;
  std::string runnerUp;  ///< of those not added, the one with the most evidence
  double noiseFloor = -1, holdoutBefore = -1, holdoutAfter = -1, holdoutTold = -1;
  double normalBeforeDeg = -1, normalAfterDeg = -1, normalToldDeg = -1;  ///< median error against the truth
  double sigmaBefore = -1, sigmaAfter = -1, sigmaTold = -1;              ///< median relative error
  double seconds = 0;
  std::string failure;  ///< of the program; empty: none
};

std::string outcomeJson(const LoopOutcome& outcome);
/// False where the text isn't one.
bool outcomeFromJson(const std::string& text, LoopOutcome& outcome);

/// Whether an effect of the truth was found: it was added, or stands in a group of at most two with one that
/// was.
bool foundEffect(const LoopOutcome& outcome, const std::string& effect);
/// Whether the first effect that was named is the right one (one of the right ones), or stands with it in a
/// group of at most two.
bool namedFirst(const LoopOutcome& outcome);
/// Of a clean bundle: nothing was added. Else: everything that is in it was found and named first.
bool rightAnswer(const LoopOutcome& outcome);

/// A share of cases with its 95 % interval (Wilson).
struct Rate {
  int right = 0, all = 0;
  double share() const { return all > 0 ? static_cast<double>(right) / all : 0; }
  double low() const;
  double high() const;
  std::string text() const;  ///< "47 of 50 (0.84 to 0.98)"
};

/// First answer by truth: rows are effects (and "clean"), columns what was named first (or "nothing").
struct ConfusionMatrix {
  std::map<std::string, std::map<std::string, int>> count;
  void add(const std::string& truth, const std::string& named) { ++count[truth][named]; }
  /// As a Markdown table; the row's own column is bold.
  std::string markdown() const;
};
ConfusionMatrix confusionOf(const std::vector<LoopOutcome>& outcomes);

/// Right answers among those given with a confidence in [low, high).
struct CalibrationBin {
  double low = 0, high = 0, meanConfidence = 0;
  Rate rate;
};
std::vector<CalibrationBin> calibrationOf(const std::vector<LoopOutcome>& outcomes);

/// The part of docs/results.md, and its charts by file name. `seed`: of the run; `machine`: its description.
struct LoopPage {
  std::string markdown;
  std::map<std::string, std::string> charts;
};
LoopPage loopPage(const std::vector<LoopOutcome>& outcomes, std::uint64_t seed, const std::string& machine);
/// One line a bundle, with a head.
std::string loopCsv(const std::vector<LoopOutcome>& outcomes);

}  // namespace patina::test
