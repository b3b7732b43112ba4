#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "near-light",
    .stage = EffectStage::Light,
    .kinds = kTwoShotKind | kFlashKind,
    .title = "The light is nearer than it says",
    .sentence =
        "The light stands at another distance than the bundle says, so its brightness and direction change "
        "over the sample otherwise than expected.",
    .signature =
        "A smooth error over the picture that rises towards the light and is the same for every material.",
    .remedy = "Photograph a white matte sheet in the sample's place, or measure the light's distance.",
    .source = "Queau, Durix, Wu, Cremers, Lauze, Durou (2018), LED-based photometric stereo",
    .parameters = {{"distanceMm", "mm", 10, 10000, 500, "distance of the light from the sample's centre"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
