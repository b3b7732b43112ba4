#include "engine/report/explanation_words.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "engine/base/text.h"
#include "engine/effect/effect_info.h"

namespace patina {
namespace {

/// Left over above the noise's variance: less than this is not worth a person's time.
constexpr double kChi2Margin = 1.05;
/// Share of the residual's energy above noise that may stay before it is spoken of.
constexpr double kUnexplainedMargin = 0.1;
/// A full bar: beyond that nobody asks for more.
constexpr double kFullEvidenceSigmas = 1000;

std::string uncapitalised(std::string text) {
  if (text.size() > 1 && std::islower(static_cast<unsigned char>(text[1])))
    text[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(text[0])));
  return text;
}

std::string joined(const std::vector<std::string>& parts, const char* last) {
  std::string text;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (i > 0) text += i + 1 == parts.size() ? std::string(" ") + last + " " : ", ";
    text += parts[i];
  }
  return text;
}

/// The group of effects that can't be told from `id`, `id` first; empty where it stands alone.
std::vector<std::string> confusableWith(const Explanation& explanation, const std::string& id) {
  for (const auto& group : explanation.confusable)
    if (std::ranges::find(group, id) != group.end()) {
      std::vector<std::string> others{id};
      for (const std::string& other : group)
        if (other != id) others.push_back(other);
      return others.size() > 1 ? others : std::vector<std::string>{};
    }
  return {};
}

std::string errorSentence(const Explanation& explanation) {
  const ErrorSummary error = errorSummary(explanation);
  if (!(error.before >= 0)) return "The error of prediction is not known.";
  std::string text = error.holdout ? "Error on photographs that the fit never saw: "
                                   : "Error on the photographs that were fitted (none is held out): ";
  text += percent(error.before);
  if (!explanation.effects.empty() && error.after >= 0) text += " before, " + percent(error.after) + " after";
  if (error.noise > 0) text += "; their noise alone is " + percent(error.noise);
  return text + ".";
}

}  // namespace

std::string shortNumber(double value) {
  if (!std::isfinite(value)) return "?";
  if (value == 0) return "0";
  const double size = std::abs(value);
  const auto trimmed = [](std::string number) {
    if (number.find('.') == std::string::npos) return number;
    number.erase(number.find_last_not_of('0') + 1);
    if (number.back() == '.') number.pop_back();
    return number;
  };
  char text[48];
  if (size < 1e-4 || size >= 99999.5) {
    const int power = static_cast<int>(std::floor(std::log10(size)));
    std::snprintf(text, sizeof text, "%.2f", value / std::pow(10.0, power));
    return trimmed(text) + "e" + std::to_string(power);
  }
  const int digits = std::max(0, 2 - static_cast<int>(std::floor(std::log10(size))));
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return trimmed(text);
}

std::string wholePercent(double share) {
  if (!(share >= 0) || !std::isfinite(share)) return "not known";
  if (share > 0.99 && share < 1) return "over 99 %";
  if (share >= 999) return shortNumber(100 * share) + " %";
  char text[48];
  std::snprintf(text, sizeof text, share < 0.1 ? "%.1f %%" : "%.0f %%", 100 * share);
  return text;
}

std::string percent(double share) {
  if (!(share >= 0) || !std::isfinite(share)) return "not known";
  char text[48];
  const double value = 100 * share;
  if (value >= 99999.5) return shortNumber(value) + " %";
  std::snprintf(text, sizeof text, "%.*f %%", value < 0.1 ? 4 : value < 1 ? 3 : value < 100 ? 2 : 0, value);
  return text;
}

std::string effectTitle(const std::string& id) {
  const EffectInfo* effect = findEffect(id);
  return effect ? std::string(effect->title) : id;
}

std::string parameterWords(const std::string& name) {
  std::string base = name;
  for (const char* suffix : {"Deg", "Mm", "Px"}) {
    const std::size_t length = std::strlen(suffix);
    if (base.size() > length && base.ends_with(suffix)) base.resize(base.size() - length);
  }
  if (base == "perPhoto") return "change from photograph to photograph";
  std::string words;
  for (const char c : base) {
    if (std::isupper(static_cast<unsigned char>(c))) {
      words += ' ';
      words += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    } else {
      words += c;
    }
  }
  return words;
}

namespace {

/// A part of a whole, which people read as percent.
bool isShare(const std::string& name) {
  return name == "share" || name == "perPhoto" || name == "cornerLoss" || name == "compression" ||
         name.ends_with("Change");
}

}  // namespace

std::string amountText(const std::string& parameter, double value, const std::string& unit) {
  if (std::isfinite(value) && (unit == "relative" || (unit.empty() && isShare(parameter))))
    return shortNumber(100 * value) + " %";
  return shortNumber(value) + (unit.empty() ? "" : " " + unit);
}

std::string estimateText(const EffectEstimate& estimate) {
  std::string text = parameterWords(estimate.name) + " ";
  const std::string amount = amountText(estimate.name, estimate.value, estimate.unit);
  const std::size_t unit = amount.find(' ');  // the deviation goes before it
  text += amount.substr(0, unit);
  if (estimate.sd > 0 && std::isfinite(estimate.sd)) {
    const std::string sd = amountText(estimate.name, estimate.sd, estimate.unit);
    text += " \u00b1 " + sd.substr(0, sd.find(' '));
  }
  if (unit != std::string::npos) text += amount.substr(unit);
  if (!estimate.where.empty()) text += " (" + estimate.where + ")";
  return text;
}

std::string evidenceWords(const EffectFinding& finding) {
  if (!std::isfinite(finding.sigmas) || finding.sigmas <= 0) return "not tested";
  if (finding.correctedP > 0.05) return "none";
  if (finding.sigmas < 4) return "weak";
  if (finding.sigmas < 8) return "clear";
  return finding.sigmas < 30 ? "strong" : "overwhelming";
}

double evidenceShare(const EffectFinding& finding) {
  if (std::isnan(finding.sigmas) || finding.sigmas <= 0) return 0;
  return std::min(1.0, std::log1p(finding.sigmas) / std::log1p(kFullEvidenceSigmas));
}

ErrorSummary errorSummary(const Explanation& explanation) {
  ErrorSummary summary;
  summary.holdout = explanation.before.holdoutRms >= 0;
  summary.before = summary.holdout ? explanation.before.holdoutRms : explanation.before.fitRms;
  summary.after = summary.holdout ? explanation.after.holdoutRms : explanation.after.fitRms;
  summary.noise = summary.holdout ? explanation.noiseFloorHoldout : explanation.noiseFloorFit;
  return summary;
}

ExplanationVerdict verdictOf(const Explanation& explanation) {
  ExplanationVerdict verdict;
  using Mood = ExplanationVerdict::Mood;
  const auto& effects = explanation.effects;
  // Where the mean square isn't known, the share alone decides.
  const bool left = (explanation.chi2After > kChi2Margin || !(explanation.chi2After > 0)) &&
                    explanation.unexplained.fraction > kUnexplainedMargin;
  if (!effects.empty()) {
    verdict.mood = Mood::Found;
    const auto group = confusableWith(explanation, effects.front().id);
    if (effects.size() == 1 && effects.front().id == "basis-deviation") {
      verdict.mood = Mood::Unnamed;
      verdict.headline =
          "The material reflects as none of the known ones: no effect of the catalogue has a name "
          "for it, but a free correction predicts better.";
    } else if (effects.size() == 1 && !group.empty()) {
      std::vector<std::string> titles;
      for (const std::string& id : group) titles.push_back(uncapitalised(effectTitle(id)));
      verdict.headline = "The standard model lacks one thing, and these photographs can't tell which: " +
                         joined(titles, "or") + ".";
    } else if (effects.size() == 1) {
      verdict.headline =
          "The standard model lacks one thing: " + uncapitalised(effectTitle(effects.front().id)) + ".";
    } else {
      std::vector<std::string> titles;
      for (const auto& effect : effects) titles.push_back("\u201c" + effectTitle(effect.id) + "\u201d");
      verdict.headline =
          "The standard model lacks " + counted(effects.size(), "thing") + ": " + joined(titles, "and") + ".";
    }
  } else if (left) {
    verdict.mood = Mood::Unnamed;
    verdict.headline = "Something is missing that has no name in the catalogue.";
  } else {
    verdict.headline =
        "Nothing is missing: the standard model predicts these photographs as well as their noise "
        "allows to see.";
  }
  if (explanation.cancelled) {
    verdict.mood = Mood::Stopped;
    verdict.headline = effects.empty() ? "Stopped before anything was found."
                                       : "Stopped before the end. So far: " + uncapitalised(verdict.headline);
  }
  verdict.detail = errorSentence(explanation);
  if (left && !explanation.cancelled && !explanation.unexplained.description.empty())
    verdict.detail +=
        (effects.empty() ? " What stays: " : " Not all is explained: ") + explanation.unexplained.description;
  return verdict;
}

}  // namespace patina
