#pragma once

#include "engine/diagnosis/explanation.h"
#include "engine/twoshot/fit.h"

namespace patina {

/// Fills in what one sees of the residual, before and after: photographs, breakdowns, places, pictures, RMS,
/// what stays unexplained.
void describeResiduals(const TwoShotFit& before, const TwoShotFit& after, bool pictures,
                       Explanation* explanation);

}  // namespace patina
