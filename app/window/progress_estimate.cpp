#include "app/window/progress_estimate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string_view>

namespace patina {

namespace {

struct Stage {
  const char* id;
  const char* title;
  double share;         ///< of a typical fit
  const char* timedAs;  ///< the key of FourierFitStats::seconds that its time is part of
};

// In the order in which a fit passes through them.
constexpr std::array<Stage, 9> kFourierStages{{
    {"read", "Reading photographs", 0.15, "read"},
    {"geometry", "Preparing geometry", 0.02, "geometry"},
    {"levels", "Fitting coarse levels", 0.25, "levels"},
    {"upsample", "Refining the coarse solution", 0.05, "levels"},
    {"solve", "Fitting texels", 0.25, "solve"},
    {"rescue", "Trying neighbours' solutions", 0.05, "solve"},
    {"maps", "Making maps", 0.03, "maps"},
    {"predict", "Predicting the photographs", 0.12, "predict"},
    {"holdout", "Predicting held-out photographs", 0.08, "holdout"},
}};

constexpr std::array<Stage, 4> kTwoShotStages{{
    {"read", "Reading photographs", 0.3, "read"},
    {"solve", "Solving", 0.2, "solve"},
    {"posterior", "Judging what was measured", 0.3, "posterior"},
    {"predict", "Predicting the photographs", 0.2, "predict"},
}};

// An explanation reports its own stages; those of the fits within it move the bar a little.
constexpr std::array<Stage, 6> kExplainStages{{
    {"fit", "Fitting the standard model", 0.3, "fit"},
    {"residual", "Looking at what is left", 0.1, "residual"},
    {"score", "Trying every effect on it", 0.2, "score"},
    {"refit", "Fitting again with the likely ones", 0.25, "refit"},
    {"maps", "Making the final maps", 0.1, "maps"},
    {"report", "Writing down what was found", 0.05, "report"},
}};

/// Stages that have a time of their own: nothing is learned from them.
constexpr std::array<Stage, 6> kOtherStages{{
    {"built-in basis", "Making the built-in basis (once)", 0, ""},
    {"observe", "Measuring the sample's pixels", 0, ""},
    {"unmap", "Making the reflectance", 0, ""},
    {"restart", "Searching for directions", 0, ""},
    {"search", "Searching for directions", 0, ""},
    {"expose", "Exposing", 0, ""},
}};

std::span<const Stage> stagesOf(ProgressEstimate::Work work) {
  switch (work) {
    case ProgressEstimate::Work::TwoShotFit:
      return kTwoShotStages;
    case ProgressEstimate::Work::Explain:
      return kExplainStages;
    case ProgressEstimate::Work::FourierFit:
      break;
  }
  return kFourierStages;
}

/// What a stage that nobody told us of takes of the time that is left, for want of anything better.
constexpr double kUnknownShare = 0.05;

double typicalShareOf(std::span<const Stage> stages, std::string_view timedAs) {
  double sum = 0;
  for (const Stage& stage : stages)
    if (timedAs == stage.timedAs) sum += stage.share;
  return sum;
}

}  // namespace

ProgressEstimate::ProgressEstimate(const std::map<std::string, double>& secondsByStage,
                                   Clock::time_point start, Work work)
    : work_(work), start_(start) {
  const auto stages = stagesOf(work);
  // Seconds by key, each key once; keys of the earlier run that we don't know ("total") say nothing.
  std::map<std::string, double> seconds;
  double known = 0, knownShare = 0;
  for (const Stage& stage : stages) {
    const auto entry = secondsByStage.find(stage.timedAs);
    if (entry == secondsByStage.end() || !(entry->second >= 0) || seconds.count(stage.timedAs)) continue;
    seconds[stage.timedAs] = entry->second;
    known += entry->second;
    knownShare += typicalShareOf(stages, stage.timedAs);
  }
  // A stage without a time (the earlier bundle held nothing out, say) has its typical part.
  const double secondsOfAll = known > 0 ? known / knownShare : 1;
  double sum = 0;
  for (const Stage& stage : stages) {
    const auto entry = seconds.find(stage.timedAs);
    share_[stage.id] = known > 0 && entry != seconds.end()
                           ? entry->second * stage.share / typicalShareOf(stages, stage.timedAs)
                           : secondsOfAll * stage.share;
    sum += share_[stage.id];
  }
  for (auto& [id, share] : share_) share /= sum;
}

void ProgressEstimate::update(const std::string& stage, std::int64_t done, std::int64_t total,
                              Clock::time_point now) {
  if (stage != stage_) {
    stage_ = stage;
    double before = 0, after = 0;
    bool found = false;
    for (const Stage& known : stagesOf(work_)) {
      if (stage == known.id)
        found = true;
      else
        (found ? after : before) += share_[known.id];
    }
    // From where the bar stands, so that stages left out or unheard of neither freeze it nor turn it back.
    from_ = found ? std::max(fraction_, before) : fraction_;
    const double share = found ? share_[stage] : 0;
    const double part = !found ? kUnknownShare : share + after > 0 ? share / (share + after) : 1.0;
    to_ = from_ + (1 - from_) * part;
  }
  const double within = total > 0 ? std::clamp(static_cast<double>(done) / total, 0.0, 1.0) : 0.0;
  fraction_ = std::max(fraction_, std::min(1.0, from_ + (to_ - from_) * within));
  const double elapsed = std::chrono::duration<double>(now - start_).count();
  if (elapsed > 1.0 && fraction_ > 0.02)
    left_ = std::chrono::seconds(std::lround(std::ceil(elapsed * (1 - fraction_) / fraction_)));
}

std::string ProgressEstimate::title(const std::string& stage, Work work) {
  // Within an explanation there is a fit, whose stages have their names too.
  for (const std::span<const Stage> stages :
       {stagesOf(work), std::span<const Stage>(kOtherStages), std::span<const Stage>(kFourierStages),
        std::span<const Stage>(kTwoShotStages)})
    for (const Stage& known : stages)
      if (stage == known.id) return known.title;
  return stage;
}

}  // namespace patina
