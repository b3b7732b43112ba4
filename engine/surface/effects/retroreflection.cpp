#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "retroreflection",
    .stage = EffectStage::Surface,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "Light is sent back to where it came from",
    .sentence =
        "The material returns light towards its source, as safety tape, road signs and some paints do.",
    .signature = "A highlight around the light's own direction where a mirror would have none.",
    .remedy = "Take a photograph with the light close beside the camera.",
    .source =
        "Belcour, Pacanowski, Delahaie, Laville-Geay, Eupherte (2014), BRDF measurements and analysis of "
        "retroreflective materials",
    .parameters = {{"strength", "1/sr", 0, 1000, 1, "the BRDF in the direction of the light"},
                   {"widthDeg", "degrees", 0.1, 45, 5, "standard deviation of the returned beam"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
