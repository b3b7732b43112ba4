#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "emission-angular",
    .stage = EffectStage::Screen,
    .kinds = kFourierKind,
    .title = "The screen is dimmer or brighter at a slant than calibrated",
    .sentence =
        "The screen's brightness falls off with the angle of view differently from its calibration, so "
        "points see its far parts too bright or too dark.",
    .signature =
        "An error over the screen that is symmetric about the foot of each point of the sample and therefore "
        "moves along with the point.",
    .remedy = "Photograph a white matte paper under the same screen: it shows the fall-off outright.",
    .source = "Aittala, Weyrich, Lehtinen (2013), Practical SVBRDF capture in the frequency domain",
    .parameters = {{"edgeChange", "", -0.9, 2, 0.3,
                    "relative change of the emission towards the screen's most oblique corner, as seen from "
                    "the sample's centre"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
