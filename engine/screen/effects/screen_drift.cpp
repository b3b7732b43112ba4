#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "screen-drift",
    .stage = EffectStage::Screen,
    .kinds = kFourierKind,
    .title = "The screen's brightness drifts during the capture",
    .sentence =
        "The screen grows brighter or dimmer while the photographs are taken, most of all while it warms up.",
    .signature = "One factor a photograph that changes slowly in the order in which they were taken.",
    .remedy =
        "Let the screen warm up for half an hour, and photograph a white patch beside the sample in every "
        "picture.",
    .source = "this program",
    .parameters = {{"totalChange", "", -0.9, 1, 0.05,
                    "relative change of brightness from the first photograph to the last"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
