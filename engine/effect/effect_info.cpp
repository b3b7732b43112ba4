#include "engine/effect/effect_info.h"

#include <algorithm>
#include <tuple>

namespace patina {
namespace {

std::vector<const EffectInfo*>& registry() {
  static std::vector<const EffectInfo*>
      effects;  // filled while other files' objects are made: no order among them
  return effects;
}

}  // namespace

const char* stageName(EffectStage stage) {
  switch (stage) {
    case EffectStage::Screen:
      return "screen";
    case EffectStage::Light:
      return "light";
    case EffectStage::Geometry:
      return "geometry";
    case EffectStage::Surface:
      return "surface";
    case EffectStage::Lens:
      return "lens";
    case EffectStage::Sensor:
      return "sensor";
  }
  return "unknown";
}

const std::vector<const EffectInfo*>& effectCatalogue() {
  return registry();
}

const EffectInfo* findEffect(std::string_view id) {
  for (const EffectInfo* effect : registry())
    if (effect->id == id) return effect;
  return nullptr;
}

RegisterEffect::RegisterEffect(const EffectInfo& info) {
  auto& all = registry();
  const auto key = [](const EffectInfo* e) { return std::tuple(e->stage, e->id); };
  all.insert(std::ranges::upper_bound(all, key(&info), {}, key), &info);
}

}  // namespace patina
