#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "exposure-mismatch",
    .stage = EffectStage::Sensor,
    .kinds = kTwoShotKind | kFlashKind,
    .title = "An exposure is not what it says",
    .sentence = "A photograph's exposure, or that of its white reference, differs from the declared one.",
    .signature = "One factor over a whole photograph, which the photographs before and after don't share.",
    .remedy = "Set exposure, gain and white balance by hand and lock them.",
    .source =
        "Cho, Matsushita, Tai, Kweon (2016), Photometric stereo under non-uniform light intensities and "
        "exposures",
    .parameters = {{"relativeChange", "", -0.9, 10, 0.05,
                    "relative change of the exposure against the declared one"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
