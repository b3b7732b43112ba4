#include "engine/diagnosis/two_shot_explain.h"

#include <gtest/gtest.h>

#include "devices/simulated/two_shot_rig.h"
#include "engine/brdf/neural_brdf.h"
#include "tests/base/temp_folder.h"

// One effect and none on small simulated captures, with the built-in basis.
namespace patina {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180;

const BasisPtr& basis() {
  static const BasisPtr kept = [] {
    auto built = builtInBasis({});
    if (!built) throw std::runtime_error(built.error().sentence());
    return *built;
  }();
  return kept;
}

TwoShotScene scene() {
  TwoShotScene made;
  made.name = "sample";
  for (const BrdfPtr& brdf : builtInNeuralBrdfs())
    if (brdf->origin().name == "violet-acrylic") made.brdfs = {brdf};
  made.pixels = 64;
  made.samplesPerPixelSide = 2;
  made.poses = {{shotFromHalfDiff({6 * kDegree, 15 * kDegree, 37.5 * kDegree}), {1.0}, false},
                {shotFromHalfDiff({16 * kDegree, 60 * kDegree, 89 * kDegree}), {1.0}, false},
                {shotFromHalfDiff({42 * kDegree, 25 * kDegree, 60 * kDegree}), {1.0}, false},
                {shotFromHalfDiff({4 * kDegree, 40 * kDegree, 90 * kDegree}), {1.0}, true}};
  return made;
}

ExplanationPtr explained(const TwoShotScene& made) {
  const test::TempFolder folder;
  auto simulated = simulateTwoShot(made, folder / "b", {});
  if (!simulated) throw std::runtime_error(simulated.error().sentence());
  ExplainOptions options;
  options.pictures = false;
  auto found = explainTwoShotWith(basis(), {folder / "b"}, options, {});
  if (!found) throw std::runtime_error(found.error().sentence());
  return *found;
}

double valueOf(const EffectFinding& finding, const std::string& name) {
  for (const EffectEstimate& e : finding.parameters)
    if (e.name == name) return e.value;
  ADD_FAILURE() << "no " << name;
  return 0;
}

TEST(ExplainTwoShot, CleanCaptureHasNoEffect) {
  const ExplanationPtr found = explained(scene());
  for (const EffectFinding& effect : found->effects) ADD_FAILURE() << effect.id << ": " << effect.verdict;
  EXPECT_GE(found->considered.size(), 15u);
  EXPECT_FALSE(found->budget.empty());
  EXPECT_EQ(found->after.holdoutRms, found->before.holdoutRms);
}

TEST(ExplainTwoShot, TiltIsFoundWithItsSize) {
  TwoShotScene made = scene();
  made.effects.normalLeansDeg = {1.6, -0.9};
  const ExplanationPtr found = explained(made);
  ASSERT_FALSE(found->effects.empty());
  EXPECT_EQ(found->effects[0].id, "sample-tilt");
  // A tenth of a degree: the rig's frame leans the shortest way, the model turns about x, then y.
  EXPECT_NEAR(valueOf(found->effects[0], "towardsXDeg"), 1.6, 0.1);
  EXPECT_NEAR(valueOf(found->effects[0], "towardsYDeg"), -0.9, 0.1);
  EXPECT_LT(found->after.holdoutRms, 0.6 * found->before.holdoutRms);
}

TEST(ExplainTwoShot, CancelsQuickly) {
  const test::TempFolder folder;
  ASSERT_TRUE(simulateTwoShot(scene(), folder / "b", {}).ok());
  std::stop_source stop;
  stop.request_stop();
  JobContext job;
  job.stop = stop.get_token();
  const auto found = explainTwoShotWith(basis(), {folder / "b"}, {}, job);
  ASSERT_FALSE(found.ok());
  EXPECT_EQ(found.error().code, ErrorCode::Cancelled);
}

TEST(ExplainTwoShot, NamesWhatIsMissing) {
  const auto found = explainTwoShotWith(basis(), {"/nowhere/at/all"}, {}, {});
  ASSERT_FALSE(found.ok());
  EXPECT_EQ(found.error().code, ErrorCode::NotFound);
}

}  // namespace
}  // namespace patina
