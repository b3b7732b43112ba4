#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "engine/diagnosis/explain_kinds.h"
#include "engine/flash/fit.h"
#include "tests/base/temp_folder.h"
#include "tests/flash/small_scene.h"
#include "tests/test_data.h"

namespace patina {
namespace {

ExplanationPtr explainScene(const FlashScene& scene, std::uint64_t seed) {
  test::TempFolder folder;
  JobContext job;
  job.seed = seed;
  const auto made = simulateFlash(scene, folder / "bundle", job);
  EXPECT_TRUE(made.ok()) << made.error().sentence();
  ExplainOptions options;
  options.testedTexels = 500, options.maxEffects = 2;
  const auto explained = explainFlash({folder / "bundle"}, options, {});
  EXPECT_TRUE(explained.ok()) << explained.error().sentence();
  return explained ? *explained : nullptr;
}

std::string told(const Explanation& explanation) {
  std::string text;
  for (const EffectFinding& one : explanation.effects) text += one.id + ": " + one.verdict + "\n";
  for (const EffectFinding& one : explanation.considered) text += "(" + one.id + ": " + one.verdict + ")\n";
  return text;
}

TEST(ExplainFlash, CleanPhotographsStayQuiet) {
  const ExplanationPtr explanation = explainScene(test::smallFlashScene(5), 5);
  ASSERT_NE(explanation, nullptr);
  EXPECT_TRUE(explanation->effects.empty()) << told(*explanation);
  EXPECT_EQ(explanation->kind, "flash");
  EXPECT_EQ(explanation->before.holdoutRms, explanation->after.holdoutRms);
  EXPECT_GT(explanation->noiseFloorHoldout, 0);
  EXPECT_GE(explanation->breakdowns.size(), 5u);
  EXPECT_FALSE(explanation->pictures.empty());
  EXPECT_EQ(explanation->photos.size(), 9u);
  // What can't be seen is said, not left out.
  const auto line = std::find_if(explanation->budget.begin(), explanation->budget.end(),
                                 [](const BudgetLine& one) { return one.id == "fresnel"; });
  ASSERT_NE(line, explanation->budget.end());
  EXPECT_THAT(line->sentence, testing::HasSubstr("difference angle"));
  for (const FlashEffect effect : allFlashEffects()) {
    EXPECT_TRUE(std::any_of(explanation->budget.begin(), explanation->budget.end(),
                            [&](const BudgetLine& one) { return one.id == flashEffectId(effect); }))
        << flashEffectId(effect);
  }
}

struct Planted {
  std::string id;
  std::function<void(FlashScene&)> plant;
};

void PrintTo(const Planted& planted, std::ostream* out) {
  *out << planted.id;
}

class PlantedFlashEffect : public testing::TestWithParam<Planted> {};

TEST_P(PlantedFlashEffect, IsNamedFirst) {
  FlashScene scene = test::smallFlashScene(2);
  GetParam().plant(scene);
  const ExplanationPtr explanation = explainScene(scene, 2);
  ASSERT_NE(explanation, nullptr);
  ASSERT_FALSE(explanation->effects.empty()) << told(*explanation);
  const std::string first = explanation->effects.front().id;
  bool named = first == GetParam().id;
  for (const auto& group : explanation->confusable) {
    named |= group.front() == first && group.size() == 2 && group[1] == GetParam().id;
  }
  EXPECT_TRUE(named) << told(*explanation);
  const EffectFinding& finding = explanation->effects.front();
  EXPECT_GT(finding.sigmas, 3);
  EXPECT_FALSE(finding.sentence.empty());
  EXPECT_FALSE(finding.parameters.empty());
  EXPECT_GT(finding.confidence, 0.5);
  EXPECT_LT(explanation->after.fitRms, explanation->before.fitRms);
}

const Planted kPlanted[] = {
    {"camera-response", [](FlashScene& s) { s.phone.toneGamma = 0.8; }},
    {"light-power", [](FlashScene& s) { s.phone.power = {1.1, 0.85, 1.2, 0.95, 0.8, 1.05, 1.0, 1.15, 0.9}; }},
    {"near-light",
     [](FlashScene& s) {
       s.phone.beamExponent = 8;
       s.phone.beamAim = {0.2, -0.15};
     }},
    {"vignetting", [](FlashScene& s) { s.phone.vignetting = 0.4; }},
    {"anisotropy",
     [](FlashScene& s) {
       s.surface.anisotropy = 1.8;
       s.surface.anisotropyAngleDeg = 30;
     }},
};

INSTANTIATE_TEST_SUITE_P(, PlantedFlashEffect, testing::ValuesIn(kPlanted), [](const auto& info) {
  std::string name = info.param.id;
  name.erase(std::remove(name.begin(), name.end(), '-'), name.end());
  return name;
});

// Found, but not yet by their right names: a seventh of the light from the room is taken for the flash's
// power, and a third lobe for a free-form profile first. What must hold is that something is, and that it
// predicts.
const Planted kMisnamed[] = {
    {"stray-light", [](FlashScene& s) { s.phone.ambient.setConstant(0.8); }},
    {"third-lobe", [](FlashScene& s) { s.surface.thirdShare = 0.35; }},
};

TEST(ExplainFlash, EffectsThatAreMisnamedAreStillSeen) {
  for (const Planted& planted : kMisnamed) {
    FlashScene scene = test::smallFlashScene(2);
    planted.plant(scene);
    const ExplanationPtr explanation = explainScene(scene, 2);
    ASSERT_NE(explanation, nullptr);
    EXPECT_FALSE(explanation->effects.empty()) << planted.id << "\n" << told(*explanation);
    EXPECT_LT(explanation->after.fitRms, explanation->before.fitRms) << planted.id;
  }
}

TEST(ExplainFlash, RealPhotographsArePredictedBetterAfterwards) {
  PATINA_NEEDS_SHARED("flash/cards_blue");
  ExplainOptions options;
  options.size = 128, options.testedTexels = 800, options.pictures = false;
  const auto explained = explainFlash({test::sharedData() / "flash" / "cards_blue"}, options, {});
  ASSERT_TRUE(explained.ok()) << explained.error().sentence();
  const Explanation& explanation = **explained;
  ASSERT_FALSE(explanation.effects.empty()) << told(explanation);
  EXPECT_LT(explanation.after.fitRms, explanation.before.fitRms);
  EXPECT_LT(explanation.after.holdoutRms, 1.01 * explanation.before.holdoutRms);
  EXPECT_GT(explanation.unexplained.fraction, 0.1) << "sparkle isn't explained by anything here";
  EXPECT_FALSE(explanation.unexplained.description.empty());
}

}  // namespace
}  // namespace patina
