#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "flicker",
    .stage = EffectStage::Screen,
    .kinds = kFourierKind,
    .title = "The screen flickers from photograph to photograph",
    .sentence =
        "The screen's brightness differs from photograph to photograph: its backlight pulses, and an "
        "exposure catches a varying number of pulses.",
    .signature = "One factor a photograph without any order in time.",
    .remedy = "Expose for a whole number of the backlight's periods, or for much longer than one.",
    .source = "this program",
    .parameters = {{"perPhoto", "", 0, 0.5, 0.008,
                    "standard deviation of the relative change of brightness, photograph to photograph"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
