#include "engine/effect/effect_info.h"

namespace patina {
namespace {

const EffectInfo kInfo{
    .id = "stray-light",
    .stage = EffectStage::Sensor,
    .kinds = kFourierKind | kTwoShotKind | kFlashKind,
    .title = "The light reaches the sample by detours",
    .sentence = "Light is reflected by walls, clothes or the rig and reaches sample or sensor indirectly.",
    .signature = "A broad offset in proportion to the light that was sent, without the pattern's structure.",
    .remedy = "Cover what is bright around the rig with black cloth.",
    .source = "Nayar, Krishnan, Grossberg, Raskar (2006), Fast separation of direct and global components",
    .parameters = {{"share", "", 0, 0.9, 0.01, "share of the light that came by detours"}},
};
const RegisterEffect kRegistered(kInfo);

}  // namespace
}  // namespace patina
