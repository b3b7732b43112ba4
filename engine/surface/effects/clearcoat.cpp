#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "clearcoat",
    .stage = EffectStage::Surface,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "A clear, glossy layer on top",
    .sentence =
        "A thin clear coat adds a sharp, colourless reflection over the material's own, as on car paint and "
        "lacquered wood.",
    .signature = "A sharp and colourless reflection, strongest at high frequencies, beside the broad one.",
    .remedy = "Add patterns of higher frequencies, or a photograph straight into the mirror direction.",
    .source = "Weidlich, Wilkie (2007), Arbitrarily layered micro-facet surfaces; Burley (2012)",
    .parameters = {{"strength", "", 0, 1, 0.04, "albedo of the coat at normal incidence"},
                   {"sigma", "", 0.0005, 0.5, 0.02, "standard deviation of the coat's slope"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
