#pragma once

#include <string>
#include <vector>

#include "engine/diagnosis/two_shot_search.h"
#include "engine/diagnosis/two_shot_surface.h"

namespace patina {

/// One effect that was tried, and what came of it.
struct Attempt {
  std::size_t candidate = 0;
  TrialOutcome outcome;         ///< of the Gaussian process; effects of the set-up
  SurfaceTrial::Errors errors;  ///< of the reconstruction with it
  Eigen::VectorXd value;
  TwoShotDeviation deviation;
  double fitRatio = 1, heldRatio = 1;
  double gain = 0;  ///< ln odds, for a surface term those that the errors are worth
  bool surface = false, passes = false;
  std::string verdict;
};

/// What all attempts of a round are judged by.
struct JudgedBy {
  std::size_t tried = 1;
  double falseAlarmRate = 0.01;
  int round = 0;
  const SurfaceTrial::Errors* without = nullptr;
  const std::vector<DiagnosisShot>* shots = nullptr;
};

/// Decides whether an attempt may be added, fills in its ratios, gain and verdict.
void judgeAttempt(const TwoShotCandidate& candidate, const JudgedBy& by, Attempt& attempt);

}  // namespace patina
