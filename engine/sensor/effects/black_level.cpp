#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "black-level",
    .stage = EffectStage::Sensor,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "Black is not zero",
    .sentence = "The sensor's values start above or below zero where there is no light.",
    .signature = "The same offset in every pixel of every photograph, plainest in the darkest ones.",
    .remedy = "Take a photograph with the cap on and declare it.",
    .source = "Healey, Kondepudy (1994), Radiometric CCD camera calibration and noise estimation",
    .parameters = {{"offset", "of full white", -0.2, 0.2, 0.002, "what the sensor says without light"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
