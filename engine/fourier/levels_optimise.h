#pragma once

#include <functional>
#include <span>
#include <vector>

#include "engine/fourier/levels_problem.h"

namespace patina {

/// The linear system of one Levenberg-Marquardt step: (H + C + damping) step = -gradient, H block-diagonal, C
/// the coupling. Albedos that sit at zero and would go below are held: their rows and columns are those of
/// the identity.
struct LevelSystem {
  using Vector = LevelProblem::Vector;
  using Block = LevelProblem::Block;
  const LevelProblem& problem;
  std::vector<Block> block;              ///< H and damping, without C; rows and columns of held unknowns zero
  std::vector<Vector> free;              ///< 1 or, for held unknowns, 0
  std::vector<Vector> negativeGradient;  ///< zero for held unknowns

  /// out = (H + C + damping) x for x that is zero at held unknowns.
  void apply(std::span<const Vector> x, std::span<Vector> out) const;
};

/// Solves the system, `step` starting at zero; false where the job was cancelled meanwhile.
using LevelLinearSolver =
    std::function<bool(const LevelSystem&, std::span<LevelProblem::Vector> step, const JobContext&)>;

/// Conjugate gradients with the diagonal blocks (C's included) inverted as preconditioner, to a residual of
/// 1e-2, at most 200 rounds. Deterministic: sums don't depend on the threads.
bool solveByConjugateGradients(const LevelSystem& system, std::span<LevelProblem::Vector> step,
                               const JobContext& job);

struct LevelOptions {
  int maxIterations = 12;
  double tolerance = 1e-3;  ///< relative decrease of the cost below which a level has converged
};

/// Levenberg-Marquardt on the coupled problem from `x`, which it replaces. Every texel has a damping of its
/// own and keeps its old values where the new ones are worse for it (its neighbours' new values given); the
/// whole is taken only where the whole's cost falls. Albedos stay non-negative, steps as short as
/// `solveSites` has them. Cancelled: the best so far.
LevelReport optimiseLevel(const LevelProblem& problem, const LevelOptions& options,
                          const LevelLinearSolver& solver, std::vector<LevelProblem::Vector>& x,
                          std::vector<LevelProblem::Local>& local, const JobContext& job);

}  // namespace patina
