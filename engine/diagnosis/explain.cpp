#include <algorithm>

#include "engine/capture/two_shot_capture.h"
#include "engine/diagnosis/explain_kinds.h"
#include "engine/effect/effect_info.h"

namespace patina {
namespace {

/// The kind that all bundles are of.
Result<std::string> commonKind(const std::vector<std::filesystem::path>& bundles) {
  if (bundles.empty())
    return Error{ErrorCode::Invalid, "there is no bundle to explain", "",
                 "name a folder with a capture.json"};
  std::string kind;
  for (const auto& bundle : bundles) {
    auto one = captureKind(bundle);
    if (!one) return one.error();
    if (kind.empty()) kind = *one;
    if (*one != kind)
      return Error{ErrorCode::Invalid,
                   "bundles of kind '" + kind + "' and '" + *one + "' can't be explained together",
                   bundle.string(), "explain them one by one"};
  }
  return kind;
}

}  // namespace

std::vector<std::string> ExplainOptions::validate() const {
  std::vector<std::string> problems;
  if (size < 0 || size > 16384) problems.push_back("size must be between 0 and 16384 texels");
  if (testedTexels < 100 || testedTexels > 100000)
    problems.push_back("testedTexels must be between 100 and 100000");
  if (maxEffects < 0 || maxEffects > 10) problems.push_back("maxEffects must be between 0 and 10");
  if (!(falseAlarmRate > 0) || !(falseAlarmRate < 1))
    problems.push_back("falseAlarmRate must be between 0 and 1");
  return problems;
}

namespace {

Status checked(const ExplainOptions& options) {
  const auto problems = options.validate();
  if (problems.empty()) return Done{};
  std::string all;
  for (const auto& problem : problems) all += (all.empty() ? "" : "; ") + problem;
  return Error{ErrorCode::Invalid, all, "explain options", "see --help for ranges"};
}

}  // namespace

Result<ExplanationPtr> explain(const std::vector<std::filesystem::path>& bundles,
                               const ExplainOptions& options, const JobContext& job) {
  if (const Status ok = checked(options); !ok) return ok.error();
  auto kind = commonKind(bundles);
  if (!kind) return kind.error();
  if (*kind == "two-shot") return explainTwoShot(bundles, options, job);
  if (*kind == "flash") return explainFlash(bundles, options, job);
  return explainFourier(bundles, options, job);
}

Result<ExplanationPtr> explainWith(const std::vector<std::filesystem::path>& bundles,
                                   const std::vector<std::string>& ids, const ExplainOptions& options,
                                   const JobContext& job) {
  if (const Status ok = checked(options); !ok) return ok.error();
  auto kind = commonKind(bundles);
  if (!kind) return kind.error();
  for (const auto& id : ids) {
    const EffectInfo* info = findEffect(id);
    if (!info)
      return Error{ErrorCode::Unsupported, "there is no effect '" + id + "'", "effects",
                   "see docs/effects.md for the catalogue"};
  }
  if (*kind != "fourier")
    return Error{ErrorCode::Unsupported,
                 "adding chosen effects is possible for captures of kind 'fourier' only",
                 bundles.front().string(), "use 'explain'"};
  for (const auto& id : ids)
    if (!(findEffect(id)->kinds & kFourierKind))
      return Error{ErrorCode::Unsupported, "'" + id + "' can't act in a capture of kind 'fourier'", "effects",
                   "see docs/effects.md for what can"};
  return explainFourierWith(bundles, ids, options, job);
}

}  // namespace patina
