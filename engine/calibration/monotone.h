#pragma once

#include <vector>

namespace patina {

/// The never-falling sequence nearest to `values` in the weighted mean square (pool adjacent violators).
std::vector<double> isotonic(const std::vector<double>& values, const std::vector<double>& weights);

/// Piecewise cubic through never-falling samples, itself never falling (Fritsch and Carlson 1980); the ends'
/// values beyond them. `x` strictly rising.
double monotoneCubic(const std::vector<double>& x, const std::vector<double>& y, double at);

}  // namespace patina
