#pragma once

#include "engine/fourier/options.h"
#include "engine/fourier/site_geometry.h"
#include "engine/surface/svbrdf_parameters.h"

namespace patina {

/// `frame.logEmission` (there must be one) as a site's lobe sees it: the second-order polynomial that is
/// nearest to it in the mean square over the lobe times window, found at 3 x 3 Gauss-Hermite nodes about the
/// lobe's mean, kept on the lit area. For a sharp lobe that is the Taylor expansion; for a broad one it stays
/// close over the whole lobe. The paper's mapping has no mixed term: what it does where the lobe lies askew
/// is then shared between the others. `site` is the geometry without it. Cost: nine calls of logEmission and
/// 4 us.
EmissionExpansion expandEmission(const ScreenFrame& frame, const SiteGeometry& site,
                                 const SvbrdfParameters& parameters,
                                 LobeMapping mapping = LobeMapping::ExactMoments);

}  // namespace patina
