#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/diagnosis/two_shot_judge.h"

namespace patina {

/// What an attempt's evidence comes to, as numbers that a weighted sum turns into ln odds against "nothing is
/// missing". Odds of hundreds are compressed to their logarithm: what a process says of thousands of
/// correlated rows is right in its sign and order, not in its size.
inline constexpr int kEvidenceFeatures = 14;
using EvidenceFeatures = Eigen::Matrix<double, kEvidenceFeatures, 1>;

/// `around`: the most that any attempt of the round explains of the surroundings, ln odds.
EvidenceFeatures featuresOf(const TwoShotEvidence& evidence, double around);

/// The weights: a conditional logit over captures drawn at random, fitted by `fitEvidenceWeights`
/// (patina-two-shot-rates --weigh prints them).
const EvidenceFeatures& evidenceWeights();
/// What is expected of them before any capture was seen: every kind of evidence counts for an answer.
EvidenceFeatures evidenceWeightsBefore();

/// ln odds of an attempt against "nothing is missing".
double lnOddsOf(const TwoShotEvidence& evidence, double around);

/// Probability of each of several answers with these ln odds, "nothing" (ln odds 0) being the other one.
std::vector<double> probabilitiesOf(const std::vector<double>& lnOdds);

/// One capture whose truth is known: the features of what was tried, and which of it is right. None right:
/// "nothing" is.
struct WeighedCapture {
  std::vector<EvidenceFeatures> tried;
  std::vector<char> right;
};
/// The weights that make the truth most probable: P(answer) = exp(w x) / (1 + sum exp(w x)), with a normal
/// prior of mean `before` and standard deviation `priorSd` on each. By Newton steps. Cost: captures x
/// attempts x features^2 a step.
EvidenceFeatures fitEvidenceWeights(const std::vector<WeighedCapture>& captures,
                                    const EvidenceFeatures& before, double priorSd);

}  // namespace patina
