#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <optional>
#include <set>

#include "engine/base/text.h"
#include "engine/diagnosis/explain_kinds.h"
#include "engine/diagnosis/two_shot_explain.h"
#include "engine/diagnosis/two_shot_judge.h"
#include "engine/diagnosis/two_shot_odds.h"
#include "engine/diagnosis/two_shot_residual.h"
#include "engine/diagnosis/two_shot_search.h"
#include "engine/diagnosis/two_shot_surface.h"
#include "engine/diagnosis/two_shot_words.h"
#include "engine/effect/effect_info.h"
#include "engine/twoshot/fit.h"

namespace patina {
namespace {

/// Rows a photograph: enough for a highlight, few enough for a covariance of all of them.
constexpr int kRowsPerShot = 80;
/// Gained by a rough fit before a thorough one is worth its time.
constexpr double kWorthRefining = 3;
constexpr int kRefined = 5;
/// Another explanation that has this share of the best one's probability is not told from it.
constexpr double kAlike = 0.15;
/// One answer's errors over another's, fitted and held out, from which it comes first.
constexpr double kFarBetter = 0.8;
/// ln odds of what is no answer.
constexpr double kNoAnswer = -50;
/// Most that is claimed, and what is claimed of the answer that what is missing has no name.
constexpr double kMostConfidence = 0.98, kFreeConfidence = 0.6;
/// Share of a sample's pixels that must be clipped before it is told.
constexpr double kClippedShare = 0.003;

using Clock = std::chrono::steady_clock;

class Explainer {
 public:
  Explainer(BasisPtr basis, const std::vector<std::filesystem::path>& bundles, const ExplainOptions& options,
            const JobContext& job, TwoShotRounds* rounds)
      : options_(options), job_(job), rounds_(rounds), basis_(std::move(basis)) {
    out_->kind = "two-shot";
    out_->bundles = bundles;
  }

  Result<ExplanationPtr> run() {
    const auto start = Clock::now();
    Result<TwoShotCapture> capture = readTwoShotCapture(out_->bundles.front(), job_);
    if (!capture) return capture.error();
    capture_ = std::move(*capture);
    job_.progress("fit", 0, 1, "fits");
    if (!basis_) {
      Result<BasisPtr> basis = builtInBasis(job_);
      if (!basis) return basis.error();
      basis_ = *basis;
    }
    fitOptions_.clusters = 0;
    auto before = fitTwoShot(capture_, basis_, fitOptions_, job_);
    if (!before) return before.error();
    before_ = *before;
    job_.progress("fit", 1, 1, "fits");
    lap("fit", start);
    if (before_->materials.size() > 1) {
      out_->remarks.push_back(
          "The sample holds several materials: effects were looked for on the largest one, and the fits are "
          "of all.");
    }
    if (out_->bundles.size() > 1) {
      out_->remarks.push_back(
          "Two-shot bundles are explained one by one: this is the first one's explanation, the others were "
          "not read.");
    }

    const auto reading = Clock::now();
    job_.progress("residual", 0, 1, "bundles");
    Result<DiagnosisData> data = loadDiagnosisData(capture_, kRowsPerShot, job_);
    if (!data) return data.error();
    data_ = std::move(*data);
    candidates_ = twoShotCandidates(capture_, data_);
    model_.emplace(basis_);
    search_.emplace(*model_, data_, job_);
    job_.progress("residual", 1, 1, "bundles");
    lap("residual", reading);
    if (search_->fitted().size() < 20) {
      out_->remarks.push_back("Too few pixels can be used to look for effects.");
      return finish(before_, start);
    }

    const auto searching = Clock::now();
    scores();
    std::set<std::string> taken;
    std::vector<Attempt> added;
    TwoShotFitPtr after = before_;
    for (int round = 0; round < options_.maxEffects && !job_.cancelled(); ++round) {
      std::vector<Attempt> attempts = roundOf(round, taken);
      const Attempt* best = chosen(attempts, after);
      if (round == 0) first_ = attempts;
      if (!best) {
        last_ = std::move(attempts);
        break;
      }
      confuse(*best, attempts);
      taken.insert(candidates_[best->candidate].id);
      search_->accept(best->deviation, best->surface ? nullptr : &best->outcome.basis);
      added.push_back(*best);
      last_ = std::move(attempts);
    }
    freeForm(added, taken, after);
    lap("score", searching);
    if (job_.cancelled()) {
      out_->cancelled = true;
      return finish(after, start);
    }

    const auto refitting = Clock::now();
    findings(added, after);
    budget(taken);
    lap("refit", refitting);
    return finish(after, start);
  }

 private:
  using TwoShotFitPtr = std::shared_ptr<const TwoShotFit>;

  void lap(const std::string& stage, Clock::time_point since) {
    out_->seconds[stage] += std::chrono::duration<double>(Clock::now() - since).count();
  }

  /// The score test of every effect that has one, at "nothing added".
  void scores() {
    scores_.assign(candidates_.size(), {});
    tbb::parallel_for(std::size_t{0}, candidates_.size(), [&](std::size_t i) {
      if (candidates_[i].linear && !job_.cancelled()) scores_[i] = search_->score(candidates_[i]);
    });
  }

  std::vector<Attempt> roundOf(int round, const std::set<std::string>& taken) {
    std::vector<Attempt> attempts;
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      const TwoShotCandidate& candidate = candidates_[i];
      if (taken.contains(candidate.id) || !candidate.unobservable.empty() || candidate.free) continue;
      Attempt attempt;
      attempt.candidate = i;
      attempt.surface = candidate.surface && !candidate.linear;
      attempts.push_back(attempt);
    }
    const SurfaceTrial trial(*basis_, search_->fitted(), search_->held(), search_->accepted());
    const SurfaceTrial::Errors without = trial.errors(search_->accepted());
    const auto total = static_cast<std::int64_t>(attempts.size());
    std::atomic<std::int64_t> done{0};
    job_.progress("score", 0, total, "effects");
    tbb::parallel_for(std::size_t{0}, attempts.size(), [&](std::size_t i) {
      Attempt& attempt = attempts[i];
      const TwoShotCandidate& candidate = candidates_[attempt.candidate];
      if (job_.cancelled()) return;
      if (attempt.surface) {
        const SurfaceTrial::Found found = trial.search(candidate, job_);
        attempt.errors = found.errors, attempt.value = found.value, attempt.deviation = found.deviation;
      } else if (candidate.heldOnly) {
        attempt.outcome = search_->heldFactors(candidate);
        attempt.value = attempt.outcome.value, attempt.deviation = attempt.outcome.deviation;
        if (attempt.outcome.tried) attempt.errors = trial.errors(attempt.deviation);
      } else {
        attempt.outcome = search_->look(candidate);
      }
      job_.progress("score", ++done, total, "effects");
    });
    // The thorough fit of those that gained most.
    std::vector<std::size_t> order;
    for (std::size_t i = 0; i < attempts.size(); ++i)
      if (!attempts[i].surface && !candidates_[attempts[i].candidate].heldOnly && attempts[i].outcome.tried &&
          attempts[i].outcome.lnEvidence > kWorthRefining)
        order.push_back(i);
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return attempts[a].outcome.lnEvidence > attempts[b].outcome.lnEvidence;
    });
    if (order.size() > kRefined) order.resize(kRefined);
    job_.progress("refit", 0, static_cast<std::int64_t>(order.size()), "effects");
    std::atomic<std::int64_t> refined{0};
    tbb::parallel_for(std::size_t{0}, order.size(), [&](std::size_t k) {
      Attempt& attempt = attempts[order[k]];
      if (job_.cancelled()) return;
      attempt.outcome = search_->refine(candidates_[attempt.candidate], attempt.outcome);
      attempt.value = attempt.outcome.value, attempt.deviation = attempt.outcome.deviation;
      const SurfaceTrial with(*basis_, search_->fitted(), search_->held(), attempt.deviation);
      attempt.errors = with.errors(attempt.deviation);
      job_.progress("refit", ++refined, static_cast<std::int64_t>(order.size()), "effects");
    });
    double around = 0;
    // Each beside what the best of those that may be an answer explains of the surroundings.
    JudgedBy by{candidates_.size(), options_.falseAlarmRate, round, 0};
    for (Attempt& attempt : attempts) {
      attempt.evidence = evidenceOf(candidates_[attempt.candidate], attempt, without, data_.shots);
      if (attempt.surface) attempt.evidence.heldSees = trial.heldSees(attempt.deviation);
      if (answerable(attempt.evidence)) around = std::max(around, attempt.evidence.lnAround);
    }
    by.around = around;
    for (Attempt& attempt : attempts) attempt.verdict = judge(attempt.evidence, by);
    if (rounds_) {
      rounds_->emplace_back();
      for (const Attempt& attempt : attempts) rounds_->back().push_back(attempt.evidence);
    }
    return attempts;
  }

  /// The attempt with the most evidence with which the whole reconstruction, all photographs and pixels, also
  /// predicts better; null: none. `after` becomes that reconstruction.
  const Attempt* chosen(std::vector<Attempt>& attempts, TwoShotFitPtr& after) {
    // What another answer predicts far better, fitted and held-out photographs alike, comes after it; what
    // the surroundings show stands by itself.
    const auto outdone = [&](const Attempt& a) {
      return std::any_of(attempts.begin(), attempts.end(), [&](const Attempt& b) {
        return b.verdict.passes && a.evidence.lnAround <= 0 && a.evidence.held &&
               b.evidence.fitRatio < kFarBetter * a.evidence.fitRatio &&
               b.evidence.heldRatio < kFarBetter * a.evidence.heldRatio;
      });
    };
    while (!job_.cancelled()) {
      const auto rank = [&](const Attempt& a) {
        return a.verdict.passes ? a.verdict.gain - (outdone(a) ? 1e3 : 0) : -1e9;
      };
      const auto best =
          std::max_element(attempts.begin(), attempts.end(),
                           [&](const Attempt& a, const Attempt& b) { return rank(a) < rank(b); });
      if (best == attempts.end() || !best->verdict.passes) return nullptr;
      if (proven(*best, after)) return &*best;
    }
    return nullptr;
  }

  /// Reconstructs with an attempt's deviation and asks the held-out photographs again.
  bool proven(Attempt& attempt, TwoShotFitPtr& after) {
    job_.progress("refit", 0, 1, "fits");
    const auto fit = refit(attempt.deviation, after);
    if (!fit) {
      attempt.verdict.passes = false;
      return false;
    }
    attempt.evidence.wholeRatio = wholeRatio(**fit, *after);
    const auto over = [](double with, double without) {
      return with >= 0 && without > 0 ? with / without : 0;
    };
    attempt.evidence.wholeSumRatio = over((*fit)->stats.holdoutRms, after->stats.holdoutRms);
    attempt.evidence.wholeFitRatio = over((*fit)->stats.fitRms, after->stats.fitRms);
    verifyWhole(attempt.evidence, attempt.verdict);
    job_.progress("refit", 1, 1, "fits");
    if (rounds_ && !rounds_->empty())
      for (TwoShotEvidence& e : rounds_->back())
        if (e.id == attempt.evidence.id && e.variant == attempt.evidence.variant) e = attempt.evidence;
    if (!attempt.verdict.passes) return false;
    steps_.push_back((*fit)->stats.holdoutRms);
    after = *fit;
    return true;
  }

  /// Errors of the held-out photographs (all together, or one by one, whichever is kinder), with over
  /// without. 1 where there are none.
  static double wholeRatio(const TwoShotFit& with, const TwoShotFit& without) {
    if (!(with.stats.holdoutRms >= 0 && without.stats.holdoutRms > 0)) return 1;
    double sum = 0, count = 0;
    for (const TwoShotComparison& a : with.comparisons)
      for (const TwoShotComparison& b : without.comparisons)
        if (a.file == b.file && a.holdout && a.rms > 0 && b.rms > 0) sum += std::log(a.rms / b.rms), ++count;
    return std::min(with.stats.holdoutRms / without.stats.holdoutRms, count > 0 ? std::exp(sum / count) : 1);
  }

  /// What has no name: the smooth deviation from the basis that the fitted photographs let expect, if it
  /// makes the held-out ones better.
  void freeForm(std::vector<Attempt>& added, std::set<std::string>& taken, TwoShotFitPtr& after) {
    const auto candidate = std::find_if(candidates_.begin(), candidates_.end(),
                                        [](const TwoShotCandidate& c) { return c.free; });
    if (candidate == candidates_.end() || job_.cancelled()) return;
    Attempt attempt;
    attempt.candidate = static_cast<std::size_t>(candidate - candidates_.begin());
    attempt.surface = true;
    attempt.deviation = search_->accepted();
    attempt.deviation.correction = model_->correction(search_->mapped(), search_->basis());
    if (!attempt.deviation.correction) return;
    double squares = 0;
    for (const HalfDiffAngles& angles : search_->mapped().angles)
      squares += attempt.deviation.correction->lnFactor(angles).square().mean() /
                 static_cast<double>(search_->mapped().angles.size());
    attempt.value = Eigen::VectorXd::Constant(1, std::sqrt(squares));
    const SurfaceTrial trial(*basis_, search_->fitted(), search_->held(), search_->accepted());
    const SurfaceTrial::Errors without = trial.errors(search_->accepted());
    attempt.errors = trial.errors(attempt.deviation);
    attempt.evidence = evidenceOf(*candidate, attempt, without, data_.shots);
    attempt.verdict = judge(attempt.evidence, {candidates_.size(), options_.falseAlarmRate, 0, 0});
    if (rounds_) rounds_->push_back({attempt.evidence});
    if (attempt.verdict.passes && proven(attempt, after)) {
      taken.insert(candidate->id);
      confidence_[candidate->id] = kFreeConfidence;
      search_->accept(attempt.deviation);
      added.push_back(attempt);
    }
    last_.push_back(std::move(attempt));
  }

  /// Explanations that the photographs hardly tell from the best one make a group, and photographs that would
  /// decide are suggested. Confidence is the probability of the group among all answers.
  void confuse(const Attempt& best, const std::vector<Attempt>& attempts) {
    const std::string& id = candidates_[best.candidate].id;
    std::vector<double> odds;
    for (const Attempt& attempt : attempts)
      odds.push_back(attempt.verdict.answers ? attempt.verdict.gain : kNoAnswer);
    const std::vector<double> probability = probabilitiesOf(odds);
    std::map<std::string, double> share;
    for (std::size_t i = 0; i < attempts.size(); ++i)
      share[candidates_[attempts[i].candidate].id] += probability[i];
    std::vector<std::string> group{id};
    const auto alias = [&](const char* a, const char* b) {
      if (id == a && group.size() < 2) group.emplace_back(b);
    };
    alias("exposure-mismatch", "light-power");
    for (const TwoShotCandidate& candidate : candidates_)
      if (candidate.id == "black-level" && !candidate.unobservable.empty())
        alias("stray-light", "black-level");
    if (group.size() < 2) {
      std::string rival;
      for (const auto& [other, p] : share)
        if (other != id && p > kAlike * share[id] && (rival.empty() || p > share[rival])) rival = other;
      if (!rival.empty()) group.push_back(rival);
    }
    if (group.size() > 1) {
      out_->confusable.push_back(group);
      out_->suggest.push_back({group[0], group[1], decidingCapture(group[0], group[1]), 0});
    }
    double confidence = 0;
    for (const std::string& member : group)
      if (share.contains(member)) confidence += share[member];
    confidence_[id] = std::clamp(confidence, 0.0, kMostConfidence);
  }

  Result<TwoShotFitPtr> refit(const TwoShotDeviation& deviation, const TwoShotFitPtr& without) {
    const auto shared = std::make_shared<const TwoShotDeviation>(deviation);
    auto fit = fitTwoShot(capture_, basis_, fitOptions_, job_, shared);
    if (!fit || !((*fit)->stats.holdoutRms >= without->stats.holdoutRms)) return fit;
    // What the effect spoilt made the basis' mean look good. Without it the photographs may bear a smaller
    // eta.
    TwoShotFitOptions options = fitOptions_;
    options.chooseEta = true;
    auto chosen = fitTwoShot(capture_, basis_, options, job_, shared);
    if (chosen && (*chosen)->stats.holdoutRms < (*fit)->stats.holdoutRms) {
      out_->remarks.push_back(
          "The refit chose its eta by cross-validation, which the effect had stood in the way of.");
      return chosen;
    }
    return fit;
  }

  /// Clipping that the bundle doesn't say: the fit leaves such pixels out by itself; here it is told.
  void clipping() {
    if (capture_.saturation > 0 || before_->stats.clippedPixels == 0) return;
    const auto clipped = static_cast<double>(before_->stats.clippedPixels);
    if (clipped < kClippedShare * (clipped + static_cast<double>(before_->stats.pixels))) return;
    double level = 0;
    for (const TwoShotComparison& comparison : before_->comparisons) {
      if (comparison.holdout) continue;
      for (const float value : comparison.captured.samples()) level = std::max<double>(level, value);
    }
    EffectFinding finding;
    finding.id = "saturation";
    finding.added = true;
    finding.parameters.push_back({"level", "pixel value", level, 0, ""});
    finding.sentence = sentenceOf("saturation", finding.parameters);
    finding.confidence = 0.95;
    finding.sigmas = std::sqrt(clipped);
    finding.correctedP = 0;
    char text[160];
    std::snprintf(
        text, sizeof text,
        "%.0f pixels of the fitted photographs hold exactly their largest value: they were left out.",
        clipped);
    finding.verdict = text;
    finding.holdoutRmsWith = finding.holdoutRmsWithout = before_->stats.holdoutRms;
    out_->effects.push_back(std::move(finding));
  }

  double sigmasOf(double p, double gain) const {
    // As a person counts: the normal variable that is exceeded as rarely. Beyond what p can hold, by the
    // odds.
    if (p < 1e-250) return std::sqrt(2 * std::max(gain, 576.0));
    double low = 0, high = 40;
    for (int i = 0; i < 60; ++i) {
      const double middle = (low + high) / 2;
      (std::erfc(middle / std::sqrt(2.0)) > p ? low : high) = middle;
    }
    return low;
  }

  void fill(EffectFinding& finding, const Attempt& attempt) const {
    const TwoShotCandidate& candidate = candidates_[attempt.candidate];
    finding.id = candidate.id;
    const double tried = static_cast<double>(candidates_.size());
    if (candidate.linear) {
      const TwoShotSearch::Score& score = scores_[attempt.candidate];
      finding.sigmas = sigmasOf(score.correctedP, attempt.verdict.gain);
      finding.correctedP = std::min(1.0, tried * score.correctedP);
      if (attempt.verdict.passes && attempt.verdict.gain > 0) {
        finding.sigmas = std::max(finding.sigmas, std::sqrt(2 * attempt.verdict.gain));
        finding.correctedP =
            std::min(finding.correctedP, std::min(1.0, tried * std::exp(-attempt.verdict.gain)));
      }
    } else {
      finding.sigmas = std::sqrt(2 * std::max(attempt.verdict.gain, 0.0));
      finding.correctedP =
          attempt.verdict.passes ? std::min(1.0, tried * std::exp(-attempt.verdict.gain)) : 1;
    }
    const double ratio = attempt.errors.held >= 0 ? attempt.evidence.heldRatio : attempt.evidence.fitRatio;
    finding.explained = std::clamp(1 - ratio * ratio, 0.0, 1.0);
    finding.verdict =
        (candidate.variant.empty() ? "" : candidate.variant + ": ") + attempt.verdict.text + ".";
    if (!finding.verdict.empty())
      finding.verdict[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(finding.verdict[0])));
  }

  void findings(const std::vector<Attempt>& added, const TwoShotFitPtr& after) {
    for (std::size_t i = 0; i < added.size(); ++i) {
      const Attempt& attempt = added[i];
      const TwoShotCandidate& candidate = candidates_[attempt.candidate];
      EffectFinding finding;
      fill(finding, attempt);
      finding.added = true;
      finding.parameters = estimatesOf(candidate, attempt.value,
                                       attempt.surface ? surfaceSd(candidate, attempt) : attempt.outcome.sd);
      finding.sentence = sentenceOf(candidate.id, finding.parameters);
      finding.confidence = confidence_[candidate.id];
      // Each as it was added: beside those before it.
      finding.holdoutRmsWith = i < steps_.size() ? steps_[i] : after->stats.holdoutRms;
      finding.holdoutRmsWithout = i > 0 ? steps_[i - 1] : before_->stats.holdoutRms;
      finding.plots.push_back(plotOf(*after));
      out_->effects.push_back(std::move(finding));
    }
    clipping();
    // Of the others, the best variant of each effect.
    std::set<std::string> told;
    for (const EffectFinding& effect : out_->effects) told.insert(effect.id);
    std::vector<const Attempt*> others;
    for (const Attempt& attempt : last_) others.push_back(&attempt);
    for (const Attempt& attempt : first_) others.push_back(&attempt);
    std::stable_sort(others.begin(), others.end(),
                     [](const Attempt* a, const Attempt* b) { return a->verdict.gain > b->verdict.gain; });
    for (const Attempt* attempt : others) {
      const TwoShotCandidate& candidate = candidates_[attempt->candidate];
      if (!told.insert(candidate.id).second) continue;
      EffectFinding finding;
      fill(finding, *attempt);
      if (attempt->errors.held >= 0) {
        finding.holdoutRmsWith = before_->stats.holdoutRms * attempt->evidence.heldRatio;
        finding.holdoutRmsWithout = before_->stats.holdoutRms;
      }
      out_->considered.push_back(std::move(finding));
    }
    for (const TwoShotCandidate& candidate : candidates_) {
      if (candidate.unobservable.empty() || !told.insert(candidate.id).second) continue;
      EffectFinding finding;
      finding.id = candidate.id;
      finding.verdict = "These photographs can't show it: " + candidate.unobservable + ".";
      out_->considered.push_back(std::move(finding));
      if (candidate.id == "retroreflection")
        out_->suggest.push_back({candidate.id, "basis-deviation", decidingCapture(candidate.id, ""), 0});
    }
    for (const EffectInfo* effect : effectCatalogue()) {
      const std::string id(effect->id);
      if (!(effect->kinds & kTwoShotKind) || !told.insert(id).second) continue;
      EffectFinding finding;
      finding.id = id;
      if (id == "light-power") {
        finding.verdict = "One factor a photograph, like an exposure mismatch: told together with it.";
      } else if (id == "saturation") {
        finding.verdict =
            "No photograph has a plateau at its largest value; clipped pixels would be left out.";
      } else {
        finding.verdict = "Not looked for in two-shot captures.";
      }
      out_->considered.push_back(std::move(finding));
    }
  }

  /// How much a parameter of a lobe may change before the error does: from the errors on either side.
  Eigen::VectorXd surfaceSd(const TwoShotCandidate& candidate, const Attempt& attempt) const {
    const SurfaceTrial trial(*basis_, search_->fitted(), search_->held(), attempt.deviation);
    Eigen::VectorXd sd = Eigen::VectorXd::Zero(attempt.value.size());
    if (candidate.free) return sd;
    for (Eigen::Index p = 0; p < sd.size(); ++p) {
      const double step = 0.15 * candidate.parameters[static_cast<std::size_t>(p)].sd;
      double curvature = 0;
      for (const double direction : {1.0, -1.0}) {
        Eigen::VectorXd moved = attempt.value;
        moved[p] += direction * step;
        TwoShotDeviation there = attempt.deviation;
        candidate.apply(moved, there);
        const double error = trial.errors(there).fit;
        if (error > 0) curvature += 2 * std::log(error / std::max(attempt.errors.fit, 1e-9)) / (step * step);
      }
      // Some thirty independent groups of rows.
      sd[p] = std::min(candidate.parameters[static_cast<std::size_t>(p)].sd,
                       1 / std::sqrt(std::max(15 * curvature, 1e-6)));
    }
    return sd;
  }

  /// Each photograph's brightness over what is predicted without and with the effects, against the radius or
  /// thetaH.
  SignaturePlot plotOf(const TwoShotFit& after) const {
    SignaturePlot plot;
    plot.title = "Error of each photograph, before and after";
    plot.xLabel = "photograph", plot.yLabel = "relative error";
    for (const TwoShotComparison& first : before_->comparisons) {
      for (const TwoShotComparison& second : after.comparisons) {
        if (first.file != second.file || first.rms < 0 || second.rms < 0) continue;
        plot.x.push_back(static_cast<double>(plot.x.size()));
        plot.xNames.push_back(first.file + (first.holdout ? " (held out)" : ""));
        plot.seen.push_back(first.rms);
        plot.expected.push_back(second.rms);
        plot.seenSd.push_back(first.noiseFloor);
      }
    }
    return plot;
  }

  void budget(const std::set<std::string>& taken) {
    std::set<std::string> told;
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      const TwoShotCandidate& candidate = candidates_[i];
      if (!candidate.linear || taken.contains(candidate.id) || job_.cancelled()) continue;
      if (!candidate.unobservable.empty() || !told.insert(candidate.id).second) continue;
      const TwoShotSearch::Score& score = scores_[i];
      for (Eigen::Index p = 0; p < score.sd.size(); ++p) {
        out_->budget.push_back(budgetLine(candidate, p, score.sd[p], score.absorbed[p]));
      }
    }
  }

  Result<ExplanationPtr> finish(const TwoShotFitPtr& after, Clock::time_point start) {
    const auto reporting = Clock::now();
    job_.progress("report", 0, 1, "reports");
    describeResiduals(*before_, *after, options_.pictures, out_.get());
    out_->twoShotBefore = before_, out_->twoShotAfter = after;
    addBasisRemedy(*out_);
    out_->cancelled |= job_.cancelled();
    job_.progress("report", 1, 1, "reports");
    lap("report", reporting);
    lap("total", start);
    return ExplanationPtr(std::move(out_));
  }

  ExplainOptions options_;
  const JobContext& job_;
  TwoShotRounds* rounds_;
  std::shared_ptr<Explanation> out_ = std::make_shared<Explanation>();
  TwoShotCapture capture_;
  BasisPtr basis_;
  TwoShotFitOptions fitOptions_;
  TwoShotFitPtr before_;
  DiagnosisData data_;
  std::vector<TwoShotCandidate> candidates_;
  std::optional<TwoShotModel> model_;
  std::optional<TwoShotSearch> search_;
  std::vector<TwoShotSearch::Score> scores_;
  std::vector<Attempt> first_, last_;
  std::map<std::string, double> confidence_;
  std::vector<double> steps_;  ///< held-out error after each effect that was added
};

}  // namespace

Result<ExplanationPtr> explainTwoShotWith(const BasisPtr& basis,
                                          const std::vector<std::filesystem::path>& bundles,
                                          const ExplainOptions& options, const JobContext& job,
                                          TwoShotRounds* rounds) {
  if (bundles.empty()) return Error{ErrorCode::Invalid, "there is no bundle to explain", "", "name one"};
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  std::optional<Result<ExplanationPtr>> result;
  arena.execute([&] { result.emplace(Explainer(basis, bundles, options, job, rounds).run()); });
  return std::move(*result);
}

Result<ExplanationPtr> explainTwoShot(const std::vector<std::filesystem::path>& bundles,
                                      const ExplainOptions& options, const JobContext& job) {
  return explainTwoShotWith(nullptr, bundles, options, job);
}

}  // namespace patina
