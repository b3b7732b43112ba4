#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "camera-response",
    .stage = EffectStage::Sensor,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "The camera does not answer in proportion to light",
    .sentence =
        "The camera's values are not proportional to light: a tone curve, a gamma, or highlights that are "
        "compressed.",
    .signature =
        "Sums of opposite phases that should cancel and don't, and errors that follow the pixel's own "
        "brightness.",
    .remedy = "Save raw files, or take the same scene with two exposures.",
    .source =
        "Debevec, Malik (1997); Grossberg, Nayar (2004), Modeling the space of camera response functions",
    .parameters = {{"gamma", "", 0.3, 3, 0.95, "exponent from light to value; 1 is linear"},
                   {"compression", "", 0, 1, 0.05, "share by which the brightest values are lowered"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
