#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "sheen",
    .stage = EffectStage::Surface,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "A glow towards grazing, as of cloth",
    .sentence = "Fibres send light back at grazing angles, as velvet, felt and dust do.",
    .signature =
        "A broad rise of light from the rim of the screen or at grazing directions, without a highlight.",
    .remedy = "Photograph the sample with the light at a grazing angle.",
    .source = "Estevez, Kulla (2017), Production friendly microfacet sheen BRDF",
    .parameters = {{"strength", "", 0, 30, 1, "weight of the fibre lobe, 1 for a white cloth"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
