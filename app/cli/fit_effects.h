#pragma once

#include <string>
#include <vector>

#include "app/cli/verbs.h"
#include "engine/diagnosis/explanation.h"

namespace patina::cli {

/// What was typed as --effects: "none", "auto", or ids.
struct WantedEffects {
  bool none = true, automatic = false;
  std::vector<std::string> ids;
};
/// Errors: Invalid with the nearest id (an unknown one, or one that can't act in a capture of this kind).
/// `kind`: empty where it isn't known yet; then only the words are checked.
Result<WantedEffects> wantedEffects(const std::string& text, const std::string& kind);

/// Fits the bundle with effects beyond the standard model, given ones or those that the photographs show, and
/// writes the fit (maps of effects beside its own) to `out`. Returns an ExitStatus.
int runFitWithEffects(const std::string& bundle, const std::string& out, const WantedEffects& wanted,
                      int size, Context& context);

/// An effect that was added: title, sentence, values, evidence; one line each.
void printFinding(const EffectFinding& finding, Console& console);

}  // namespace patina::cli
