#pragma once

#include <Eigen/Core>
#include <span>

#include "engine/brdf/half_diff.h"

namespace patina {

/// Shape of the networks: inputs, units of each of the two hidden layers, outputs; and where the parts of a
/// row of weights begin. Matrices are input-major: weight [input][unit].
struct NeuralShape {
  static constexpr int kInputs = 6, kHidden = 21, kOutputs = 3;
  static constexpr int kWeights0 = 0, kBias0 = kWeights0 + kInputs * kHidden;
  static constexpr int kWeights1 = kBias0 + kHidden, kBias1 = kWeights1 + kHidden * kHidden;
  static constexpr int kWeights2 = kBias1 + kHidden, kBias2 = kWeights2 + kHidden * kOutputs;
  static constexpr int kCount = kBias2 + kOutputs;
};

/// One network at many directions, single precision, directions in lanes: the mean over the four equivalent
/// phiD of max(exp(output) - 1, 0), NaN where light or view is below the surface. `weights` has
/// NeuralShape::kCount entries, all finite and within 10^4. Threading: one thread a call. Cost: about 2500
/// multiply-adds a direction.
void evaluateNetwork(std::span<const float> weights, std::span<const HalfDiffAngles> angles,
                     std::span<Eigen::Array3f> out);

/// The instruction set that it uses.
const char* networkTarget();

}  // namespace patina
