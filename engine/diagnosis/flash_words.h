#pragma once

#include <string>
#include <vector>

#include "engine/diagnosis/explanation.h"
#include "engine/diagnosis/flash_trials.h"

namespace patina {

/// An added effect in numbers and words. `without`: the state before it was added, for the plot.
EffectFinding flashFinding(FlashEffect effect, const FlashTrial& trial, const FlashTry& with,
                           const JointState& without);
/// How large an effect that isn't in `final` could be, 95 %, and what it would do to the maps.
BudgetLine flashBudget(FlashEffect effect, const FlashTrial& trial, const FlashTry& final);
/// Effects of the catalogue that photographs with a flash beside the lens can't show, or that this kind has
/// no separate term for: an entry each, and its line of the budget.
void addFlashBlindSpots(Explanation& explanation, const FlashTrial& trial, const FlashTry& final);

}  // namespace patina
