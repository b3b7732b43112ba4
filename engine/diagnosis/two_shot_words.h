#pragma once

#include <string>

#include "engine/capture/two_shot_capture.h"
#include "engine/diagnosis/explanation.h"
#include "engine/diagnosis/two_shot_search.h"

namespace patina {

/// The parameters of what was found, in units that a person reads.
std::vector<EffectEstimate> estimatesOf(const TwoShotCandidate& candidate, const Eigen::VectorXd& value,
                                        const Eigen::VectorXd& sd);
/// What was found, in a sentence with its numbers.
std::string sentenceOf(const std::string& id, const std::vector<EffectEstimate>& estimates);
/// Which photographs would tell two effects apart, a sentence; empty where none is known.
std::string decidingCapture(const std::string& a, const std::string& b);
/// How large a parameter could be without being seen. `sd`: its uncertainty at none of it; `absorbed`: what
/// of its effect the reconstruction takes up, natural log a unit.
BudgetLine budgetLine(const TwoShotCandidate& candidate, Eigen::Index parameter, double sd, double absorbed);
/// What helps where the basis itself is what lacks, as a remark.
void addBasisRemedy(Explanation& explanation);

}  // namespace patina
