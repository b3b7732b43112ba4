#include "app/window/progress_estimate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

namespace patina {

namespace {

struct Stage {
  const char* id;
  const char* title;
  double share;  ///< of a typical fit
};

// In the order in which a fit passes through them.
constexpr std::array<Stage, 8> kStages{{
    {"read", "Reading photographs", 0.08},
    {"measure", "Forming measurements", 0.03},
    {"geometry", "Preparing geometry", 0.03},
    {"guess", "First guess", 0.03},
    {"solve", "Fitting texels", 0.70},
    {"maps", "Making maps", 0.02},
    {"predict", "Predicting the photographs", 0.10},
    {"holdout", "Predicting held-out photographs", 0.03},
}};

}  // namespace

ProgressEstimate::ProgressEstimate(const std::map<std::string, double>& secondsByStage,
                                   Clock::time_point start)
    : start_(start) {
  double sum = 0;
  for (const Stage& stage : kStages) {
    const auto known = secondsByStage.find(stage.id);
    // Both predictions are timed as one; most photographs are fitted ones.
    if (std::string_view(stage.id) == "predict" && known == secondsByStage.end()) {
      const auto both = secondsByStage.find("holdout");
      sum += share_[stage.id] = both != secondsByStage.end() ? 0.8 * std::max(both->second, 0.0)
                                : secondsByStage.empty()     ? stage.share
                                                             : 0.0;
      continue;
    }
    const double share = known != secondsByStage.end() ? std::max(known->second, 0.0)
                         : secondsByStage.empty()      ? stage.share
                                                       : 0.0;
    share_[stage.id] = share;
    sum += share;
  }
  if (sum <= 0)
    for (const Stage& stage : kStages) sum += share_[stage.id] = stage.share;
  for (auto& [id, share] : share_) share /= sum;
}

void ProgressEstimate::update(const std::string& stage, std::int64_t done, std::int64_t total,
                              Clock::time_point now) {
  double before = 0;
  bool found = false;
  for (const Stage& known : kStages) {
    if (stage == known.id) {
      found = true;
      break;
    }
    before += share_[known.id];
  }
  if (!found) return;  // a stage that nobody told us of: the bar stands still rather than lies
  const double within = total > 0 ? std::clamp(static_cast<double>(done) / total, 0.0, 1.0) : 0.0;
  fraction_ = std::max(fraction_, std::min(1.0, before + share_[stage] * within));
  const double elapsed = std::chrono::duration<double>(now - start_).count();
  if (elapsed > 1.0 && fraction_ > 0.02)
    left_ = std::chrono::seconds(std::lround(std::ceil(elapsed * (1 - fraction_) / fraction_)));
}

std::string ProgressEstimate::title(const std::string& stage) {
  for (const Stage& known : kStages)
    if (stage == known.id) return known.title;
  return stage;
}

}  // namespace patina
