#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "subsurface",
    .stage = EffectStage::Surface,
    .kinds = kFourierKind | kFlashKind,
    .title = "Light travels under the surface",
    .sentence =
        "Light enters at one place and leaves at another, as in paper, skin, wax and marble, so that edges "
        "of light and of colour are soft.",
    .signature = "Errors along borders between materials and beside bright places; nothing in smooth areas.",
    .remedy =
        "Light a small spot, or lay a sharp black mask on the sample: the width of the glow is the distance.",
    .source = "Jensen, Marschner, Levoy, Hanrahan (2001), A practical model for subsurface light transport",
    .parameters = {{"share", "", 0, 1, 0.3, "share of the diffuse light that leaves elsewhere"},
                   {"distanceMm", "mm", 0.01, 100, 2, "mean distance that it travels"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
