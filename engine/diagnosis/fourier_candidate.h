#pragma once

#include <optional>
#include <string>

#include "engine/diagnosis/fourier_refit.h"

namespace patina {

/// An effect that is being tried: what the score test says, and what a refit with it did.
struct FourierCandidate {
  std::string id;
  ScoreResult score;
  double phi = 1, correctedP = 1;
  bool tried = false, plausible = true;
  double improvement = 0;  ///< fall of chi2, fitted and held out, minus what its numbers cost
  double heldGain = 0, heldSd = 0;
  double betterPatches = 0;  ///< share of the patches whose held-out photographs it predicts better
  double heldRms = -1;
  double explained = 0;  ///< share of the residual above noise
  double noiseGain = 0;  ///< fall of chi2, fitted and held out, with noise alone as the unit
  std::optional<DiagnosisSession> session;
  RefitResult refit;
};

/// Probability that a chi-square variable of n degrees of freedom exceeds x (Wilson and Hilferty 1931).
double chiSquareTail(double x, double n);
/// Standard deviations that a gain of chi-square with n numbers stands for; large values by the asymptotic
/// form.
double sigmasOf(double gain, double n);

/// Fills in what the candidate's refit did to `before`. `refitted`: the session that it left; `heldRows`:
/// held-out photographs, of which factors and offsets take a number each.
void judgeRefit(FourierCandidate& candidate, const SessionError& before, const DiagnosisSession& refitted,
                double heldRows);
/// That this is the right answer, from the lead over the second best: its share of the improvement, and in
/// units of noise. Source: docs/explain.md.
double confidenceOf(const FourierCandidate& best, double secondShare);

/// For the log.
std::string scoreText(const FourierCandidate& candidate);
std::string refitText(const FourierCandidate& candidate, const SessionError& before);

}  // namespace patina
