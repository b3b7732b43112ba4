#pragma once

#include "engine/diagnosis/explanation.h"
#include "engine/twoshot/basis.h"

namespace patina {

/// `explainTwoShot` with a basis of one's own instead of the built-in one: a user's, or, in tests, one that
/// doesn't hold the sample's material.
Result<ExplanationPtr> explainTwoShotWith(const BasisPtr& basis,
                                          const std::vector<std::filesystem::path>& bundles,
                                          const ExplainOptions& options, const JobContext& job);

}  // namespace patina
