#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/diagnosis/two_shot_draws.h"
#include "tests/results/two_shot_rates_page.h"

// The draws of two-shot captures, and the page that counts what was said of them.
namespace patina::test {
namespace {

std::string line(const std::string& truth, const std::string& named, double clean, double before) {
  const auto list = [](const std::string& id) { return id.empty() ? std::string("[]") : "[\"" + id + "\"]"; };
  return "{\"seed\": 7, \"family\": \"rgl\", \"truth\": " + list(truth) + ", \"named\": " + list(named) +
         ", \"confidence\": [0.95], \"clean\": " + std::to_string(clean) +
         ", \"before\": " + std::to_string(before) + "}";
}

TEST(TwoShotRates, KindsFollowTheRiseOfTheError) {
  EXPECT_EQ(outcomeOfLine(line("glare", "", 0.1, 0.2)).kind, "strong");
  EXPECT_EQ(outcomeOfLine(line("glare", "", 0.1, 0.13)).kind, "moderate");
  EXPECT_EQ(outcomeOfLine(line("glare", "", 0.1, 0.1)).kind, "faint");
  EXPECT_EQ(outcomeOfLine(line("", "", 0.1, 0.1)).kind, "clean");
  EXPECT_FALSE(outcomeOfLine("{").failure.empty());
}

TEST(TwoShotRates, ThePageMarksABoundThatIsMissed) {
  std::vector<TwoShotOutcome> outcomes(20, outcomeOfLine(line("glare", "glare", 0.1, 0.2)));
  EXPECT_EQ(twoShotLoopPage(outcomes, 1, "machine").markdown.find("**missed**"), std::string::npos);
  outcomes.insert(outcomes.end(), 5, outcomeOfLine(line("glare", "defocus", 0.1, 0.2)));
  const std::string text = twoShotLoopPage(outcomes, 1, "machine").markdown;
  EXPECT_THAT(text, testing::HasSubstr("20 of 25"));
  EXPECT_THAT(text, testing::HasSubstr("**missed**"));
}

TEST(TwoShotDraws, TheSeedDecidesAllButTheEffect) {
  const TwoShotDraw plain = drawTwoShot(41, {}), again = drawTwoShot(41, {}),
                    tilted = drawTwoShot(41, {"sample-tilt"});
  EXPECT_EQ(plain.material, again.material);
  EXPECT_EQ(plain.scene.poses.size(), again.scene.poses.size());
  EXPECT_EQ(plain.material, tilted.material);
  EXPECT_EQ(plain.scene.noise.read, tilted.scene.noise.read);
  EXPECT_FALSE(tilted.scene.effects.normalLeansDeg.isZero(0));
  EXPECT_TRUE(tilted.clean.effects.normalLeansDeg.isZero(0));
  EXPECT_TRUE(plain.scene.validate().empty());
}

TEST(TwoShotDraws, EveryEffectChangesTheScene) {
  for (const std::string& id : drawnEffectIds()) {
    TwoShotDraw draw = drawTwoShot(12, {id});
    draw.scene.effects.surroundings = 0;
    EXPECT_TRUE(draw.scene.brdfs[0] != draw.clean.brdfs[0] || draw.scene.effects.any()) << id;
    EXPECT_TRUE(draw.scene.validate().empty()) << id;
  }
}

}  // namespace
}  // namespace patina::test
