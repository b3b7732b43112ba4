#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/result.h"
#include "engine/brdf/brdf.h"

namespace patina {

/// Weights of one small network: 6 inputs, two hidden layers of 21, RGB out; row-major, input-major.
inline constexpr int kNeuralBrdfWeights = 675;

/// The networks of a file: `count` x 675 float32, little-endian, names one a line in `namesFile`. Each is
/// averaged over the four equivalent phiD, which makes it reciprocal and mirror-symmetric. Source: Sztrajman
/// et al. 2021 (weights: MIT licence); output exp(y) - 1, clamped at 0. Errors: NotFound, Malformed (size,
/// names, non-finite weights).
Result<std::vector<BrdfPtr>> readNeuralBrdfs(const std::filesystem::path& weightsFile,
                                             const std::filesystem::path& namesFile);

/// One network from its 675 weights. Throws std::invalid_argument for another count.
BrdfPtr makeNeuralBrdf(std::span<const float> weights, std::string name);

}  // namespace patina
