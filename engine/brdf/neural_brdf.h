#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
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
/// et al. 2021 (weights: MIT licence); output exp(y) - 1, clamped at 0. `evaluateMany` works in single
/// precision on whole vectors. Errors: NotFound, Malformed (size, names, weights that are not finite or
/// beyond 10^4, which no fit has and from which a sum could overflow).
Result<std::vector<BrdfPtr>> readNeuralBrdfs(const std::filesystem::path& weightsFile,
                                             const std::filesystem::path& namesFile);

/// One network from its 675 weights. Throws std::invalid_argument for another count, and for weights that
/// are not finite or beyond 10^4.
BrdfPtr makeNeuralBrdf(std::span<const float> weights, std::string name);

/// The weights that ship inside the program, 100 x 675 float32 in this machine's byte order, and the names of
/// their materials (those of the MERL database). See resources/basis/README.md for origin and licence.
std::span<const std::byte> builtInNeuralWeights();
const std::vector<std::string>& builtInNeuralNames();
/// The networks themselves, made at the first call.
const std::vector<BrdfPtr>& builtInNeuralBrdfs();

/// The instruction set that `evaluateMany` of a network uses here, for reports: "AVX3" and the like.
const char* neuralBrdfTarget();

}  // namespace patina
