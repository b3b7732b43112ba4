#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <optional>

#include "engine/diagnosis/explain_kinds.h"
#include "engine/diagnosis/flash_evidence.h"
#include "engine/diagnosis/flash_trials.h"
#include "engine/diagnosis/flash_words.h"

namespace patina {
namespace {

using Clock = std::chrono::steady_clock;

/// An effect must take this share of the mean square prediction error away, ...
constexpr double kLeastGain = 0.02;
/// ... by this many standard deviations of its scatter over photographs and blocks.
constexpr double kLeastSigmas = 2.5;
/// Declared held-out photographs must not get worse by more than this, relative.
constexpr double kMostHarm = 0.01;
/// Refits cost seconds: only so many of the most plainly asked-for effects are refitted a round.
constexpr std::size_t kRefits = 5;
/// A rival that takes this share of the winner's gain, predicts no worse for certain, and adds little to it,
/// can't be told from it.
constexpr double kRival = 0.8, kAddsLittle = 0.25;
constexpr int kPictures = 3, kPictureSide = 512;

double since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

std::string number(const char* pattern, double a, double b = 0, double c = 0) {
  char text[300];
  std::snprintf(text, sizeof text, pattern, a, b, c);
  return text;
}

bool has(const std::vector<FlashEffect>& effects, FlashEffect effect) {
  return std::find(effects.begin(), effects.end(), effect) != effects.end();
}

struct Candidate {
  FlashEffect effect;
  EffectScore score;
  std::optional<FlashTry> tried;
  FlashGain gain;
  double harm = 0;  ///< relative change of the held-out error
};

/// RMS that effects are decided on and reported with: declared held-out photographs, else each photograph
/// predicted from the others.
double judgedRms(const FlashTry& one) {
  const double held = one.held.rms();
  return held >= 0 ? held : one.left.rms();
}

class Search {
 public:
  Search(const FlashTrial& trial, const ExplainOptions& options, const JobContext& job)
      : trial_(trial), options_(options), job_(job) {}

  /// Adds effects, one a round, while one predicts better.
  void run(FlashTry base, Explanation& explanation) {
    current_ = std::move(base);
    for (int round = 0; round < options_.maxEffects && !job_.cancelled(); ++round) {
      std::vector<Candidate> candidates = look(round == 0);
      if (job_.cancelled()) return;
      Candidate* best = nullptr;
      for (Candidate& one : candidates) {
        // A free-form factor is no explanation: the last resort.
        if (!acceptable(one) || one.effect == FlashEffect::BasisDeviation) continue;
        if (!best || one.gain.share > best->gain.share) best = &one;
      }
      if (!best) {
        for (Candidate& one : candidates)
          if (acceptable(one) && one.effect == FlashEffect::BasisDeviation) best = &one;
      }
      note(candidates, best);
      if (!best) return;
      add(*best, candidates, explanation);
    }
  }

  const FlashTry& current() const { return current_; }
  std::vector<EffectFinding> added, considered;

 private:
  double corrected(const EffectScore& score) const {
    return std::min(1.0, score.probability * static_cast<double>(allFlashEffects().size()));
  }

  bool acceptable(const Candidate& one) const {
    return one.tried && one.gain.share >= kLeastGain && one.gain.sigmas >= kLeastSigmas &&
           one.harm <= kMostHarm && corrected(one.score) < options_.falseAlarmRate;
  }

  std::vector<Candidate> look(bool first) {
    std::vector<Candidate> candidates;
    for (const FlashEffect effect : allFlashEffects()) {
      if (has(current_.effects, effect)) continue;
      Candidate one;
      one.effect = effect;
      one.score = scoreEffect(current_.state, trial_.sample, trial_.data.capture, current_.effects, effect,
                              trial_.fitted);
      candidates.push_back(std::move(one));
    }
    // The derivative at strength zero knows one width of the third lobe only, and a kurtosis can stand in for
    // it; the free-form factor over the slope sees any. What asks for that may be a third lobe.
    const auto find = [&](FlashEffect effect) {
      return std::find_if(candidates.begin(), candidates.end(),
                          [&](const Candidate& one) { return one.effect == effect; });
    };
    const auto third = find(FlashEffect::ThirdLobe), free = find(FlashEffect::BasisDeviation);
    if (third != candidates.end() && free != candidates.end() && free->score.sigmas > third->score.sigmas)
      third->score = free->score;
    std::stable_sort(candidates.begin(), candidates.end(),
                     [](const Candidate& a, const Candidate& b) { return a.score.sigmas > b.score.sigmas; });
    std::size_t refits = 0;
    for (Candidate& one : candidates) {
      if (corrected(one.score) >= options_.falseAlarmRate || (refits >= kRefits + (first ? 2 : 0))) continue;
      if (trial_.folds.empty() || job_.cancelled()) break;
      std::vector<FlashEffect> effects = current_.effects;
      effects.push_back(one.effect);
      one.tried = tryEffects(trial_, current_.state, effects, job_);
      one.gain = gainOf(current_.left, one.tried->left);
      if (current_.held.rms() >= 0) one.harm = one.tried->held.rms() / current_.held.rms() - 1;
      // The power of a photograph that nothing was fitted on can't be known: its error says nothing here.
      if (has(effects, FlashEffect::LightPower)) one.harm = 0;
      job_.progress("refit", ++refits_, 6 * static_cast<std::int64_t>(kRefits), "models");
      ++refits;
    }
    return candidates;
  }

  std::string verdictOf(const Candidate& one) const {
    if (!one.tried) {
      return number("Score test: %.1f standard deviations; ", one.score.sigmas) +
             (corrected(one.score) < options_.falseAlarmRate
                  ? std::string("others were asked for more plainly, and this one was not refitted.")
                  : number("with %.0f effects tried that happens without any effect in %.0f %% of captures.",
                           static_cast<double>(allFlashEffects().size()), 100 * corrected(one.score)));
    }
    std::string text = number(
        "Predicting each photograph from the others, it changes the mean square error by "
        "%.1f %% (%.1f standard deviations)",
        -100 * one.gain.share, one.gain.sigmas);
    if (one.gain.share < kLeastGain || one.gain.sigmas < kLeastSigmas)
      return text + ": too little to add it.";
    if (one.harm > kMostHarm)
      return text +
             number(", but the held-out photographs are predicted %.1f %% worse: not added.", 100 * one.harm);
    return text + ".";
  }

  /// Keeps what was found about effects that aren't added, the latest look counts.
  void note(const std::vector<Candidate>& candidates, const Candidate* best) {
    for (const Candidate& one : candidates) {
      if (&one == best) continue;
      EffectFinding finding;
      finding.id = flashEffectId(one.effect);
      finding.verdict = verdictOf(one);
      finding.sigmas = one.score.sigmas, finding.correctedP = corrected(one.score);
      if (one.tried) {
        finding.holdoutRmsWith = judgedRms(*one.tried), finding.holdoutRmsWithout = judgedRms(current_);
        finding.explained = std::clamp(one.gain.share, 0.0, 1.0);
      }
      const auto same = std::find_if(considered.begin(), considered.end(),
                                     [&](const EffectFinding& other) { return other.id == finding.id; });
      if (same == considered.end()) {
        considered.push_back(std::move(finding));
      } else if (one.tried || same->holdoutRmsWith < 0) {
        *same = std::move(finding);
      }
    }
  }

  void add(Candidate& best, std::vector<Candidate>& candidates, Explanation& explanation) {
    const std::string id = flashEffectId(best.effect);
    const FlashTry before = current_;
    current_ = std::move(*best.tried);
    EffectFinding finding = flashFinding(best.effect, trial_, current_, before.state);
    finding.added = true;
    finding.sigmas = best.score.sigmas, finding.correctedP = corrected(best.score);
    finding.explained = std::clamp(best.gain.share, 0.0, 1.0);
    finding.holdoutRmsWith = judgedRms(current_), finding.holdoutRmsWithout = judgedRms(before);
    finding.verdict = number(
        "Added: predicting each photograph from the others, it takes %.1f %% of the mean square error away "
        "(%.1f standard deviations).",
        100 * best.gain.share, best.gain.sigmas);
    // Rivals that predict as well, as far as the photographs can tell, and add little beside it.
    double apart = 10;
    std::vector<std::string> group{id};
    if (best.effect == FlashEffect::LightPower) group.push_back("exposure-mismatch");
    for (const Candidate& other : candidates) {
      if (other.effect == best.effect || !other.tried || !acceptable(other)) continue;
      if (other.effect == FlashEffect::BasisDeviation) continue;
      const double worse = gainOf(other.tried->left, current_.left).sigmas;
      apart = std::min(apart, std::max(worse, 0.0));
      if (worse >= kLeastSigmas || other.gain.share < kRival * best.gain.share || group.size() > 1) continue;
      std::vector<FlashEffect> both = current_.effects;
      both.push_back(other.effect);
      const FlashTry together = tryEffects(trial_, current_.state, both, job_);
      if (gainOf(current_.left, together.left).share < kAddsLittle * best.gain.share)
        group.push_back(flashEffectId(other.effect));
    }
    if (group.size() > 1) explanation.confusable.push_back(group);
    // The chance that the gain is real, and that it is this effect's rather than the nearest rival's.
    const auto chance = [](double sigmas) { return 0.5 * std::erfc(-sigmas / std::sqrt(2.0)); };
    finding.confidence = std::clamp(chance(best.gain.sigmas - 1) * chance(apart), 0.0, 0.99);
    added.push_back(std::move(finding));
    considered.erase(std::remove_if(considered.begin(), considered.end(),
                                    [&](const EffectFinding& one) { return one.id == id; }),
                     considered.end());
  }

  const FlashTrial& trial_;
  const ExplainOptions& options_;
  const JobContext& job_;
  FlashTry current_;
  std::int64_t refits_ = 0;
};

void addSuggestions(Explanation& explanation) {
  for (const std::vector<std::string>& group : explanation.confusable) {
    Suggestion suggestion;
    suggestion.separatesA = group[0], suggestion.separatesB = group[1];
    const auto in = [&](const char* id) { return group[0] == id || group[1] == id; };
    if (in("exposure-mismatch")) {
      suggestion.capture =
          "Nothing in the maps hangs on which of the two it is. To know it: lock the camera's exposure and "
          "take the "
          "same photographs again; what still varies is the flash.";
    } else if (in("near-light") || in("vignetting")) {
      suggestion.capture =
          "Photograph a sheet of white paper in the sample's place once with the flash and once in even "
          "daylight, "
          "from the middle position: the lens darkens both, the flash only one.";
    } else if (in("camera-response")) {
      suggestion.capture =
          "Photograph the sample from one position at two exposure times, a factor of two apart: values "
          "whose ratio "
          "isn't two are the camera's curve.";
    } else {
      suggestion.capture =
          "Take two more photographs with the flash's mirror point at the sample's opposite edges: "
          "highlights "
          "further apart tell the two apart.";
    }
    explanation.suggest.push_back(suggestion);
  }
}

/// What is left, and where.
void describeRest(Explanation& explanation, const FlashTry& final) {
  const double noise =
      explanation.noiseFloorHoldout > 0 ? explanation.noiseFloorHoldout : explanation.noiseFloorFit;
  const auto judged = [](const SplitErrors& e) { return e.holdoutRms >= 0 ? e.holdoutRms : e.fitRms; };
  const double before = judged(explanation.before), after = judged(explanation.after);
  const double above = before * before - noise * noise;
  explanation.unexplained.fraction =
      above > 0 ? std::clamp((after * after - noise * noise) / above, 0.0, 1.0) : 0;
  // Where the energy above noise is: brightness and highlight distance.
  std::string where;
  for (const ResidualBreakdown& part : explanation.breakdowns) {
    if (part.by != "distance from the highlight" && part.by != "brightness") continue;
    std::size_t worst = 0;
    for (std::size_t i = 1; i < part.after.size(); ++i)
      if (part.after[i] > part.after[worst]) worst = i;
    if (part.after.empty()) continue;
    where += (where.empty() ? "" : "; by ") + part.by + " it is largest at " + part.label[worst];
  }
  double discrepancy = 0;
  for (const FlashMaterial& material : final.state.model.materials)
    discrepancy = std::max(discrepancy, material.discrepancy);
  if (explanation.chi2After < 1.5) {
    explanation.unexplained.description =
        "Nothing: the photographs are explained to within the sensor's noise.";
    explanation.unexplained.fraction = 0;
    return;
  }
  explanation.unexplained.description =
      number(
          "A residual of %.1f %% of value that no effect of the catalogue explains (up to %.0f %% in one "
          "material)",
          100 * after, 100 * discrepancy) +
      (where.empty() ? "" : ": by " + where) +
      ". What a texel's few photographs can't determine is in it too: sparkle and relief finer than a texel, "
      "whose highlights no other photograph shows.";
}

Result<ExplanationPtr> explainIt(const std::vector<std::filesystem::path>& bundles,
                                 const ExplainOptions& options, const JobContext& job) {
  const auto begin = Clock::now();
  const Error cancelled{ErrorCode::Cancelled, "the explanation was cancelled", "", ""};
  auto explanation = std::make_shared<Explanation>();
  explanation->kind = "flash";
  explanation->bundles = bundles;
  auto capture = readFlashCapture(bundles.front(), job);
  if (!capture) return capture.error();
  if (bundles.size() > 1) {
    explanation->remarks.push_back("Flash bundles are explained one by one in this version: only " +
                                   bundles.front().string() + " was.");
  }
  auto read = readTrial(*capture, options.size, options.testedTexels, job);
  if (!read) return read.error();
  FlashTrial& trial = *read;
  if (job.cancelled()) return cancelled;

  const auto fitting = Clock::now();
  JointState standard = fitShared(trial.data, trial.sample, trial.palette, {}, trial.fitted, job);
  if (job.cancelled()) return cancelled;
  FlashFitOptions fitOptions;
  fitOptions.size = options.size;
  auto before = fitFlash(trial.data, fitOptions, job, &standard.model, &trial.palette);
  if (!before) return before.error();
  if ((*before)->stats.cancelled) return cancelled;
  explanation->seconds["fit"] = since(fitting);
  explanation->flashBefore = *before;

  const auto searching = Clock::now();
  job.progress("score", 0, 1, "rounds");
  FlashTry base = tryEffects(trial, standard, {}, job);
  const FlashTry first = base;
  Search search(trial, options, job);
  if (trial.folds.empty()) {
    explanation->remarks.push_back(
        "One photograph alone can't be predicted from others: nothing was added. Take at least five.");
  } else {
    search.run(std::move(base), *explanation);
  }
  if (job.cancelled()) return cancelled;
  const FlashTry& final = trial.folds.empty() ? first : search.current();
  explanation->seconds["refit"] = since(searching);

  const auto maps = Clock::now();
  if (final.effects.empty()) {
    explanation->flashAfter = *before;
  } else {
    fitOptions.effects = final.effects;
    auto after = fitFlash(trial.data, fitOptions, job, &final.state.model, &trial.palette);
    if (!after) return after.error();
    if ((*after)->stats.cancelled) return cancelled;
    explanation->flashAfter = *after;
  }
  explanation->seconds["maps"] = since(maps);

  const auto reporting = Clock::now();
  const FlashFitStats& a = explanation->flashBefore->stats;
  const FlashFitStats& b = explanation->flashAfter->stats;
  explanation->noiseFloorFit = a.noiseFloorFit, explanation->noiseFloorHoldout = a.noiseFloorHoldout;
  explanation->before = {a.fitRms, a.holdoutRms}, explanation->after = {b.fitRms, b.holdoutRms};
  explanation->chi2Before = first.chi2, explanation->chi2After = final.chi2;
  explanation->effects = std::move(search.added);
  std::stable_sort(explanation->effects.begin(), explanation->effects.end(),
                   [](const EffectFinding& x, const EffectFinding& y) { return x.explained > y.explained; });
  explanation->considered = std::move(search.considered);
  std::stable_sort(explanation->considered.begin(), explanation->considered.end(),
                   [](const EffectFinding& x, const EffectFinding& y) { return x.sigmas > y.sigmas; });
  for (EffectFinding& finding : explanation->effects) {
    const auto made = flashEffectMaps(*explanation->flashAfter);
    for (const auto& [name, map] : made) {
      const bool own = (finding.id == "anisotropy" && name.starts_with("anisotropy")) ||
                       (finding.id == "third-lobe" && name.starts_with("third_lobe"));
      if (own) finding.maps.emplace(name, map);
    }
  }
  addSuggestions(*explanation);
  for (const FlashEffect effect : allFlashEffects())
    if (!has(final.effects, effect)) explanation->budget.push_back(flashBudget(effect, trial, final));
  addFlashBlindSpots(*explanation, trial, final);
  explanation->breakdowns = flashBreakdowns(trial, first.state, final.state);
  explanation->placeBefore = flashPlaces(trial, first.state);
  explanation->placeAfter = flashPlaces(trial, final.state);
  describeRest(*explanation, final);
  if (Status photos = addFlashPhotos(*explanation, *explanation->flashBefore, *explanation->flashAfter,
                                     options.pictures ? kPictures : 0, kPictureSide, job);
      !photos)
    return photos.error();
  explanation->remarks.insert(explanation->remarks.end(), b.remarks.begin(), b.remarks.end());
  explanation->remarks.push_back(
      number("Effects were decided on %.0f texels of %.0f, each photograph predicted from the others",
             static_cast<double>(trial.sample.sites.size()), static_cast<double>(trial.grid.size())) +
      (a.holdoutRms >= 0 ? ", and the held-out photographs must not get worse. " : ". ") +
      "Errors beside an effect are those of these texels (averages over their pixels); before and after are "
      "over "
      "all pixels of the photographs.");
  if (has(final.effects, FlashEffect::LightPower)) {
    explanation->remarks.push_back(
        "The flash's power in a held-out photograph can't be known from the others: it is predicted with "
        "their "
        "mean, and part of its error is that.");
  }
  explanation->seconds["report"] = since(reporting);
  explanation->seconds["total"] = since(begin);
  return ExplanationPtr(std::move(explanation));
}

}  // namespace

Result<ExplanationPtr> explainFlash(const std::vector<std::filesystem::path>& bundles,
                                    const ExplainOptions& options, const JobContext& job) {
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  std::optional<Result<ExplanationPtr>> result;
  arena.execute([&] { result.emplace(explainIt(bundles, options, job)); });
  return std::move(*result);
}

}  // namespace patina
