#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "screen-response",
    .stage = EffectStage::Screen,
    .kinds = kFourierKind,
    .title = "The screen's grey levels are not linear",
    .sentence =
        "The screen answers to a grey level with a power of it instead of in proportion, so a sine pattern "
        "is no longer a sine.",
    .signature =
        "Light at twice and three times a pattern's frequency, and sums of opposite phases that change with "
        "the pattern.",
    .remedy = "Calibrate the screen's response with a photograph of a ladder of greys.",
    .source = "Brainard, Pelli, Robson (2002), Display characterization",
    .parameters = {{"gamma", "", 0.5, 2, 1.05,
                    "exponent from the level that was asked for to the light that came; 1 is linear"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
