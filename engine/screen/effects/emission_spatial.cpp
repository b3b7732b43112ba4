#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "emission-spatial",
    .stage = EffectStage::Screen,
    .kinds = kFourierKind,
    .title = "The screen is unevenly bright",
    .sentence = "Parts of the screen are brighter than others: its backlight, or dirt on it.",
    .signature = "An error that stays at one place of the screen, whichever point of the sample looks at it.",
    .remedy =
        "Photograph a white matte paper under the same screen, or the screen itself through a grid of "
        "positions.",
    .source = "Brainard, Pelli, Robson (2002), Display characterization",
    .parameters = {{"edgeChange", "", -0.9, 2, 0.1,
                    "relative change of the emission from the screen's centre to its edge"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
