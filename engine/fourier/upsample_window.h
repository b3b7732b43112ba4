#pragma once

#include <cstddef>

namespace patina {

/// Texels of a 5 x 5 window, padded to whole SIMD vectors of any instruction set.
inline constexpr int kWindowTexels = 25, kWindowStride = 32;

/// Inner products of a window's columns: `window` is [dimension][kWindowStride], columns beyond kWindowTexels
/// zero; `gram` becomes [kWindowStride][kWindowStride]. SIMD, the instruction set chosen at run time.
void windowGram(const float* window, std::size_t dimensions, float* gram);

/// Inner products of a window's columns with one vector: out[kWindowStride].
void windowProject(const float* window, std::size_t dimensions, const float* vector, float* out);

/// Non-negative weights w that minimise w' G w - 2 b' w over the first kWindowTexels unknowns: Lawson and
/// Hanson's active sets, begun at the weights given in `weights` (>= 0). Only unknowns with a positive
/// diagonal take part. A new unknown enters only if it lowers the cost by more than `significant`.
/// Returns false where rounding stopped the search; the weights are then feasible, and no worse than at the
/// start.
bool nonNegativeWeights(const float* gram, const float* b, float significant, float* weights);

}  // namespace patina
