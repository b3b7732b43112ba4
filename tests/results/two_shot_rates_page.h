#pragma once

#include <string>
#include <vector>

#include "tests/results/closing_loop_scores.h"

namespace patina::test {

/// Grows when draws change, so that older lines of a log aren't mixed in.
inline constexpr int kTwoShotDrawVersion = 1;

/// What came out for one drawn capture.
struct TwoShotOutcome : LoopOutcome {
  std::string material, family;
  double scale = 1;          ///< of the effect's usual strength
  double holdoutClean = -1;  ///< of the same capture without the effect
  /// By how much the effect raises the held-out photographs' error over that without it; 1 where it doesn't
  /// or can't be said.
  double rise() const { return holdoutBefore > 0 && holdoutClean > 0 ? holdoutBefore / holdoutClean : 1; }
  std::string sentence() const;  ///< one line for a person who waits
};

/// From a line of the log (JSON). A line that isn't one becomes an outcome with `failure`.
TwoShotOutcome outcomeOfLine(const std::string& line);

/// The part of docs/results.md, and its charts. Kinds are set by `rise`: "strong" from 1.5, "moderate" from
/// 1.2, "faint" below.
LoopPage twoShotLoopPage(std::vector<TwoShotOutcome> outcomes, std::uint64_t seed,
                         const std::string& machine);

}  // namespace patina::test
