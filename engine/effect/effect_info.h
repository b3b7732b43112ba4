#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace patina {

/// The stages that light passes, in its order. Source: command-line contract, effect ids.
enum class EffectStage { Screen, Light, Geometry, Surface, Lens, Sensor };
const char* stageName(EffectStage stage);

/// Kinds of capture in which an effect can act.
enum CaptureKinds : unsigned { kFourierKind = 1, kTwoShotKind = 2, kFlashKind = 4 };

/// What an effect's strength is told in.
struct EffectParameter {
  std::string_view name;  ///< as in explain.json, unit worn: "distanceMm"
  std::string_view unit;  ///< for a person; "" for a ratio
  double least, most;     ///< range that makes sense
  double typical;         ///< a strength that one meets: scale of the prior on it
  std::string_view meaning;
};

/// What a person reads about an effect.
struct EffectInfo {
  std::string_view id;  ///< of the command-line contract
  EffectStage stage;
  unsigned kinds;              ///< CaptureKinds
  std::string_view title;      ///< "Brushed or stretched highlights"
  std::string_view sentence;   ///< what happens to the light, one sentence
  std::string_view signature;  ///< how a residual betrays it, one sentence
  std::string_view remedy;     ///< what to do about it at the next capture, one sentence
  std::string_view source;     ///< literature, or "this program"
  std::vector<EffectParameter> parameters;
};

/// Every effect of the catalogue, by stage, then id. Filled before main by `RegisterEffect` objects, one in
/// engine/<stage>/effects/<id>.cpp each.
const std::vector<const EffectInfo*>& effectCatalogue();
/// Null where there is none.
const EffectInfo* findEffect(std::string_view id);

/// Adds an effect to the catalogue; a file-scope object of an effect's file. `info` must live for ever.
struct RegisterEffect {
  explicit RegisterEffect(const EffectInfo& info);
};

}  // namespace patina
