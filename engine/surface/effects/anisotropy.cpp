#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "anisotropy",
    .stage = EffectStage::Surface,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "Brushed or stretched highlights",
    .sentence =
        "Highlights are longer in one direction than across it, as on brushed metal, hair, silk and wood.",
    .signature =
        "An error that grows with the pattern's frequency and whose sign depends on the direction of its "
        "stripes.",
    .remedy = "Photograph the sample turned by 90 degrees as well: what belongs to it turns with it.",
    .source = "Ward (1992), Measuring and modeling anisotropic reflection",
    .parameters =
        {{"ratio", "", 1, 20, 1.3,
          "largest standard deviation of the surface's slope over the smallest; 1 is a round highlight"},
         {"angleDeg", "degrees", -90, 90, 45,
          "direction of the largest one, from the sample's +x towards +y"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
