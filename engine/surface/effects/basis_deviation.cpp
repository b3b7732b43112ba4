#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "basis-deviation",
    .stage = EffectStage::Surface,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "The material reflects as none of the known ones",
    .sentence =
        "No mixture of the known materials and no named effect gives this reflection; a smooth free "
        "correction does.",
    .signature =
        "An error that follows the half-angle coordinates and stays when all named effects have been tried.",
    .remedy =
        "Measure the material in a gonioreflectometer and add it to the basis, or take photographs at more "
        "angles.",
    .source =
        "Nielsen, Jensen, Ramamoorthi (2015), On optimal, minimal BRDF sampling for reflectance acquisition",
    .parameters = {{"relativeChange", "", 0, 10, 0.2, "root mean square of the correction, relative"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
