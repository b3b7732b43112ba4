#pragma once

#include <string>
#include <vector>

#include "devices/simulated/two_shot_rig.h"

namespace patina {

/// Names of the samples that the simulated near-field rig has at hand: built-in materials on a disc, or two
/// of them on a sheet under one camera.
std::vector<std::string> twoShotSceneNames();
/// One sentence for a person; empty for a name that is not there.
std::string twoShotSceneSummary(const std::string& name);
/// The scene with its poses: three shots to reconstruct from (the pair that tolerates aiming errors, and the
/// third that glossy samples want; for the sheet one camera and three lights) and two held out. Errors:
/// NotFound, the names are listed.
Result<TwoShotScene> twoShotScene(const std::string& name);

}  // namespace patina
