#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "saturation",
    .stage = EffectStage::Sensor,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "Bright pixels are clipped lower than declared",
    .sentence =
        "The camera stops counting at a level below the declared one, so that highlights come out too dark.",
    .signature = "Many pixels with one same highest value, and errors only in the brightest places.",
    .remedy = "Expose shorter, or add a shorter exposure of each pattern.",
    .source = "EMVA Standard 1288 (2021), Characterization of image sensors and cameras",
    .parameters = {{"level", "of full white", 0.001, 100, 0.8, "value at which pixels clip"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
