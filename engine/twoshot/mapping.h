#pragma once

#include <cmath>

#include "engine/brdf/half_diff.h"

namespace patina {

/// Keeps the logarithm away from black, in units of the weighted BRDF, 1/sr. Source: two-shot paper,
/// section 3.
inline constexpr double kMappingEpsilon = 0.001;

/// The paper's weight: the larger cosine of light and view, (0, 1].
inline double mappingWeight(double cosLight, double cosView) {
  return cosLight > cosView ? cosLight : cosView;
}
double mappingWeight(const HalfDiffAngles& angles);

/// ln((f w + eps) / (f_ref w + eps)), given `lnReference` = ln(f_ref w + eps). Natural-log units.
/// Source: two-shot paper, section 3 (after Nielsen et al. 2015).
inline double mapBrdf(double brdf, double weight, double lnReference) {
  return std::log(brdf * weight + kMappingEpsilon) - lnReference;
}
/// The inverse, 1/sr. Not below 0: the mapped value of black is the smallest that means anything.
inline double unmapBrdf(double mapped, double weight, double lnReference) {
  const double brdf = (std::exp(mapped + lnReference) - kMappingEpsilon) / weight;
  return brdf > 0 ? brdf : 0;
}

}  // namespace patina
