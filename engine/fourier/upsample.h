#pragma once

#include <span>

#include "engine/base/job.h"
#include "engine/fourier/levels.h"

namespace patina {

struct FourierFitState;

/// A start for every site from a solved grid: lobe, albedos, and the outcome of the texel that the site lies
/// in. Costs are left at zero.
/// Source: frequency-domain paper, section 7.2. A site's measurements are explained by non-negative weights
/// on the 5 x 5 texels about it, with a soft constraint that the weights sum to one; its parameters are
/// combined with the same weights (albedos as they are, because Z is linear in them; log sigma, log(gamma -
/// 1) by weight times specular albedo; slopes by weight). Where the data can't choose, weights stay at those
/// of bilinear interpolation. `out` has one element a site. Cancelled: the rest of `out` stays as it was.
/// Progress stage: "upsample". Thread-safe; runs on the cores of the caller's TBB arena. Cost: about 2
/// microseconds a site and core.
void upsampleToSites(const FourierFitState& state, const LevelSolution& low, std::span<SiteSolution> out,
                     const JobContext& job);

/// The same from a solved level to the texels of a finer one; `out` has one element a texel, those without
/// sites stay as they were.
void upsampleToLevel(const FourierFitState& state, const LevelSolution& low, const LevelData& high,
                     std::span<SiteSolution> out, const JobContext& job);

}  // namespace patina
