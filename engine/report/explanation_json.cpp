#include <cmath>
#include <nlohmann/json.hpp>

#include "engine/report/explanation_files.h"
#include "engine/report/explanation_words.h"
#include "engine/report/result_files.h"

namespace patina {
namespace {

using Json = nlohmann::ordered_json;

/// null where there is no number.
Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}
/// null where it was not computed: errors are never negative.
Json error(double value) {
  return value >= 0 ? number(value) : Json(nullptr);
}
Json numbers(const std::vector<double>& values) {
  Json json = Json::array();
  for (const double value : values) json.push_back(number(value));
  return json;
}
Json split(const SplitErrors& errors) {
  return {{"fit_rms", error(errors.fitRms)}, {"holdout_rms", error(errors.holdoutRms)}};
}

Json evidence(const EffectFinding& finding) {
  return {{"sigmas", number(finding.sigmas)},
          {"corrected_p", number(finding.correctedP)},
          {"explained", number(finding.explained)},
          {"words", evidenceWords(finding)}};
}

Json finding(const EffectFinding& effect) {
  Json json;
  json["id"] = effect.id;
  Json parameters = Json::object(), details = Json::array();
  for (const EffectEstimate& estimate : effect.parameters) {
    // The first of a name is the one that stands for all; the others hold for a part, and say which.
    if (!parameters.contains(estimate.name)) parameters[estimate.name] = number(estimate.value);
    details.push_back({{"name", estimate.name},
                       {"value", number(estimate.value)},
                       {"sd", number(estimate.sd)},
                       {"unit", estimate.unit},
                       {"where", estimate.where}});
  }
  json["parameters"] = std::move(parameters);
  json["holdout_rms_with"] = error(effect.holdoutRmsWith);
  json["holdout_rms_without"] = error(effect.holdoutRmsWithout);
  json["confidence"] = number(effect.confidence);
  json["verdict"] = effect.verdict;
  json["sentence"] = effect.sentence;
  json["evidence"] = evidence(effect);
  json["estimates"] = std::move(details);
  Json curves = Json::array();
  for (const PhotoCurve& curve : effect.curves)
    curves.push_back({{"name", curve.name},
                      {"unit", curve.unit},
                      {"photo", curve.photo},
                      {"value", numbers(curve.value)},
                      {"sd", numbers(curve.sd)}});
  json["curves"] = std::move(curves);
  Json maps = Json::array();
  for (const auto& [stem, map] : effect.maps)
    if (!map.empty()) maps.push_back(effectMapFile(stem).generic_string());
  json["maps"] = std::move(maps);
  return json;
}

Json considered(const EffectFinding& effect) {
  Json json;
  json["id"] = effect.id;
  json["holdout_rms_with"] = error(effect.holdoutRmsWith);
  json["verdict"] = effect.verdict;
  json["evidence"] = evidence(effect);
  return json;
}

Json budgetLine(const BudgetLine& line) {
  Json shifts = Json::array();
  for (const BudgetLine::Shift& shift : line.shifts)
    shifts.push_back({{"quantity", shift.quantity}, {"value", number(shift.value)}, {"unit", shift.unit}});
  return {{"id", line.id},     {"parameter", line.parameter}, {"largest_unseen", number(line.largestUnseen)},
          {"unit", line.unit}, {"shifts", std::move(shifts)}, {"sentence", line.sentence}};
}

Json residual(const Explanation& explanation) {
  Json photos = Json::array(), breakdowns = Json::array();
  for (const PhotoResidual& photo : explanation.photos)
    photos.push_back({{"bundle", photo.bundle},
                      {"file", photo.file},
                      {"what", photo.what},
                      {"holdout", photo.holdout},
                      {"noise", error(photo.noise)},
                      {"before", error(photo.before)},
                      {"after", error(photo.after)}});
  for (const ResidualBreakdown& breakdown : explanation.breakdowns)
    breakdowns.push_back({{"by", breakdown.by},
                          {"label", breakdown.label},
                          {"before", numbers(breakdown.before)},
                          {"after", numbers(breakdown.after)}});
  return {{"chi2_before", number(explanation.chi2Before)},
          {"chi2_after", number(explanation.chi2After)},
          {"photos", std::move(photos)},
          {"breakdowns", std::move(breakdowns)}};
}

}  // namespace

std::string explanationJson(const Explanation& explanation) {
  Json json;
  json["kind"] = explanation.kind;
  json["bundles"] = Json::array();
  for (const auto& bundle : explanation.bundles) json["bundles"].push_back(bundle.string());
  const ExplanationVerdict verdict = verdictOf(explanation);
  json["verdict"] = verdict.headline + " " + verdict.detail;
  json["noise_floor"] = {{"fit", number(explanation.noiseFloorFit)},
                         {"holdout", number(explanation.noiseFloorHoldout)}};
  json["before"] = split(explanation.before);
  json["after"] = split(explanation.after);
  json["effects"] = Json::array();
  for (const EffectFinding& effect : explanation.effects) json["effects"].push_back(finding(effect));
  json["considered"] = Json::array();
  for (const EffectFinding& effect : explanation.considered) json["considered"].push_back(considered(effect));
  json["confusable"] = explanation.confusable;
  json["suggest"] = Json::array();
  for (const Suggestion& suggestion : explanation.suggest)
    json["suggest"].push_back({{"separates", {suggestion.separatesA, suggestion.separatesB}},
                               {"capture", suggestion.capture},
                               {"sigmas", number(suggestion.separationSigmas)}});
  json["unexplained"] = {{"fraction", number(explanation.unexplained.fraction)},
                         {"description", explanation.unexplained.description}};
  json["budget"] = Json::array();
  for (const BudgetLine& line : explanation.budget) json["budget"].push_back(budgetLine(line));
  json["residual"] = residual(explanation);
  json["remarks"] = explanation.remarks;
  json["seconds"] = Json::object();
  for (const auto& [stage, seconds] : explanation.seconds) json["seconds"][stage] = number(seconds);
  json["cancelled"] = explanation.cancelled;
  return json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace patina
