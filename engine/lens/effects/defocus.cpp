#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "defocus",
    .stage = EffectStage::Lens,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "The sample is out of focus",
    .sentence = "The lens isn't focused on the sample, so that each pixel mixes with its neighbours.",
    .signature =
        "Errors at edges and fine texture that have the shape of the picture's own second derivative.",
    .remedy = "Focus with the aperture open, then close it by two stops.",
    .source = "Pentland (1987), A new sense for depth of field",
    .parameters = {{"sigmaPx", "pixels", 0, 30, 0.7, "standard deviation of the blur"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
