#include "engine/diagnosis/two_shot_judge.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "engine/diagnosis/two_shot_odds.h"

namespace patina {
namespace {

/// ln odds against "nothing is missing" from which an effect is named, at the usual false-alarm rate: the
/// more probable answer.
constexpr double kNamed = 0, kUsualRate = 0.01;
/// ln odds of the process, beyond the number of effects tried over the false-alarm rate, for its own faults.
constexpr double kModelDoubt = 8;
/// A lobe is shown where it takes this off the error of the photographs that were fitted and of those held
/// out, of this share of them; without any held out, the third bound is for the fitted ones. ln odds of it
/// then.
constexpr double kLobeFit = 0.45, kLobeHeld = 0.9, kLobeFitAlone = 0.35, kLobeShare = 0.6, kLobeShown = 3;
/// ln odds of what can't be an answer.
constexpr double kNothing = -20;
/// Of what the best attempt explains of the surroundings, this share may be missed.
constexpr double kAroundShare = 0.25;
/// A change of less than this, natural-log units, is nobody's concern.
constexpr double kSmallestReach = 0.002;
/// A second effect must make held-out photographs better by this: the first one's leftovers look like
/// effects.
constexpr double kFurtherHeld = 0.93;
/// The held-out photographs' error may grow by this and no more; from here it is plainly smaller.
constexpr double kWorseHeld = 1.03, kPlainly = 0.8;
/// ln of the odds that the surroundings may lose, and at which they have spoken.
constexpr double kSpeaksAgainst = 5, kAroundSpeaks = 15;
/// A free-form correction must take this off the held-out photographs' error, and make this share of them
/// better.
constexpr double kFreeHeld = 0.8, kFreeBetter = 0.7;
/// The whole reconstruction must gain this with a free correction, with a term of the surface and with an
/// effect of the set-up; where the surroundings have spoken it must not lose more than the last.
constexpr double kWholeFree = 0.6, kWholeSurface = 0.88, kWholeSetUp = 0.97, kWholeAround = 1.1;
/// A lobe that takes this off the fitted photographs' error of the whole reconstruction need not help others.
constexpr double kWholeLobeFit = 0.5;

/// Errors of held-out photographs, with over without: the sum's, or the photographs' own, whichever is
/// kinder: one highlight among four photographs decides the first alone, and one dark photograph the second.
double heldRatio(const SurfaceTrial::Errors& with, const SurfaceTrial::Errors& without,
                 const std::vector<DiagnosisShot>& shots) {
  if (!(with.held >= 0 && without.held > 0)) return 1;
  double sum = 0, count = 0;
  for (std::size_t s = 0; s < with.shot.size() && s < without.shot.size(); ++s) {
    if (!shots[s].holdout || !(with.shot[s] > 0 && without.shot[s] > 0)) continue;
    sum += std::log(with.shot[s] / without.shot[s]), ++count;
  }
  const double each = count > 0 ? std::exp(sum / count) : 1;
  return std::min(with.held / without.held, each);
}

}  // namespace

TwoShotEvidence evidenceOf(const TwoShotCandidate& candidate, const Attempt& attempt,
                           const SurfaceTrial::Errors& without, const std::vector<DiagnosisShot>& shots) {
  TwoShotEvidence e;
  const TrialOutcome& o = attempt.outcome;
  e.id = candidate.id, e.variant = candidate.variant;
  e.free = candidate.free, e.heldOnly = candidate.heldOnly;
  e.surface = candidate.surface, e.lobe = attempt.surface;
  e.held = without.held > 0;
  e.refined = attempt.errors.fit >= 0 && without.fit > 0;
  if (e.refined) {
    e.fitRatio = attempt.errors.fit / without.fit;
    e.heldRatio = heldRatio(attempt.errors, without, shots);
    double better = 0, count = 0;
    for (std::size_t s = 0; s < attempt.errors.shot.size() && s < without.shot.size(); ++s) {
      if (!shots[s].holdout || !(attempt.errors.shot[s] > 0 && without.shot[s] > 0)) continue;
      const double ratio = attempt.errors.shot[s] / without.shot[s];
      better += ratio < 1, ++count;
      e.heldWorst = count > 1 ? std::max(e.heldWorst, ratio) : ratio;
    }
    e.heldBetter = count > 0 ? better / count : 0;
  }
  e.lnEvidence = o.lnEvidence, e.lnHeld = o.lnHeld, e.lnAround = o.lnAround, e.reach = o.reach;
  e.grain = o.basis.brightness.grain, e.fine = o.basis.brightness.fine, e.broad = o.basis.brightness.broad;
  if (attempt.value.size() > 0) e.first = attempt.value[0];
  if (o.sd.size() > 0) e.firstSd = o.sd[0];
  if (!attempt.surface && attempt.value.size() > 0)
    e.sensible = attempt.value.cwiseAbs().maxCoeff() >= candidate.least &&
                 !(candidate.positive && attempt.value[0] < 0);
  return e;
}

TwoShotVerdict judge(const TwoShotEvidence& e, const JudgedBy& by) {
  TwoShotVerdict out;
  char text[300];
  if (e.free) {
    out.passes = e.held && e.heldRatio <= kFreeHeld && e.heldBetter >= kFreeBetter;
    out.gain = -std::log(std::max(e.heldRatio, 1e-3));
    if (!e.held) {
      out.text = "without held-out photographs a free correction can't be judged";
      return out;
    }
    std::snprintf(text, sizeof text,
                  "with a free smooth correction the held-out photographs' error would be %.2f times what it "
                  "is; %.0f %% of them would be predicted better",
                  e.heldRatio, 100 * e.heldBetter);
    out.text = text;
    return out;
  }
  out.gain = kNothing;
  if (!e.refined) {
    out.text = "the photographs are no more probable with it than without";
    return out;
  }
  out.answers = answerable(e);
  if (!out.answers) {
    out.text = !e.sensible || e.reach <= kSmallestReach
                   ? "what would explain the photographs best is no strength that makes sense"
                   : "a material of another colour or contrast would look the same";
    return out;
  }
  out.gain = lnOddsOf(e, by.around);
  // Few drawn captures hold a lobe that the held-out photographs don't look at: what the weights know too
  // little of is decided by what a person gets.
  const bool shown = e.lobe && by.around <= kAroundSpeaks &&
                     (e.held ? e.fitRatio <= kLobeFit && e.heldRatio <= (e.heldSees ? kLobeHeld : 1) &&
                                   (!e.heldSees || e.heldBetter >= kLobeShare)
                             : e.fitRatio <= kLobeFitAlone);
  if (shown) out.gain = std::max(out.gain, kLobeShown);
  const double needed = kNamed + std::log(kUsualRate / std::max(by.falseAlarmRate, 1e-6));
  // The surroundings know nothing of the material: what explains the photographs must explain them too.
  const bool misses = by.around > kAroundSpeaks && e.lnAround < (1 - kAroundShare) * by.around - 10;
  const bool against = e.lnAround < -kSpeaksAgainst;
  // The first effect's leftovers look like effects.
  const bool further = by.round == 0 || e.lnAround > kAroundSpeaks || e.heldRatio < kFurtherHeld;
  // Held-out photographs that lose plainly refuse; a process' bounds alone don't outweigh plainly better
  // pictures.
  const bool heldLose = e.held && !e.lobe && !e.heldOnly && e.lnAround <= kAroundSpeaks &&
                        (e.heldRatio > kWorseHeld || (e.lnHeld < 0 && e.heldRatio > kPlainly));
  // However much better the pictures look: chance among so many effects must be excluded.
  const bool chance = !e.lobe && !e.heldOnly &&
                      e.lnEvidence + e.lnHeld < kModelDoubt + std::log(static_cast<double>(by.tried) /
                                                                       std::max(by.falseAlarmRate, 1e-6));
  const bool lobeLoses = e.held && e.lobe && e.heldSees && e.heldRatio >= 1;
  out.passes = out.gain > needed && !misses && !against && further && !heldLose && !lobeLoses && !chance;
  if (misses) {
    out.text = "it doesn't explain what lies around the sample, which is lit and photographed like it";
  } else if (against) {
    out.text = "what lies around the sample speaks against it";
  } else if (out.gain > needed && chance) {
    out.text = "the evidence for it is no more than chance may give";
  } else if (out.gain > needed && (heldLose || lobeLoses)) {
    out.text = "it explains the fitted photographs, but the held-out ones speak against it";
  } else if (!further) {
    out.text = "what the first effect leaves over explains as much";
  } else if (e.lobe) {
    std::snprintf(text, sizeof text,
                  "with it the fitted photographs' error would be %.2f times, the held-out ones' %.2f times "
                  "what it is%s",
                  e.fitRatio, e.heldRatio, out.passes ? "" : ": the basis does as well without it");
    out.text = text;
  } else {
    std::snprintf(text, sizeof text,
                  "the fitted photographs are e^%.0f, the held-out ones e^%.0f times as probable with it, "
                  "their errors %.2f and %.2f times what they are%s",
                  e.lnEvidence, e.lnHeld, e.fitRatio, e.heldRatio,
                  out.passes ? "" : ": what was tried on materials without it gave as much");
    out.text = text;
  }
  return out;
}

bool answerable(const TwoShotEvidence& e) {
  if (e.free || !e.refined || !e.sensible) return false;
  if (!e.lobe && !e.heldOnly && e.reach <= kSmallestReach) return false;
  // Colours that mix in the camera are colours of the material to a fit: only what lies around the sample
  // can tell.
  const bool ofTheMaterial = e.id == "channel-crosstalk" || e.id == "camera-response";
  return !ofTheMaterial || e.lnAround > kAroundSpeaks;
}

void verifyWhole(const TwoShotEvidence& e, TwoShotVerdict& verdict) {
  if (!e.held || !(e.wholeRatio > 0)) return;
  const double most = e.free                       ? kWholeFree
                      : e.surface                  ? kWholeSurface
                      : e.lnAround > kAroundSpeaks ? kWholeAround
                                                   : kWholeSetUp;
  // One dark photograph that gains must not pay for a bright one that loses.
  const bool allLose = !e.surface && e.lnAround <= kAroundSpeaks && e.wholeSumRatio > 1;
  // Few held-out photographs look where a lobe is: there the fitted ones decide, if the others don't lose.
  const bool lobeSeen = e.lobe && !e.free && e.wholeFitRatio > 0 && e.wholeFitRatio <= kWholeLobeFit &&
                        e.wholeRatio <= 1 && e.wholeSumRatio <= 1;
  if ((e.wholeRatio <= most && !allLose) || lobeSeen) return;
  verdict.passes = false;
  char text[200];
  std::snprintf(
      text, sizeof text,
      "it explains the photographs, but the whole reconstruction doesn't predict held-out ones better "
      "with it (%.2f times the error)",
      e.wholeRatio);
  verdict.text = text;
}

}  // namespace patina
