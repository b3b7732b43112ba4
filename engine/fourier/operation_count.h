#pragma once

#include "engine/fourier/solver.h"

namespace patina {

/// Additions and multiplications (a multiply-add counts two) that one evaluation of a site takes in
/// `solveSites`: model, derivatives, albedos, residuals, Gauss-Newton matrix, step. The lobe's moments are
/// counted by running their text on numbers that count; the loops over frequencies by hand, of which the
/// lobe is there at `litShare` (elsewhere it has decayed and is left out). Comparisons, selections, changes
/// of sign, estimates of inverses, conversions and memory are not counted. For the benchmark: time against
/// the machine's rate.
double solverOperations(const SolverSetup& setup, double litShare = 1);

}  // namespace patina
