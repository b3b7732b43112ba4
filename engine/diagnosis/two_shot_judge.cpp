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
/// The reconstruction with an effect of the set-up may predict held-out photographs worse by this and no
/// more.
constexpr double kWorseHeld = 1.03;
/// A change of less than this, natural-log units, is nobody's concern.
constexpr double kSmallestReach = 0.002;
/// Where a material is farther from the basis than this even with an effect, natural-log units, the
/// photographs' probability says little about the set-up.
constexpr double kFarGrain = 0.3, kFarFine = 0.7, kFarBroad = 1.0;
/// A second effect must make held-out photographs better by this: the first one's leftovers look like
/// effects.
constexpr double kFurtherHeld = 0.93;
/// ln of the odds that held-out photographs must gain, and that surroundings may lose.
constexpr double kHeldGain = 2, kSpeaksAgainst = 5;
/// Without a word from the surroundings, an effect of the set-up must take this off the error.
constexpr double kBetter = 0.95;

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

bool farFromBasis(const BasisDeviation& basis) {
  const BasisDeviation::Part& part = basis.brightness;
  return part.grain > kFarGrain || part.fine > kFarFine || part.broad > kFarBroad;
}

}  // namespace

void judgeAttempt(const TwoShotCandidate& candidate, const JudgedBy& by, Attempt& attempt) {
  const SurfaceTrial::Errors& without = *by.without;
  const bool held = without.held > 0;
  if (attempt.errors.fit >= 0 && without.fit > 0) {
    attempt.fitRatio = attempt.errors.fit / without.fit;
    attempt.heldRatio = heldRatio(attempt.errors, without, *by.shots);
  }
  char text[300];
  if (attempt.surface) {
    attempt.passes = held ? attempt.fitRatio <= kSurfaceFit && attempt.heldRatio <= kSurfaceHeld
                          : attempt.fitRatio <= kSurfaceFitAlone;
    // Errors of some hundred rows that are alike within a few dozen groups.
    constexpr double kWorth = 60;
    attempt.gain =
        -kWorth * (std::log(std::max(attempt.fitRatio, 1e-3)) + std::log(std::max(attempt.heldRatio, 1e-3)));
    const char* vain = attempt.passes ? "" : ": the basis does as well without it";
    if (held) {
      std::snprintf(text, sizeof text,
                    "with it the fitted photographs' error would be %.2f times, the held-out ones' %.2f "
                    "times what it "
                    "is%s",
                    attempt.fitRatio, attempt.heldRatio, vain);
    } else {
      std::snprintf(text, sizeof text, "with it the photographs' error would be %.2f times what it is%s",
                    attempt.fitRatio, vain);
    }
    attempt.verdict = text;
    return;
  }
  const TrialOutcome& o = attempt.outcome;
  if (attempt.errors.fit < 0) {
    attempt.gain = std::min(o.lnEvidence, 0.0);
    attempt.verdict = "the photographs are no more probable with it than without";
    return;
  }
  attempt.gain = o.lnTotal();
  const double needed =
      std::log(static_cast<double>(by.tried) / std::max(by.falseAlarmRate, 1e-6)) + kModelDoubt;
  const bool around = o.lnAround > needed;
  // The held-out photographs must gain by themselves, or at least not lose where the surroundings have
  // spoken; and the surroundings must not speak against it.
  const bool heldAgree =
      o.lnAround > -kSpeaksAgainst && (!held || isOwnShot(candidate.id) || o.lnHeld > kHeldGain ||
                                       (around && o.lnHeld > -0.05 * std::max(o.lnEvidence, 0.0)));
  // Colours that mix in the camera are colours of the material to a fit: only what lies around the sample
  // can tell.
  const bool tellable = around || (candidate.id != "channel-crosstalk" && candidate.id != "camera-response");
  const bool notWorse = isOwnShot(candidate.id) || attempt.heldRatio <= kWorseHeld;
  const bool helps =
      around || (held && !isOwnShot(candidate.id) ? attempt.heldRatio < kBetter : attempt.fitRatio < kBetter);
  // The fitted photographs must say so by themselves: an extrapolation that happens to fit is none.
  const bool seen = o.lnEvidence > needed - kModelDoubt / 2;
  attempt.passes =
      attempt.gain > needed && heldAgree && tellable && notWorse && helps && o.reach > kSmallestReach;
  const bool sensible =
      o.value.cwiseAbs().maxCoeff() >= candidate.least && !(candidate.positive && o.value[0] < 0);
  const bool far = farFromBasis(o.basis) && !around;
  const bool further = by.round == 0 || around || attempt.heldRatio < kFurtherHeld;
  attempt.passes &= sensible && !far && further && seen;
  if (candidate.surface) attempt.passes &= held && attempt.heldRatio < 0.9 && attempt.fitRatio < 0.95;
  if (attempt.passes) {
    std::snprintf(text, sizeof text, "the photographs are e^%.0f times as probable with it", attempt.gain);
  } else if (attempt.gain <= needed || !seen) {
    std::snprintf(text, sizeof text,
                  "the evidence for it, e^%.1f, is less than the e^%.1f that chance may give",
                  std::min(attempt.gain, o.lnEvidence), needed);
  } else if (!heldAgree) {
    std::snprintf(text, sizeof text,
                  "it explains the fitted photographs, but the held-out ones speak against it");
  } else if (!sensible) {
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
                  attempt.heldRatio);
  }
  attempt.verdict = text;
}

}  // namespace patina
