#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "screen-pose",
    .stage = EffectStage::Geometry,
    .kinds = kFourierKind,
    .title = "The screen is not where calibration says",
    .sentence =
        "The screen is shifted or tilted against its calibrated place, so that every normal comes out bent.",
    .signature = "Normals that all need a common tilt or curl, and blurs that don't fit the distance.",
    .remedy = "Photograph a flat mirror in the sample's place, or the same sample at a second place.",
    .source = "Sturm, Bonfort (2006), How to compute the pose of an object without a direct view?",
    .parameters = {{"tiltDeg", "degrees", 0, 30, 1, "angle between the screen and where it should be"},
                   {"shiftMm", "mm", -200, 200, 4, "shift along the screen's normal"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
