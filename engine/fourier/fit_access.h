#pragma once

#include "engine/fourier/fit.h"
#include "engine/fourier/fit_state.h"

namespace patina {

/// What a fit was made of: measurements with their even sums, each site's solution, geometry and the diffuse
/// term's table. `fit` comes from `fitFourier` or `loadFourierFit`; anything else throws
/// std::invalid_argument. Lives as long as the fit and doesn't change. Where the capture has held-out
/// photographs and the fit wasn't cancelled, `measurements.heldOut` has them; like the fitted ones they are
/// in memory as far as the fit's limit allows, and `block()` reads either. A fit brought back by
/// `loadFourierFit` has no standard deviations.
const FourierFitState& fitState(const FourierFit& fit);

}  // namespace patina
