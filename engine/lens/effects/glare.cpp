#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "glare",
    .stage = EffectStage::Lens,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "The lens scatters light around bright places",
    .sentence =
        "A share of the light of each pixel spreads over its neighbourhood: dust, a film or reflections in "
        "the lens.",
    .signature = "A veil around highlights and over dark places beside bright ones.",
    .remedy = "Clean the lens, shade it from the screen, and keep bright things out of the picture.",
    .source = "Talvala, Adams, Horowitz, Levoy (2007), Veiling glare in high dynamic range imaging",
    .parameters = {{"share", "", 0, 0.9, 0.1, "share of a pixel's light that is spread"},
                   {"widthPx", "pixels", 0.3, 200, 4, "standard deviation of the spread"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
