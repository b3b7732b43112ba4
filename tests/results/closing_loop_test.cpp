#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "tests/results/closing_loop_draw.h"
#include "tests/results/closing_loop_scores.h"

namespace patina::test {
namespace {

// ---- the draw ----

TEST(ClosingLoopDraw, EveryEffectIsDrawnAloneAndIsInRange) {
  for (const DrawStrength strength : {DrawStrength::Strong, DrawStrength::Weak}) {
    const std::vector<std::string> effects = drawnEffects(strength);
    EXPECT_GE(effects.size(), strength == DrawStrength::Strong ? 10u : 18u);
    EXPECT_EQ(std::set<std::string>(effects.begin(), effects.end()).size(), effects.size());
    for (const std::string& effect : effects)
      for (std::uint64_t seed = 1; seed <= 25; ++seed) {
        const DrawnCapture drawn = drawCapture(seed, {effect}, strength);
        EXPECT_THAT(drawn.options.effects.ids(), testing::ElementsAre(effect)) << seed;
        EXPECT_EQ(drawn.strengthField.substr(0, effect.size() + 1), effect + ".");
        EXPECT_TRUE(drawn.options.effects.validate(static_cast<int>(drawn.sheet.materials.size())).empty())
            << drawn.summary;
        EXPECT_TRUE(drawn.rig.validate().empty());
        EXPECT_TRUE(drawn.sheet.validate().empty());
      }
  }
}

TEST(ClosingLoopDraw, TheSeedSaysEverythingAndTheEffectChangesNothingElse) {
  const DrawnCapture a = drawCapture(5, {"flicker"}, DrawStrength::Weak),
                     b = drawCapture(5, {"flicker"}, DrawStrength::Weak);
  EXPECT_EQ(a.summary, b.summary);
  EXPECT_EQ(a.rig.camera.translationMm, b.rig.camera.translationMm);
  const DrawnCapture clean = drawCapture(5, {}, DrawStrength::Weak);
  EXPECT_TRUE(clean.options.effects.none());
  EXPECT_EQ(clean.rig.screen.originMm, a.rig.screen.originMm);
  EXPECT_EQ(clean.rig.noise, a.rig.noise);
  EXPECT_EQ(clean.sheet.materials.size(), a.sheet.materials.size());
  EXPECT_NE(drawCapture(6, {}, DrawStrength::Weak).summary, clean.summary);
}

TEST(ClosingLoopDraw, CoversTheRangesThatItPromises) {
  double sigmaLow = 1, sigmaHigh = 0, noiseLow = 1, noiseHigh = 0;
  std::set<std::size_t> materials;
  std::set<int> pixels;
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    const DrawnCapture drawn = drawCapture(seed, {}, DrawStrength::Weak);
    for (const SheetMaterial& material : drawn.sheet.materials)
      sigmaLow = std::min(sigmaLow, material.sigma), sigmaHigh = std::max(sigmaHigh, material.sigma);
    noiseLow = std::min(noiseLow, drawn.rig.noise.shot),
    noiseHigh = std::max(noiseHigh, drawn.rig.noise.shot);
    materials.insert(drawn.sheet.materials.size());
    pixels.insert(drawn.rig.camera.width);
  }
  EXPECT_LT(sigmaLow, 0.045);
  EXPECT_GT(sigmaHigh, 0.23);
  EXPECT_GE(sigmaLow, 0.04);
  EXPECT_LE(sigmaHigh, 0.25);
  EXPECT_LT(noiseLow, 1.1e-5);
  EXPECT_GT(noiseHigh, 4.5e-5);
  EXPECT_EQ(materials, (std::set<std::size_t>{1, 2, 3}));
  EXPECT_EQ(*pixels.begin(), 40);
  EXPECT_EQ(*pixels.rbegin(), 64);
}

TEST(ClosingLoopDraw, TheHighlightFallsOnTheScreen) {
  // Else half of the draws would show a sheet without any highlight.
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    const SimulatedRig rig = drawCapture(seed, {}, DrawStrength::Weak).rig;
    const Eigen::Vector3d view = rig.camera.positionMm().normalized(), light(-view.x(), -view.y(), view.z());
    const Eigen::Vector3d normal = rig.screen.worldFromScreen.col(2);
    const double length = rig.screen.originMm.dot(normal) / light.dot(normal);
    const Eigen::Vector3d onScreen =
        rig.screen.worldFromScreen.transpose() * (length * light - rig.screen.originMm);
    EXPECT_LT(std::abs(onScreen.x()), 0.5 * rig.screen.widthMm) << seed;
    EXPECT_LT(std::abs(onScreen.y()), 0.5 * rig.screen.heightMm) << seed;
  }
}

TEST(ClosingLoopDraw, AGivenStrengthAndAFactorAreKept) {
  const DrawnCapture given = drawCaptureWith(3, "anisotropy", 1.37);
  EXPECT_EQ(given.options.effects.anisotropy.ratio, 1.37);
  const DrawnCapture once = drawCapture(3, {"defocus"}, DrawStrength::Weak),
                     twice = drawCapture(3, {"defocus"}, DrawStrength::Weak, 0, 2);
  EXPECT_NEAR(twice.options.effects.defocus.sigmaPx, 2 * once.options.effects.defocus.sigmaPx, 1e-12);
}

TEST(ClosingLoopDraw, AnUnknownEffectSwitchesNothingOn) {
  EXPECT_TRUE(drawCapture(3, {"magnetism"}, DrawStrength::Weak).options.effects.none());
}

// ---- the scores ----

LoopOutcome outcome(std::vector<std::string> truth, std::vector<std::string> named) {
  LoopOutcome o;
  o.kind = truth.empty() ? "clean" : truth.size() > 1 ? "pairs" : "strong";
  o.truth = std::move(truth), o.named = std::move(named);
  o.confidence.assign(o.named.size(), 0.95);
  return o;
}

TEST(ClosingLoopScores, TheFirstNameCounts) {
  EXPECT_TRUE(namedFirst(outcome({"glare"}, {"glare", "defocus"})));
  EXPECT_FALSE(namedFirst(outcome({"glare"}, {"defocus", "glare"})));
  EXPECT_FALSE(namedFirst(outcome({"glare"}, {})));
  EXPECT_TRUE(foundEffect(outcome({"glare"}, {"defocus", "glare"}), "glare"));
  EXPECT_TRUE(rightAnswer(outcome({}, {})));
  EXPECT_FALSE(rightAnswer(outcome({}, {"glare"})));
  EXPECT_TRUE(rightAnswer(outcome({"glare", "flicker"}, {"flicker", "glare"})));
  EXPECT_FALSE(rightAnswer(outcome({"glare", "flicker"}, {"flicker"})));
}

TEST(ClosingLoopScores, AGroupOfTwoCountsAndOneOfThreeDoesNot) {
  LoopOutcome o = outcome({"screen-pose"}, {"sample-height"});
  EXPECT_FALSE(namedFirst(o));
  o.confusable = {{"sample-height", "screen-pose"}};
  EXPECT_TRUE(namedFirst(o));
  o.confusable = {{"sample-height", "screen-pose", "anisotropy"}};
  EXPECT_FALSE(namedFirst(o));
  o.confusable = {{"glare", "screen-pose"}};
  EXPECT_FALSE(namedFirst(o)) << "a group that the first name isn't in";
}

TEST(ClosingLoopScores, AFailureIsNeverRight) {
  LoopOutcome o = outcome({}, {});
  o.failure = "out of memory";
  EXPECT_FALSE(rightAnswer(o));
  EXPECT_THAT(loopPage({o}, 1, "machine").markdown, testing::HasSubstr("0 of 1"));
}

TEST(ClosingLoopScores, TheMatrixCountsFirstNames) {
  const ConfusionMatrix matrix = confusionOf({outcome({"glare"}, {"glare"}), outcome({"glare"}, {"defocus"}),
                                              outcome({}, {}), outcome({"a", "b"}, {"a"})});
  EXPECT_EQ(matrix.count.at("glare").at("glare"), 1);
  EXPECT_EQ(matrix.count.at("glare").at("defocus"), 1);
  EXPECT_EQ(matrix.count.at("clean").at("nothing"), 1);
  EXPECT_EQ(matrix.count.size(), 2u) << "two effects have no single row";
  EXPECT_THAT(matrix.markdown(), testing::HasSubstr("**1**"));
}

TEST(ClosingLoopScores, WilsonsIntervalHoldsTheShare) {
  const Rate all{50, 50}, most{45, 50}, none{0, 0};
  EXPECT_NEAR(all.low(), 0.929, 1e-3);  // tables: 50 of 50 is above 0.929
  EXPECT_EQ(all.high(), 1);
  EXPECT_NEAR(most.low(), 0.786, 1e-3);
  EXPECT_NEAR(most.high(), 0.957, 1e-3);
  EXPECT_EQ(none.low(), 0);
}

TEST(ClosingLoopScores, CalibrationComparesConfidenceWithWhatWasRight) {
  std::vector<LoopOutcome> outcomes;
  for (int i = 0; i < 10; ++i) outcomes.push_back(outcome({"glare"}, {i < 9 ? "glare" : "defocus"}));
  const std::vector<CalibrationBin> bins = calibrationOf(outcomes);
  ASSERT_EQ(bins.size(), 1u);
  EXPECT_NEAR(bins[0].meanConfidence, 0.95, 1e-12);
  EXPECT_NEAR(bins[0].rate.share(), 0.9, 1e-12);
}

TEST(ClosingLoopScores, AnOutcomeGoesToAFileAndBack) {
  LoopOutcome o = outcome({"glare", "flicker"}, {"glare"}), back;
  o.seed = 71, o.field = "glare.share", o.strength = 0.25, o.confusable = {{"glare", "defocus"}},
  o.holdoutAfter = 0.01;
  o.failure = "what, now";
  ASSERT_TRUE(outcomeFromJson(outcomeJson(o), back));
  EXPECT_EQ(outcomeJson(back), outcomeJson(o));
  EXPECT_FALSE(outcomeFromJson(outcomeJson(o).substr(0, 60), back));
  EXPECT_FALSE(outcomeFromJson("{}", back));
}

TEST(ClosingLoopScores, ThePageMarksABoundThatIsMissed) {
  std::vector<LoopOutcome> good(20, outcome({"glare"}, {"glare"})), bad = good;
  for (int i = 0; i < 10; ++i) bad[static_cast<std::size_t>(i)].named = {"defocus"};
  EXPECT_EQ(loopPage(good, 1, "machine").markdown.find("**missed**"), std::string::npos);
  EXPECT_NE(loopPage(bad, 1, "machine").markdown.find("**missed**"), std::string::npos);
}

TEST(ClosingLoopScores, CurvesNeedTwoStrengths) {
  std::vector<LoopOutcome> outcomes;
  for (const double factor : {0.5, 1.0, 2.0}) {
    LoopOutcome o = outcome({"glare"}, {"glare"});
    o.kind = "curve", o.factor = factor;
    outcomes.push_back(o);
  }
  const LoopPage page = loopPage(outcomes, 1, "machine");
  ASSERT_TRUE(page.charts.contains("closing_loop_detection.svg"));
  EXPECT_THAT(page.charts.at("closing_loop_detection.svg"), testing::HasSubstr("lens"));
}

}  // namespace
}  // namespace patina::test
