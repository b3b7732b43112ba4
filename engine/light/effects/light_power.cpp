#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "light-power",
    .stage = EffectStage::Light,
    .kinds = kTwoShotKind | kFlashKind,
    .title = "The light's power differs between photographs",
    .sentence = "The light was stronger or weaker in some photographs than the bundle says.",
    .signature = "One factor a photograph over all of its pixels, dark and bright.",
    .remedy = "Keep a white patch in every picture.",
    .source =
        "Cho, Matsushita, Tai, Kweon (2016), Photometric stereo under non-uniform light intensities and "
        "exposures",
    .parameters = {{"relativeChange", "", -0.9, 10, 0.1,
                    "relative change of the light's power against what the bundle says"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
