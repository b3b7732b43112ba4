#pragma once

#include <string>
#include <vector>

#include "devices/simulated/two_shot_rig.h"
#include "engine/base/result.h"

namespace patina::test {

/// A simulated two-shot capture drawn at random: material, directions, noise, surroundings, tile, and effects
/// or none.
struct TwoShotDraw {
  TwoShotScene scene;
  TwoShotScene clean;  ///< the same without the effects
  std::vector<std::string> effects;
  std::string material;
  /// Where the material comes from: "basis" (the built-in basis holds it), "left out" (it is taken out of the
  /// basis), "rgl" (measured, not of the basis), "npf" (another model fitted to a material of the basis),
  /// "analytic" (a microfacet model with drawn parameters).
  std::string family;
  int leftOut = -1;  ///< index of the material in the built-in basis, to be left out of it
};

/// The draw of a seed: everything but the effects depends on the seed alone. Measured materials and the
/// non-parametric fits come from the shared test data; where they are not there, materials left out of the
/// basis take their place. Effects that a photograph towards the light shows get one more photograph there.
/// `scale`: of the effects' strengths.
TwoShotDraw drawTwoShot(unsigned seed, const std::vector<std::string>& effects, double scale = 1);

/// The non-parametric factors (Bagher, Snyder, Nowrouzezahrai 2016) of one of the MERL materials: `index` in
/// the file's order. Errors: NotFound, Malformed.
Result<BrdfPtr> nonParametricBrdf(int index);

}  // namespace patina::test
