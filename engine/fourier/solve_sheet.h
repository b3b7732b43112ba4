#pragma once

#include <span>

#include "engine/base/job.h"
#include "engine/fourier/solver.h"
#include "engine/surface/svbrdf_parameters.h"

namespace patina {

struct FourierFitState;

/// What the solver needs to know of a fit: frame, frequencies, priors (App. E; departures in
/// docs/fourier_fit.md), limits.
SolverSetup solverSetup(const FourierFitState& state);

/// Solves every site of `state.measurements` and fills `sites`, `siteStatus`, `siteResidual` and the counts
/// in `stats`. `start`: solutions to begin with, one a site, instead of the coarse levels (schedule
/// Independent only); must not be `state.sites`. Progress stages: "levels", "upsample", "solve", "rescue".
/// Cancelled: what was solved so far is kept, the rest marked.
void solveSheet(FourierFitState& state, const JobContext& job, std::span<const SvbrdfParameters> start = {});

}  // namespace patina
