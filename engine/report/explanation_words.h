#pragma once

#include <string>
#include <vector>

#include "engine/diagnosis/explanation.h"

namespace patina {

/// What the whole explanation comes to, for a person in a hurry.
struct ExplanationVerdict {
  enum class Mood { Nothing, Found, Unnamed, Stopped };
  Mood mood = Mood::Nothing;
  std::string headline;  ///< one sentence: what is missing, or that nothing is
  std::string detail;  ///< one or two: the error before and after beside the noise's; what it is not known by
};
ExplanationVerdict verdictOf(const Explanation& explanation);

/// Title of an effect; its id where the catalogue doesn't have it.
std::string effectTitle(const std::string& id);
/// A parameter's value with its unit, shares of a whole as percent: "1.2 mm", "2.1 %", "1.32".
std::string amountText(const std::string& parameter, double value, const std::string& unit);
/// With its name, standard deviation and where it holds: "ratio 1.32 ± 0.02 (left half)".
std::string estimateText(const EffectEstimate& estimate);
/// A parameter's name as words: "edgeChange" is "edge change", "distanceMm" is "distance".
std::string parameterWords(const std::string& name);
/// How strong a score is, in words: "overwhelming", "strong", "weak", "none".
std::string evidenceWords(const EffectFinding& finding);
/// 0 .. 1 for a bar: logarithmic in standard deviations, full at a thousand.
double evidenceShare(const EffectFinding& finding);
/// "8.21 %", "0.034 %"; "not known" for less than zero and what is no number.
std::string percent(double share);
/// "87 %", "4.2 %": for shares that nobody wants digits of.
std::string wholePercent(double share);
/// Three significant digits, no exponent between 0.0001 and 100000; "not a number" is "?".
std::string shortNumber(double value);

/// The error that the verdict speaks of, held-out where there is one.
struct ErrorSummary {
  bool holdout = true;
  double before = -1, after = -1, noise = 0;
};
ErrorSummary errorSummary(const Explanation& explanation);

}  // namespace patina
