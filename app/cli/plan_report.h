#pragma once

#include <optional>
#include <string>

#include "app/cli/verbs.h"
#include "engine/twoshot/plan.h"

namespace patina::cli {

/// Prints the photographs of a plan as a table, and what they are expected to do in sentences.
void printPlan(const Plan& plan, Context& context);
/// "0.217 (24 %)": natural-log units and the relative error that they mean.
std::string lnAndPercent(double lnUnits);

/// What one more photograph would bring.
struct MorePhotographs {
  PlannedShot shot;
  Plan with;
};
/// Searches one photograph to add to a plan, quickly. Empty where it was cancelled.
std::optional<MorePhotographs> oneMore(const BasisPtr& basis, const Plan& plan, const JobContext& job);
/// Says what it would bring, and for which materials it is worth the trouble.
void printOneMore(const Plan& plan, const MorePhotographs& more, Context& context);

/// All the problems in one line, for Context::misuse; empty where there are none.
std::string problemsOf(const PlanOptions& options);

}  // namespace patina::cli
