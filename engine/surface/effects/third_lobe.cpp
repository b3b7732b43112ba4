#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "third-lobe",
    .stage = EffectStage::Surface,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "Highlights with a broad veil around them",
    .sentence =
        "Around its highlight the material has a second, broader one that a single lobe with one kurtosis "
        "can't follow.",
    .signature =
        "Errors at the lowest frequencies in all directions, and at frequencies between those that were "
        "fitted.",
    .remedy = "Add patterns of low frequencies, or photographs farther from the highlight.",
    .source =
        "Ngan, Durand, Matusik (2005), Experimental analysis of BRDF models; Walter, Marschner, Li, Torrance "
        "(2007) for the tails",
    .parameters = {{"share", "", 0, 1, 0.2, "share of the specular light in the broad lobe"},
                   {"sigmaRatio", "", 1, 20, 3,
                    "slope's standard deviation of the broad lobe over that of the narrow one"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
