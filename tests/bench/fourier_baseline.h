#pragma once

#include "engine/fourier/solver.h"

namespace patina::bench {

/// What the baseline found of one site.
struct BaselineSolution {
  LobeParameters lobe;
  double diffuse[3] = {0, 0, 0}, specular[3] = {0, 0, 0};
  double cost = 0;  ///< as SiteSolution::cost: sum of squared weighted residuals and priors
  int iterations = 0;
  bool converged = false;
};

/// The fit of one site as one writes it with a general solver: ten parameters, the model once in a templated
/// functor, derivatives by automatic differentiation, Levenberg-Marquardt of Ceres with a dense QR, albedos
/// bounded below by zero. Model, measurements, weights and priors are those of `solveSites`
/// (LobeMapping::ExactMoments); `start` the lobe to begin with, the albedos begin at App. D's guess of an
/// even split. Double precision, one thread. What the solver's speed is measured against; not part of the
/// program.
BaselineSolution solveWithCeres(const SolverSetup& setup, const SiteData& site, const LobeParameters& start);

/// The baseline's cost of what `solveSites` found: the same figure as `solution.cost` where both have the
/// same model.
double baselineCost(const SolverSetup& setup, const SiteData& site, const SiteSolution& solution);

/// As `modelColumns` of one site, in double precision with automatic derivatives: of the quadrature as it is,
/// where the solver integrates the derivatives with the same nodes.
void baselineColumns(const SolverSetup& setup, const SiteData& site, const LobeParameters& at, double* out);

}  // namespace patina::bench
