#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "engine/flash/observations.h"

namespace patina {

using TexelVector = Eigen::Matrix<double, FlashTexel::kParameters, 1>;
using TexelMatrix = Eigen::Matrix<double, FlashTexel::kParameters, FlashTexel::kParameters>;

/// What texels of one material have in common.
struct FlashMaterial {
  FlashLobe lobe;
  TexelVector mean = TexelVector::Zero();
  TexelMatrix covariance = TexelMatrix::Identity();  ///< of texels about their mean
  /// What the model doesn't say about this material's pixels (sparkle, texture below the texel): standard
  /// deviation over value. Beside the sensor's noise in the weights.
  double discrepancy = 0.05;
};

/// Everything that texels share.
struct FlashModel {
  FlashRig rig;
  ToneCurve tone;  ///< of rig.toneLogSlope
  std::vector<FlashMaterial> materials;
};

/// A prior on one texel's parameters.
struct TexelPrior {
  TexelVector mean;
  TexelMatrix precision;
};

/// A photograph's view of a texel, predicted, with derivatives by the texel's parameters.
struct SeenPrediction {
  Eigen::Array3d value;       ///< as the photograph would say, before clipping
  Eigen::Array3d flashLight;  ///< light before the tone curve that came from the flash
  Eigen::Array3d light;       ///< all of it
  Eigen::Array3d slope;       ///< d value / d light
  double lobe = 0;            ///< flashLobeTimesCos
  double factor = 1;          ///< flashRigFactor
  Eigen::Matrix<double, 3, FlashTexel::kParameters> byTexel;
};
/// derivatives: also `byTexel`. Cost: about 0.1 us, 0.4 with derivatives.
SeenPrediction predictSeen(const FlashModel& model, int material, const FlashObservation& seen,
                           const TexelVector& x, bool derivatives);

/// How far a prediction is from what was seen, in standard deviations, and how much the robust cost counts
/// it. Clipped: nothing while the prediction is above.
struct Misfit {
  double residual = 0, perValue = 0, weight = 1, cost = 0;
};
/// sd: standard deviation of the observation. Student's t with ten degrees of freedom: sparkles and bad
/// pixels don't pull.
Misfit misfitOf(double predicted, double seen, double sd, bool clipped);
/// Standard deviation of one observation: sensor and what the model lacks, the latter relative to the mean of
/// seen and predicted (seen alone would count low values too much).
double scatterOf(const FlashObservation& seen, int channel, double predicted, double discrepancy);

struct TexelSolution {
  TexelVector x;
  TexelMatrix information;  ///< Gauss-Newton Hessian with the prior; its inverse is the covariance
  double cost = 0;
  int iterations = 0;
  bool converged = false, finite = true;
};
/// Fits one texel by Levenberg-Marquardt. use: by photograph; empty: all.
TexelSolution solveTexel(const FlashModel& model, const FlashSite& site, const TexelPrior& prior,
                         const TexelVector& start, int maxIterations, std::span<const char> use = {});
/// Starts worth trying: the prior's mean, and its normal turned to the half-vector of the brightest
/// photograph.
std::vector<TexelVector> startsOf(const FlashSite& site, const TexelPrior& prior);
/// A diffuse albedo (logarithm) that explains the darker half of what is seen.
Eigen::Array3d darkColour(const FlashSite& site);

}  // namespace patina
