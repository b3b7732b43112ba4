#pragma once

#include <cstddef>

namespace patina {

/// Sums of (a[i] - b[i])^2 by channel, i modulo 3 being the channel. Thread-safe, in SIMD lanes.
void squaredGaps(const float* a, const float* b, std::size_t count, float (&out)[3]);

/// to[i] += weight * from[i]. Thread-safe, in SIMD lanes.
void addScaled(float weight, const float* from, std::size_t count, float* to);

}  // namespace patina
