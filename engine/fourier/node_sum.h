#pragma once

#include <cstddef>

namespace patina {

/// out[i] = sum over n < nodes of weight[n] * table[n * stride + i], i < stride; in SIMD lanes of the
/// machine's best instruction set. Thread-safe.
void weightedNodeSum(const float* table, const float* weight, std::size_t nodes, std::size_t stride,
                     float* out);

}  // namespace patina
