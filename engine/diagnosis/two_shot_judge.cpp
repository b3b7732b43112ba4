#include "engine/diagnosis/two_shot_judge.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace patina {
namespace {

/// ln of the odds that an effect must have gained, beyond the number of effects tried and the false-alarm
/// rate: what the model of deviations from the basis may itself be wrong by (measured materials outside of
/// the basis).
constexpr double kModelDoubt = 8;
/// A term of the surface must take this off the error of the photographs that were fitted and of those held
/// out; without any held out, the second bound is for the fitted ones.
constexpr double kSurfaceFit = 0.45, kSurfaceHeld = 0.9, kSurfaceFitAlone = 0.35;
/// The same where no held-out photograph sees the lobe.
constexpr double kUnseenHeld = 1;
/// Of the held-out photographs a term of the surface must make this share better.
constexpr double kSurfaceShare = 0.6;
/// Of what the best attempt explains of the surroundings, this share may be missed.
constexpr double kAroundShare = 0.25;
/// The reconstruction with an effect of the set-up may predict held-out photographs worse by this and no
/// more.
constexpr double kWorseHeld = 1.03;
/// A hint, ln odds; what counts as overwhelming, in units of what is needed; the held-out photographs' error
/// that a mere hint must reach.
constexpr double kHint = 3, kOverwhelming = 3, kHintedHeld = 0.85, kStrong = 2;
/// A change of less than this, natural-log units, is nobody's concern.
constexpr double kSmallestReach = 0.002;
/// Where a material is farther from the basis than this even with an effect, natural-log units, the
/// photographs' probability says little about the set-up.
constexpr double kFarGrain = 0.3, kFarFine = 0.7, kFarBroad = 1.5;
/// A second effect must make held-out photographs better by this: the first one's leftovers look like
/// effects.
constexpr double kFurtherHeld = 0.93;
/// ln of the odds that held-out photographs must gain, and that surroundings may lose.
constexpr double kHeldGain = 2, kSpeaksAgainst = 5;
/// Without a word from the surroundings, an effect of the set-up must take this off the error.
constexpr double kBetter = 0.95;

/// A free-form correction must take this off the held-out photographs' error, and make this share of them
/// better.
constexpr double kFreeHeld = 0.8, kFreeBetter = 0.7;

/// Held-out photographs are plainly better: their error falls to this, that of this share of them at all.
constexpr double kPlainly = 0.8, kPlainlyShare = 0.5;
/// The whole reconstruction must gain this with a term of the surface and with an effect of the set-up; where
/// the surroundings have spoken it must not lose more than the last.
constexpr double kWholeSurface = 0.88, kWholeFree = 0.6, kWholeSetUp = 0.97, kWholeAround = 1.1;
/// A lobe that takes this off the fitted photographs' error of the whole reconstruction need not help others.
constexpr double kWholeLobeFit = 0.5;
/// Most that is claimed, and that of the answer that what is missing has no name.
constexpr double kMostConfidence = 0.98, kFreeConfidence = 0.6;
/// ln of the odds at which the surroundings have spoken.
constexpr double kAroundSpeaks = 15;

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

bool isOwnShot(const std::string& id) {
  return id == "exposure-mismatch" || id == "light-power";
}

}  // namespace

TwoShotEvidence evidenceOf(const TwoShotCandidate& candidate, const Attempt& attempt,
                           const SurfaceTrial::Errors& without, const std::vector<DiagnosisShot>& shots) {
  TwoShotEvidence e;
  const TrialOutcome& o = attempt.outcome;
  e.id = candidate.id, e.variant = candidate.variant;
  e.free = candidate.free, e.heldOnly = candidate.heldOnly;
  e.surface = candidate.surface, e.lobe = attempt.surface, e.ownShot = isOwnShot(candidate.id);
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
  if (e.lobe && e.free) {
    out.passes = e.held && e.heldRatio <= kFreeHeld && e.heldBetter >= kFreeBetter;
    out.gain = -60 * std::log(std::max(e.heldRatio, 1e-3));
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
  if (e.lobe) {
    // Held-out photographs that don't look where the lobe is can only refuse it.
    const double heldMost = e.heldSees ? kSurfaceHeld : kUnseenHeld, share = e.heldSees ? kSurfaceShare : 0;
    out.passes = e.held ? e.fitRatio <= kSurfaceFit && e.heldRatio <= heldMost && e.heldBetter >= share
                        : e.fitRatio <= kSurfaceFitAlone;
    // What the surroundings show is the set-up's: that comes first.
    out.passes &= by.around <= kAroundSpeaks;
    // Errors of some hundred rows that are alike within a few dozen groups.
    constexpr double kWorth = 60;
    out.gain = -kWorth * (std::log(std::max(e.fitRatio, 1e-3)) + std::log(std::max(e.heldRatio, 1e-3)));
    const char* vain = out.passes ? "" : ": the basis does as well without it";
    if (e.held) {
      std::snprintf(text, sizeof text,
                    "with it the fitted photographs' error would be %.2f times, the held-out ones' %.2f "
                    "times what it is%s",
                    e.fitRatio, e.heldRatio, vain);
    } else {
      std::snprintf(text, sizeof text, "with it the photographs' error would be %.2f times what it is%s",
                    e.fitRatio, vain);
    }
    out.text = text;
    return out;
  }
  if (!e.refined) {
    out.gain = std::min(e.lnEvidence, 0.0);
    out.text = "the photographs are no more probable with it than without";
    return out;
  }
  const double needed =
      std::log(static_cast<double>(by.tried) / std::max(by.falseAlarmRate, 1e-6)) + kModelDoubt;
  // Twice the evidence that is needed, and pictures that agree: no isotropic material moves a highlight,
  // however far from the basis it is.
  const bool strong = !e.surface && e.held && e.lnEvidence > kStrong * needed && e.heldRatio < kHintedHeld &&
                      e.heldBetter >= kPlainlyShare;
  const bool plainlyBetter = strong || (e.held && e.heldRatio < kPlainly && e.heldBetter >= kPlainlyShare);
  out.gain = e.lnEvidence + (plainlyBetter ? std::max(e.lnHeld, 0.0) : e.lnHeld);
  const bool around = e.lnAround > needed;
  if (e.heldOnly) {
    // Where nothing lies around to confirm it, it is what is left when nothing else explains the photograph.
    const bool confirmed = e.lnAround > kAroundSpeaks;
    out.gain = confirmed ? e.lnHeld + e.lnAround : std::min(e.lnHeld, needed);
    out.passes = e.lnHeld + e.lnAround > (confirmed ? 1 : kOverwhelming) * needed &&
                 e.lnAround > -kSpeaksAgainst && e.heldRatio < kBetter && e.sensible;
    std::snprintf(text, sizeof text,
                  out.passes ? "the held-out photographs are e^%.0f times as probable with it"
                             : "the evidence for it in the held-out photographs, e^%.1f, is too little",
                  out.gain);
    out.text = text;
    return out;
  }
  // The held-out photographs must gain by themselves, or at least not lose where the surroundings have
  // spoken; and the surroundings must not speak against it.
  // (What a highlight's flank does in the process' tight bounds is one thing, plainly better pictures
  // another.)
  const bool heldAgree =
      e.lnAround > -kSpeaksAgainst && (!e.held || e.ownShot || e.lnHeld > kHeldGain || plainlyBetter ||
                                       (around && e.lnHeld > -0.05 * std::max(e.lnEvidence, 0.0)));
  // Colours that mix in the camera are colours of the material to a fit: only what lies around the sample
  // can tell.
  const bool tellable = around || (e.id != "channel-crosstalk" && e.id != "camera-response");
  const bool notWorse = e.ownShot || e.heldRatio <= kWorseHeld;
  const bool helps = around || (e.held && !e.ownShot ? e.heldRatio < kBetter : e.fitRatio < kBetter);
  // The fitted photographs must say so by themselves: an extrapolation that happens to fit is none. Where
  // they hint at it only, what they hint at must make the held-out ones overwhelmingly more probable.
  const bool seen =
      e.lnEvidence > needed - kModelDoubt / 2 ||
      (e.lnEvidence > kHint && e.held && e.lnHeld > kOverwhelming * needed && e.heldRatio < kHintedHeld);
  const bool far = !around && !strong && (e.grain > kFarGrain || e.fine > kFarFine || e.broad > kFarBroad);
  const bool further = by.round == 0 || around || e.heldRatio < kFurtherHeld;
  out.passes = out.gain > needed && heldAgree && tellable && notWorse && helps && e.reach > kSmallestReach &&
               e.sensible && !far && further && seen;
  // The surroundings know nothing of the material: what explains the photographs must explain them too.
  const bool misses = by.around > kAroundSpeaks && e.lnAround < (1 - kAroundShare) * by.around - 10;
  out.passes &= !misses;
  if (e.surface)
    out.passes &= e.held && e.heldRatio < 0.9 && e.fitRatio < 0.95 && e.heldBetter >= kSurfaceShare;
  if (out.passes) {
    std::snprintf(text, sizeof text, "the photographs are e^%.0f times as probable with it", out.gain);
  } else if (out.gain <= needed || !seen) {
    std::snprintf(text, sizeof text,
                  "the evidence for it, e^%.1f, is less than the e^%.1f that chance may give",
                  std::min(out.gain, e.lnEvidence), needed);
  } else if (misses) {
    std::snprintf(text, sizeof text,
                  "it doesn't explain what lies around the sample, which is lit and photographed like it");
  } else if (!heldAgree) {
    std::snprintf(text, sizeof text,
                  "it explains the fitted photographs, but the held-out ones speak against it");
  } else if (!e.sensible) {
    std::snprintf(text, sizeof text,
                  "what would explain the photographs best is no strength that makes sense");
  } else if (far) {
    std::snprintf(text, sizeof text, "the material is too far from the basis for these photographs to tell");
  } else if (!tellable) {
    std::snprintf(text, sizeof text, "a material of another colour or contrast would look the same");
  } else {
    std::snprintf(text, sizeof text,
                  "it would not make the reconstruction predict better (%.2f times the error of held-out "
                  "photographs)",
                  e.heldRatio);
  }
  out.text = text;
  return out;
}

double confidenceOf(const TwoShotEvidence& e, double margin) {
  // That the material is unlike the basis is sure; that nothing with a name is behind it is not.
  return std::clamp(1 - 0.5 * std::exp(-margin / 25), 0.5, e.free ? kFreeConfidence : kMostConfidence);
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
