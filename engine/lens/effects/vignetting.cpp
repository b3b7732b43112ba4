#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "vignetting",
    .stage = EffectStage::Lens,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "The picture is darker in its corners",
    .sentence = "The lens passes less light towards the corners than was corrected for.",
    .signature =
        "A smooth error over the picture's own coordinates, the same in every photograph, round about its "
        "centre.",
    .remedy = "Photograph an evenly lit white sheet and declare its fall-off, or close the aperture.",
    .source = "Goldman (2010), Vignette and exposure calibration and compensation",
    .parameters = {{"cornerLoss", "", -0.5, 1, 0.2,
                    "share of the light that is lost in the picture's corner"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
