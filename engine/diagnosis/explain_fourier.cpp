#include <tbb/task_arena.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>

#include "engine/diagnosis/explain_kinds.h"
#include "engine/diagnosis/fourier_candidate.h"
#include "engine/diagnosis/fourier_corrections.h"
#include "engine/diagnosis/fourier_findings.h"
#include "engine/diagnosis/fourier_suggest.h"
#include "engine/diagnosis/residual_components.h"
#include "engine/diagnosis/site_horizon.h"
#include "engine/effect/effect_info.h"

namespace patina {
namespace {

using Clock = std::chrono::steady_clock;

class FourierExplainer {
 public:
  FourierExplainer(const std::vector<std::filesystem::path>& bundles, const ExplainOptions& options,
                   const JobContext& job)
      : options_(options), job_(job), out_(std::make_shared<Explanation>()) {
    out_->kind = "fourier";
    out_->bundles = bundles;
  }

  Result<ExplanationPtr> run(const std::vector<std::string>* told) {
    if (const Status ok = fitAll(); !ok) return ok.error();
    if (told) {
      if (const Status ok = addTold(*told); !ok) return ok.error();
    } else {
      if (const Status ok = search(); !ok) return ok.error();
    }
    if (const Status ok = finish(); !ok) return ok.error();
    return ExplanationPtr(out_);
  }

 private:
  void time(const char* stage, Clock::time_point since) {
    out_->seconds[stage] += std::chrono::duration<double>(Clock::now() - since).count();
  }
  Error cancelled() const {
    return Error{ErrorCode::Cancelled, "cancelled while looking for causes", "", ""};
  }

  Status fitAll() {
    const auto start = Clock::now();
    std::vector<DiagnosisCapture> captures;
    for (const auto& bundle : out_->bundles) {
      auto capture = readFourierCapture(bundle, job_);
      if (!capture) return capture.error();
      FourierFitOptions fitOptions;
      fitOptions.size = options_.size;
      auto fit = fitFourier(*capture, fitOptions, job_);
      if (!fit) return fit.error();
      if ((*fit)->stats().cancelled) return cancelled();
      const int count = std::max(150, options_.testedTexels / static_cast<int>(out_->bundles.size()));
      auto laid = diagnosisCapture(*fit, count, job_);
      if (!laid) return laid.error();
      captures.push_back(std::move(*laid));
    }
    session_.emplace(std::move(captures));
    const FourierFitStats& stats = session_->captures[0].fit->stats();
    out_->fourierBefore = session_->captures[0].fit;
    out_->before = {stats.fitRms, stats.holdoutRms};
    out_->noiseFloorFit = stats.noiseFloorFit;
    out_->noiseFloorHoldout = stats.noiseFloorHoldout;
    time("fit", start);
    const auto residual = Clock::now();
    job_.progress("residual", 0, 1, "steps");
    refineSession(*session_, 5, job_);
    for (std::size_t k = 0; k < session_->captures.size(); ++k)
      correctNoise(session_->captures[k], modelOf(*session_, k), job_);
    const auto pictures = sessionPictures(*session_, job_);
    for (std::size_t k = 0; k < pictures.size(); ++k) session_->captures[k].pictures = pictures[k];
    reweigh();
    settleFootprint();
    baseError_ = sessionError(*session_, job_);
    base_.emplace(*session_);
    out_->chi2Before = baseError_.first.noiseChi2 / std::max(baseError_.first.noiseCount, 1.0);
    time("residual", residual);
    if (job_.cancelled()) return cancelled();
    return Done{};
  }

  void reweigh() {
    for (std::size_t k = 0; k < session_->captures.size(); ++k) {
      const FourierDiagnosisModel model = modelOf(*session_, k);
      session_->captures[k].inflation.clear();
      setRobustWeights(session_->captures[k], model, job_);
      inflateScatter(session_->captures[k], model, job_);
    }
    refineSession(*session_, 3, job_, false);
  }

  /// A pixel averages over its own extent: a blur of a variance of up to 1 / 12 pixel^2, which is no defocus.
  /// What is clearly more is left to the search, whole: whether a camera samples or averages isn't known.
  void settleFootprint() {
    constexpr double kMost = 1.0 / 12, kClearlyMore = 0.15;
    DiagnosisSession few = thinned(*session_, 300);
    const ScoreTest test = scoreSession(few, wantedFor({"defocus"}), job_);
    const ScoreResult solved = test.solve({"defocus"});
    if (solved.estimate.size() != 1 || !(solved.estimate[0] > 3 * solved.sd[0])) return;
    if (solved.estimate[0] > kClearlyMore) return;
    for (auto& state : session_->states) state.footprint = std::min(solved.estimate[0], kMost);
    reweigh();
  }

  std::vector<FourierCandidate> score(const ScoreTest& test) const {
    std::vector<FourierCandidate> all;
    const ScoreSums total = test.total();
    for (const EffectInfo* info : effectCatalogue()) {
      if (!(info->kinds & kFourierKind)) continue;
      FourierCandidate candidate;
      candidate.id = std::string(info->id);
      if (std::ranges::find(added_, candidate.id) != added_.end()) continue;
      if (test.numbers({candidate.id}).empty()) continue;
      candidate.score = test.solve({candidate.id}, added_);
      // Once the effect is in, what is left says how much larger than noise the residual's scatter is.
      candidate.phi = std::max(1.0, (total.chi2 - candidate.score.gain) / std::max(total.count, 1.0));
      candidate.correctedP = chiSquareTail(candidate.score.gain / candidate.phi, candidate.score.numbers);
      all.push_back(std::move(candidate));
    }
    for (auto& c : all) c.correctedP = std::min(1.0, c.correctedP * static_cast<double>(all.size()));
    std::ranges::sort(all, std::greater<>(),
                      [](const FourierCandidate& c) { return c.score.logEvidence / c.phi; });
    for (const auto& c : all) job_.info(scoreText(c));
    return all;
  }

  /// Which candidates are worth a refit.
  std::vector<std::size_t> shortlist(const std::vector<FourierCandidate>& all) const {
    std::vector<std::size_t> list;
    double mostGain = 0;
    for (const auto& c : all) mostGain = std::max(mostGain, c.score.gain);
    const auto add = [&](std::size_t i) {
      if (std::ranges::find(list, i) == list.end()) list.push_back(i);
    };
    for (std::size_t i = 0; i < all.size() && list.size() < kRefits; ++i)
      if (all[i].correctedP < options_.falseAlarmRate && all[i].score.logEvidence > 0) add(i);
    for (std::size_t i = 0; i < all.size(); ++i) {
      const FourierCandidate& c = all[i];
      if (c.correctedP >= options_.falseAlarmRate) continue;
      // Effects of few numbers whose share is large; those that at zero strength show little of what they do
      // later.
      const bool simple = c.score.numbers <= 6 && c.score.gain > 0.6 * mostGain;
      const bool late = c.id == "self-shadowing" && c.score.gain > 0.25 * mostGain;
      const bool ordered = c.id == "screen-drift" && c.score.gain > 0.1 * mostGain;
      if (simple || late || ordered) add(i);
    }
    return list;
  }

  Status search() {
    for (int round = 0; round <= options_.maxEffects; ++round) {
      const auto start = Clock::now();
      job_.progress("score", round, options_.maxEffects + 1, "rounds");
      ScoreTest test = scoreSession(*session_, {}, job_);
      if (job_.cancelled()) return cancelled();
      std::vector<FourierCandidate> all = score(test);
      time("score", start);
      if (round == 0) rememberFirst(all);
      if (round == options_.maxEffects) {
        last_.emplace(std::move(test));
        break;
      }
      const auto refitting = Clock::now();
      // Weak effects need all sites, strong ones few.
      double mostGain = 1;
      for (const FourierCandidate& c : all)
        if (c.correctedP < options_.falseAlarmRate && c.score.logEvidence > 0)
          mostGain = std::max(mostGain, c.score.gain);
      const auto refitSites =
          std::max(kRefitSites, std::min(static_cast<std::size_t>(kRefitSites * kPlentyOfGain / mostGain),
                                         session_->captures[0].sites.size()));
      DiagnosisSession small = thinned(*session_, refitSites);
      const SessionError before = sessionError(small, job_);
      const std::vector<std::size_t> list = shortlist(all);
      std::size_t done = 0;
      double mostImprovement = 0;
      for (const std::size_t i : list) {
        FourierCandidate& c = all[i];
        // First order tells more than the truth for weak effects and less for strong ones, but not by so
        // much.
        const double share = static_cast<double>(refitSites) / static_cast<double>(std::max<std::size_t>(
                                                                   session_->captures[0].sites.size(), 1));
        if (c.id != "self-shadowing" && c.id != "screen-drift" &&
            kFirstOrder * c.score.gain * std::min(1.0, share) < mostImprovement)
          continue;
        DiagnosisSession trial = small;
        std::vector<std::string> effects = added_;
        effects.push_back(c.id);
        // Clipping bends the own parameters far from where they belong: the way back is long.
        c.refit = refitEffects(trial, effects, c.id == "saturation" ? 12 : 4, job_);
        if (job_.cancelled()) return cancelled();
        judgeRefit(c, before, trial, static_cast<double>(heldRows()));
        if (c.plausible) mostImprovement = std::max(mostImprovement, c.improvement);
        c.session.emplace(std::move(trial));
        job_.info(refitText(c, before));
        job_.progress("refit", static_cast<std::int64_t>(++done), static_cast<std::int64_t>(list.size()),
                      "candidates");
      }
      time("refit", refitting);
      FourierCandidate* best = nullptr;
      for (const std::size_t i : list) {
        FourierCandidate& c = all[i];
        if (!acceptable(c)) continue;
        if (!best || c.improvement > best->improvement) best = &c;
      }
      // A cause of few numbers before one of a number for each photograph that does little better: with the
      // first in, the second must earn its numbers again.
      if (best && best->score.numbers > 50) {
        FourierCandidate* simple = nullptr;
        for (const std::size_t i : list) {
          FourierCandidate& c = all[i];
          if (acceptable(c) && c.score.numbers < 10 && c.improvement > kOrdered * best->improvement &&
              (!simple || c.improvement > simple->improvement))
            simple = &c;
        }
        if (simple) best = simple;
      }
      // A named cause before a free form that does hardly better.
      if (best && best->id == "basis-deviation")
        for (const std::size_t i : list)
          if (FourierCandidate& c = all[i];
              &c != best && acceptable(c) && c.improvement > 0.9 * best->improvement &&
              (best->id == "basis-deviation" || c.improvement > best->improvement))
            best = &c;
      if (round == 0 && !list.empty()) noteTried(all, list);
      if (!best) {
        last_.emplace(std::move(test));
        break;
      }
      noteConfusable(all, list, *best, test);
      const double share = secondShare(all, list, *best);
      const std::string id = best->id;
      confidence_[id] = confidenceOf(*best, share);
      mostAdded_ = std::max(mostAdded_, best->noiseGain);
      scores_[id] = *best;
      scores_[id].session.reset();
      // All tested sites, started from the small set's strengths.
      session_->states = best->session->states;
      added_.push_back(id);
      DiagnosisSession middle = thinned(*session_, kFinalSites);
      refineSession(middle, 4, job_, false);
      refit_ = refitEffects(middle, added_, 6, job_);
      takeOver(middle);
      plots_[id] = signature(id);
      reweigh();
      if (job_.cancelled()) return cancelled();
    }
    return Done{};
  }

  /// All tested sites under the strengths of a smaller set.
  void takeOver(const DiagnosisSession& from) {
    session_->states = from.states;
    refineSession(*session_, 4, job_, false);
    for (std::size_t k = 0; k < session_->captures.size(); ++k)
      if (session_->states[k].has("self-shadowing"))
        findHorizons(session_->captures[k], modelOf(*session_, k), job_, &from.captures[k].sites);
    refineSession(*session_, 5, job_, false);
  }

  /// Of one effect alone, against the base, for its picture.
  SignaturePlot signature(const std::string& id) {
    DiagnosisSession few = thinned(*base_, 120);
    const ScoreTest test = scoreSession(few, wantedFor({id}), job_);
    return signatureByFrequency(few, test, id, job_);
  }

  bool acceptable(const FourierCandidate& c) const {
    if (!c.tried || !c.plausible || c.improvement <= kLeastImprovement * c.phi) return false;
    // What has been added is itself modelled to some part in a hundred: less than that may be its shadow.
    if (c.noiseGain < kShadow * mostAdded_) return false;
    if (heldRows() == 0) return true;
    // A few numbers that all photographs together ask for plainly can't be overfitted: the held-out ones, a
    // fifth of them, then must not speak against it, which is all that they can say of a weak effect. What
    // comes after another effect may be what that one left.
    if (added_.empty() && c.score.numbers <= 6 && c.heldGain > 0 && c.improvement > kPlainImprovement * c.phi)
      return true;
    // Beyond its uncertainty; or, where a few patches hold most of it, in nearly all patches.
    return c.heldGain > kLeastHeldGain * c.phi && (c.heldGain > 2 * c.heldSd || c.betterPatches > 0.75);
  }

  /// A number for each photograph follows any curve over time: no rival of the few numbers that it was passed
  /// over for.
  static bool holdsBoth(const FourierCandidate& many, const FourierCandidate& few) {
    return many.score.numbers > 50 && few.score.numbers < 10;
  }

  std::size_t heldRows() const {
    std::size_t n = 0;
    for (const auto& row : session_->captures[0].rows) n += row.holdout;
    return n;
  }

  static double secondShare(const std::vector<FourierCandidate>& all, const std::vector<std::size_t>& list,
                            const FourierCandidate& best) {
    double second = 0;
    for (const std::size_t i : list)
      if (&all[i] != &best && all[i].tried && all[i].plausible && !holdsBoth(all[i], best))
        second = std::max(second, all[i].improvement);
    return best.improvement > 0 ? second / best.improvement : 1;
  }

  void noteConfusable(const std::vector<FourierCandidate>& all, const std::vector<std::size_t>& list,
                      const FourierCandidate& best, const ScoreTest& test) {
    std::vector<std::pair<double, std::string>> others;
    for (const std::size_t i : list) {
      const FourierCandidate& c = all[i];
      if (&c == &best || !c.tried || !c.plausible || c.id == "basis-deviation" || holdsBoth(c, best))
        continue;
      const double gap = best.improvement - c.improvement;
      const bool close = gap < 15 * best.phi || c.improvement > 0.97 * best.improvement;
      if (close && test.correlation(best.id, c.id) > 0.5) others.push_back({gap, c.id});
    }
    if (others.empty()) return;
    std::ranges::sort(others);
    std::vector<std::string> group = {best.id};
    for (const auto& [gap, id] : others)
      if (group.size() < 3) group.push_back(id);
    out_->suggest.push_back(suggestCapture(*session_, test, group[0], group[1], job_));
    out_->confusable.push_back(std::move(group));
  }

  void rememberFirst(const std::vector<FourierCandidate>& all) {
    for (const FourierCandidate& c : all) {
      EffectFinding finding;
      finding.id = c.id;
      finding.sigmas = sigmasOf(c.score.gain / c.phi, c.score.numbers);
      finding.correctedP = c.correctedP;
      if (c.correctedP >= options_.falseAlarmRate)
        finding.verdict = "Not needed: the photographs show no more of it than noise would.";
      else
        finding.verdict = "The score test sees something like it, but others explain the residual better.";
      out_->considered.push_back(std::move(finding));
    }
  }

  void noteTried(const std::vector<FourierCandidate>& all, const std::vector<std::size_t>& list) {
    for (const std::size_t i : list) {
      const FourierCandidate& c = all[i];
      for (auto& finding : out_->considered) {
        if (finding.id != c.id) continue;
        finding.explained = c.explained;
        finding.holdoutRmsWith = c.heldRms;
        finding.holdoutRmsWithout = baseError_.first.heldRms;
        if (!c.plausible)
          finding.verdict = "It would need a strength that no rig or sample has.";
        else if (!acceptable(c))
          finding.verdict =
              "Refitted with it, photographs that the fit never saw are not predicted better beyond the "
              "uncertainty.";
        else
          finding.verdict = "It would help, but another effect explains the residual better.";
      }
    }
  }

  Status addTold(const std::vector<std::string>& ids) {
    const auto start = Clock::now();
    added_ = ids;
    if (ids.empty()) return Done{};
    DiagnosisSession small = thinned(*session_, kRefitSites);
    refitEffects(small, ids, 6, job_);
    session_->states = small.states;
    DiagnosisSession middle = thinned(*session_, kFinalSites);
    refineSession(middle, 4, job_, false);
    refit_ = refitEffects(middle, ids, 6, job_);
    takeOver(middle);
    for (const auto& id : ids) {
      plots_[id] = signature(id);
      confidence_[id] = 1;
    }
    if (job_.cancelled()) return cancelled();
    last_.emplace(scoreSession(*session_, {}, job_));
    time("refit", start);
    return Done{};
  }

  /// Effects that turn out not to be needed once others are in.
  void dropUnneeded() {
    if (added_.size() < 2) return;
    DiagnosisSession small = thinned(*session_, kRefitSites);
    SessionError with = sessionError(small, job_);
    withoutRms_.clear();
    // Whichever is missed least goes first: what was added before the right cause was found.
    while (added_.size() > 1) {
      const double phi = std::max(1.0, with.chi2 / std::max(with.count, 1.0));
      std::size_t least = added_.size();
      double leastLoss = std::numeric_limits<double>::max();
      std::optional<DiagnosisSession> without;
      RefitResult refitWithout;
      for (std::size_t k = 0; k < added_.size(); ++k) {
        std::vector<std::string> others = added_;
        others.erase(others.begin() + static_cast<std::ptrdiff_t>(k));
        DiagnosisSession trial = small;
        resetEffect(trial, added_[k]);
        refineSession(trial, 4, job_, false);
        RefitResult refit = refitEffects(trial, others, 3, job_);
        if (job_.cancelled()) return;
        withoutRms_[added_[k]] = refit.error.first.heldRms;
        const double loss = refit.error.all() - with.all();
        loss_[added_[k]] = loss;
        const bool unneeded =
            loss < kLeastImprovement * phi || refit.error.noise - with.noise < kShadow * mostAdded_;
        if (!unneeded || loss >= leastLoss) continue;
        least = k, leastLoss = loss;
        without.emplace(std::move(trial));
        refitWithout = std::move(refit);
      }
      if (!without) break;
      dropped_.push_back(added_[least]);
      resetEffect(*session_, added_[least]);
      added_.erase(added_.begin() + static_cast<std::ptrdiff_t>(least));
      session_->states = without->states;
      refineSession(*session_, 5, job_, false);
      refit_ = std::move(refitWithout);
      small = thinned(*session_, kRefitSites);
      with = sessionError(small, job_);
    }
  }

  /// Takes an effect out again, the others fitted without it.
  void withdraw(const std::string id) {
    dropped_.push_back(id);
    std::erase(added_, id);
    resetEffect(*session_, id);
    refineSession(*session_, 4, job_, false);
    DiagnosisSession middle = thinned(*session_, kFinalSites);
    refit_ = refitEffects(middle, added_, 4, job_);
    takeOver(middle);
  }

  Status finish() {
    const auto start = Clock::now();
    dropUnneeded();
    if (job_.cancelled()) return cancelled();
    const SessionError after = sessionError(*session_, job_);
    out_->chi2After = after.first.noiseChi2 / std::max(after.first.noiseCount, 1.0);
    if (!last_) last_.emplace(scoreSession(*session_, {}, job_));
    const double phi = std::max(1.0, after.chi2 / std::max(after.count, 1.0));
    time("residual", start);

    const auto maps = Clock::now();
    out_->fourierAfter = out_->fourierBefore;
    out_->after = out_->before;
    while (!added_.empty()) {
      job_.progress("maps", 0, 1, "steps");
      auto corrected = correctCapture(*session_, 0, job_);
      if (!corrected) return corrected.error();
      FourierFitOptions fitOptions;
      fitOptions.size = options_.size;
      fitOptions.corrections = corrected->corrections;
      auto fit = fitFourier(corrected->capture, fitOptions, job_);
      corrected_.emplace(std::move(*corrected));
      if (!fit) return fit.error();
      if ((*fit)->stats().cancelled) return cancelled();
      const FourierFitStats& stats = (*fit)->stats();
      const double now = stats.holdoutRms >= 0 ? stats.holdoutRms : stats.fitRms,
                   was = stats.holdoutRms >= 0 ? out_->before.holdoutRms : out_->before.fitRms;
      if (now <= kWorse * was) {
        out_->fourierAfter = *fit;
        out_->after = {stats.fitRms, stats.holdoutRms};
        break;
      }
      if (added_.size() > 1) {  // the weakest goes, and its numbers with it
        withdraw(*std::ranges::min_element(added_, {}, [&](const std::string& id) {
          return scores_.contains(id) ? scores_[id].improvement : 0;
        }));
        continue;
      }
      out_->remarks.push_back(
          "The whole fit is not better with it than without, so the maps are those without it: the effect is "
          "seen by the numerical model only.");
      break;
    }
    time("maps", maps);

    // Strongest first; the free form, which names nothing, last.
    std::vector<std::string> order = added_;
    std::ranges::stable_sort(order, {}, [&](const std::string& id) {
      const double weight = loss_.contains(id)     ? loss_[id]
                            : scores_.contains(id) ? scores_[id].improvement
                                                   : 0;
      return (id == "basis-deviation" ? 1e18 : 0) - weight;
    });
    for (const std::string& id : order) {
      EffectFinding finding;
      for (auto it = out_->considered.begin(); it != out_->considered.end(); ++it) {
        if (it->id != id) continue;
        finding = *it;
        out_->considered.erase(it);
        break;
      }
      finding.id = id;
      finding.added = true;
      finding.verdict = "Added: photographs that the fit never saw are predicted better with it.";
      finding.parameters = effectParameters(*session_, id, &refit_);
      finding.sentence = effectSentence(id, finding.parameters);
      finding.confidence = confidence_.at(id);
      finding.holdoutRmsWith = out_->after.holdoutRms;
      finding.holdoutRmsWithout = added_.size() == 1         ? out_->before.holdoutRms
                                  : withoutRms_.contains(id) ? withoutRms_[id]
                                                             : out_->before.holdoutRms;
      finding.curves = effectCurves(*session_, id);
      finding.maps = effectMaps(*session_, id, corrected_ ? &*corrected_ : nullptr);
      if (plots_.contains(id) && !plots_[id].x.empty()) finding.plots.push_back(plots_[id]);
      out_->effects.push_back(std::move(finding));
    }
    for (auto& finding : out_->considered)
      if (std::ranges::find(dropped_, finding.id) != dropped_.end())
        finding.verdict = "Added at first, and dropped: with the others in, it isn't needed.";
    out_->budget = effectBudget(*session_, *last_, added_, phi);

    const double floor2 = std::pow(out_->noiseFloorHoldout, 2);
    const bool held = out_->before.holdoutRms >= 0;
    const double before2 = std::pow(held ? out_->before.holdoutRms : out_->before.fitRms, 2),
                 after2 = std::pow(held ? out_->after.holdoutRms : out_->after.fitRms, 2);
    const double floorHere = held ? floor2 : std::pow(out_->noiseFloorFit, 2);
    // A residual within 3 % of the noise has no energy to speak of.
    out_->unexplained.fraction =
        before2 > 1.06 * floorHere ? std::clamp((after2 - floorHere) / (before2 - floorHere), 0.0, 1.0) : 0;
    out_->unexplained.description = describeRest(session_->captures[0], after.first);
    if (added_.empty() && out_->chi2Before < 1.1)
      out_->remarks.push_back(
          "Nothing is missing that these photographs could show: the standard model predicts them to their "
          "noise.");
    if (out_->chi2After > 1.3)
      out_->remarks.push_back("Something is missing that has no name here: " + out_->unexplained.description);
    out_->breakdowns = residualBreakdowns(session_->captures[0], baseError_.first, after.first);
    listPhotographs(session_->captures[0], baseError_.first, after.first, *out_);
    if (options_.pictures) drawResidual(*base_, *session_, *out_, job_);
    return Done{};
  }

  static constexpr std::size_t kRefits = 6, kRefitSites = 150, kFinalSites = 400;
  static constexpr double kLeastImprovement = 25, kLeastHeldGain = 6;
  static constexpr double kShadow = 0.015;
  static constexpr double kWorse = 1.002;  ///< of the error before: a fit with effects that is no better
  static constexpr double kPlainImprovement = 50;
  static constexpr double kPlentyOfGain = 3000;  ///< of the score: with as much, kRefitSites tell
  static constexpr double kOrdered = 0.7;
  static constexpr double kFirstOrder = 6;  ///< a refit gains at most so many times what the score says

  ExplainOptions options_;
  JobContext job_;
  std::shared_ptr<Explanation> out_;
  std::optional<DiagnosisSession> session_, base_;
  SessionError baseError_;
  double mostAdded_ = 0;  ///< largest noiseGain of what was added
  std::vector<std::string> added_, dropped_;
  std::map<std::string, double> confidence_;  ///< when it was added
  std::map<std::string, FourierCandidate> scores_;
  std::map<std::string, SignaturePlot> plots_;
  std::map<std::string, double> withoutRms_;
  std::map<std::string, double> loss_;  ///< of chi-square without it, the others in: what "strongest" means
  std::optional<ScoreTest> last_;
  std::optional<CorrectedCapture> corrected_;
  RefitResult refit_;
};

Result<ExplanationPtr> runExplainer(const std::vector<std::filesystem::path>& bundles,
                                    const std::vector<std::string>* told, const ExplainOptions& options,
                                    const JobContext& job) {
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  std::optional<Result<ExplanationPtr>> result;
  const auto start = Clock::now();
  arena.execute([&] {
    FourierExplainer explainer(bundles, options, job);
    result.emplace(explainer.run(told));
  });
  if (*result)
    std::const_pointer_cast<Explanation>(**result)->seconds["total"] =
        std::chrono::duration<double>(Clock::now() - start).count();
  return *result;
}

}  // namespace

Result<ExplanationPtr> explainFourier(const std::vector<std::filesystem::path>& bundles,
                                      const ExplainOptions& options, const JobContext& job) {
  return runExplainer(bundles, nullptr, options, job);
}

Result<ExplanationPtr> explainFourierWith(const std::vector<std::filesystem::path>& bundles,
                                          const std::vector<std::string>& ids, const ExplainOptions& options,
                                          const JobContext& job) {
  return runExplainer(bundles, &ids, options, job);
}

}  // namespace patina
