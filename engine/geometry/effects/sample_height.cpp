#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "sample-height",
    .stage = EffectStage::Geometry,
    .kinds = kFourierKind,
    .title = "The sample is not flat",
    .sentence =
        "The sample's surface rises above or sinks below its plane, so that its points see the screen from "
        "elsewhere.",
    .signature =
        "Shifts of the reflection that follow a smooth surface, consistent with the slopes of the normals "
        "that were found.",
    .remedy = "Press the sample flat under a frame, or photograph it again turned by 90 degrees.",
    .source =
        "Frankot, Chellappa (1988), A method for enforcing integrability in shape from shading algorithms",
    .parameters = {{"heightMm", "mm", -50, 50, 1, "largest height of the surface over the sample's plane"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
