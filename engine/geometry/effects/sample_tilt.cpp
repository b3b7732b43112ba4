#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "sample-tilt",
    .stage = EffectStage::Geometry,
    .kinds = kTwoShotKind | kFlashKind,
    .title = "The sample is tilted",
    .sentence =
        "The sample lies at an angle to the plane that the bundle declares, so that highlights appear at "
        "another place.",
    .signature = "Highlights that are all displaced in one direction, by the same angle in every photograph.",
    .remedy = "Lay the sample flat against the reference plane, or mark its corners and declare its pose.",
    .source = "this program",
    .parameters = {{"tiltDeg", "degrees", 0, 45, 1.5,
                    "angle between the sample's plane and the declared one"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
