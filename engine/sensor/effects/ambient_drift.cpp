#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "ambient-drift",
    .stage = EffectStage::Sensor,
    .kinds = kFourierKind | kFlashKind,
    .title = "Other light changes between photographs",
    .sentence =
        "Daylight, a lamp or somebody passing by changes the light that doesn't come from the screen or "
        "flash.",
    .signature = "An offset a photograph; sums of opposite phases show it most clearly.",
    .remedy = "Darken the room, and take a photograph with the light off now and then.",
    .source = "this program",
    .parameters = {{"perPhoto", "of full white", 0, 1, 0.001,
                    "standard deviation of the offset, photograph to photograph"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
