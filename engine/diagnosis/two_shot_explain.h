#pragma once

#include <vector>

#include "engine/diagnosis/explanation.h"
#include "engine/diagnosis/two_shot_judge.h"
#include "engine/twoshot/basis.h"

namespace patina {

/// What each round of a search weighed, for those who measure how often its decisions are right.
using TwoShotRounds = std::vector<std::vector<TwoShotEvidence>>;

/// `explainTwoShot` with a basis of one's own instead of the built-in one: a user's, or, in tests, one that
/// doesn't hold the sample's material. `rounds`: filled where it is given.
Result<ExplanationPtr> explainTwoShotWith(const BasisPtr& basis,
                                          const std::vector<std::filesystem::path>& bundles,
                                          const ExplainOptions& options, const JobContext& job,
                                          TwoShotRounds* rounds = nullptr);

}  // namespace patina
