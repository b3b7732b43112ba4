#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "iridescence",
    .stage = EffectStage::Surface,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "The colour changes with the angle",
    .sentence =
        "Thin films or flakes give the reflection another colour at each angle, as on soap films, beetles "
        "and effect paints.",
    .signature =
        "Errors of opposite sign in the colour channels that change with the angle between light and camera.",
    .remedy = "Take photographs at several angles between light and camera.",
    .source =
        "Belcour, Barla (2017), A practical extension to microfacet theory for the modeling of varying "
        "iridescence",
    .parameters = {{"chromaChange", "", 0, 2, 0.3,
                    "largest change of a channel's share of the light over the photographs' angles"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
