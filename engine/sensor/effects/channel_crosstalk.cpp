#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "channel-crosstalk",
    .stage = EffectStage::Sensor,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "The colour channels mix",
    .sentence = "Part of the light of one colour is counted in another channel: the colour filters overlap.",
    .signature = "Errors of one channel that look like the picture of another.",
    .remedy = "Photograph a colour chart and declare the matrix.",
    .source = "Hirakawa (2008), Cross-talk explained",
    .parameters = {{"share", "", 0, 0.5, 0.03,
                    "share of a channel's light that is counted in each of the others"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
