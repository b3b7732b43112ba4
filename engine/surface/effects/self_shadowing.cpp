#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "self-shadowing",
    .stage = EffectStage::Surface,
    .kinds = kFourierKind | kFlashKind,
    .title = "The surface's own bumps stand in the light",
    .sentence = "High places of the surface hide low parts of the screen or the light from their neighbours.",
    .signature = "Light from low over the horizon is missing, most of all in pits and beside steps.",
    .remedy = "Raise the light, or move the screen closer to above the sample.",
    .source = "Max (1988), Horizon mapping: shadows for bump-mapped surfaces",
    .parameters = {{"horizonDeg", "degrees", 0, 90, 40, "height of the horizon that a typical point sees"},
                   {"share", "of the sample", 0, 1, 0.2, "share of the points that see a horizon"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
