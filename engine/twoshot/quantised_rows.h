#pragma once

#include <cstddef>
#include <cstdint>

namespace patina {

// The inner loops over a basis' 16-bit components, in the machine's widest vectors.

/// to[i] = from[i], `count` of them. Two bytes read and four written each.
void decodeComponents(const std::int16_t* from, std::size_t count, float* to);
/// sum[i] += weight * row[i], `count` of them.
void addComponents(float weight, const std::int16_t* row, std::size_t count, float* sum);
/// The sum of weights[i] * row[i]^2.
float weightedSquares(const float* row, const float* weights, std::size_t count);

}  // namespace patina
