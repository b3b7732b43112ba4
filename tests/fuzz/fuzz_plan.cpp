#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "engine/twoshot/plan.h"

/// Any bytes as a plan: a plan or a sentence, never a crash; and what is accepted is written and accepted
/// again, with the same shots.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto plan = patina::parsePlan(text, "plan.json");
  if (!plan) {
    if (plan.error().what.empty() || plan.error().sentence().size() > 4000) std::abort();
    return 0;
  }
  for (const patina::PlannedShot& shot : plan->shots) {
    const patina::ShotDirections& to = shot.directions;
    if (!(std::abs(to.toCamera.norm() - 1) < 1e-9) || !(std::abs(to.toLight.norm() - 1) < 1e-9)) std::abort();
    if (!(to.toCamera.z() > 0) || !(to.toLight.z() > 0)) std::abort();
  }
  const auto again = patina::parsePlan(patina::planJson(*plan), "plan.json");
  if (!again || again->shots.size() != plan->shots.size()) std::abort();
  return 0;
}
