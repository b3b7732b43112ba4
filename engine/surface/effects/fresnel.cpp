#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "fresnel",
    .stage = EffectStage::Surface,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "Reflection rises towards grazing otherwise than glass does",
    .sentence =
        "The mirror-like part of the light grows towards grazing angles faster or slower than Schlick's "
        "curve for common dielectrics.",
    .signature =
        "Specular albedos that depend on the angle of incidence over the sample, alike for every material.",
    .remedy = "Photograph the sample from a second, more grazing place.",
    .source = "Schlick (1994), An inexpensive BRDF model for physically-based rendering",
    .parameters = {{"power", "", 1, 12, 6.5, "exponent of the rise towards grazing; Schlick's is 5"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
