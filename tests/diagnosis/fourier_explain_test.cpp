#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "engine/diagnosis/fourier_suggest.h"
#include "tests/diagnosis/explained_bundles.h"

namespace patina::test {
namespace {

// What the tests know of the shared bundles is in their truth files; the program never reads those.

const EffectFinding* added(const Explanation& explanation, const std::string& id) {
  for (const auto& effect : explanation.effects)
    if (effect.id == id) return &effect;
  return nullptr;
}

double parameter(const EffectFinding& finding, const std::string& name, std::size_t skip = 0) {
  for (const auto& p : finding.parameters)
    if (p.name == name && skip-- == 0) return p.value;
  return std::nan("");
}

TEST(ExplainFourier, AddsNothingToACaptureWithoutEffects) {
  PATINA_NEEDS_SHARED("fourier/unknown_4");
  const ExplanationPtr e = explained({"unknown_4"});
  EXPECT_TRUE(e->effects.empty()) << e->effects.front().id;
  EXPECT_DOUBLE_EQ(e->before.holdoutRms, e->after.holdoutRms);
  EXPECT_LT(e->chi2Before, 1.05);
  EXPECT_GT(e->budget.size(), 15u);
}

TEST(ExplainFourier, FindsBrushedHighlightsWithRatioAndDirection) {
  PATINA_NEEDS_SHARED("fourier/unknown_1");
  const ExplanationPtr e = explained({"unknown_1"});
  ASSERT_FALSE(e->effects.empty());
  EXPECT_EQ(e->effects.front().id, "anisotropy");
  EXPECT_NEAR(parameter(e->effects.front(), "ratio"), 2.2, 0.12);   // 2.2 in the truth
  EXPECT_NEAR(parameter(e->effects.front(), "angleDeg"), 30, 1.5);  // 30 in the truth
  EXPECT_LT(e->after.holdoutRms, 1.1 * e->noiseFloorHoldout);       // 1.88 times before
  EXPECT_GT(e->before.holdoutRms, 1.8 * e->noiseFloorHoldout);
}

TEST(ExplainFourier, FindsTwoEffectsAtOnceOneOfThemInOneMaterial) {
  PATINA_NEEDS_SHARED("fourier/unknown_5");
  const ExplanationPtr e = explained({"unknown_5"});
  const EffectFinding* flicker = added(*e, "flicker");
  const EffectFinding* anisotropy = added(*e, "anisotropy");
  ASSERT_TRUE(flicker);
  ASSERT_TRUE(anisotropy);
  EXPECT_EQ(e->effects.size(), 2u);
  EXPECT_NEAR(parameter(*flicker, "perPhoto"), 0.012, 0.002);
  double most = 0;
  for (const auto& p : anisotropy->parameters)
    if (p.name == "ratio") most = std::max(most, p.value);
  EXPECT_NEAR(most, 1.7, 0.1);
}

TEST(ExplainFourier, NamesAnUnevenScreen) {
  PATINA_NEEDS_SHARED("fourier/unknown_7_view_1");
  const ExplanationPtr e = explained({"unknown_7_view_1"});
  ASSERT_FALSE(e->effects.empty());
  EXPECT_EQ(e->effects.front().id, "emission-spatial");
}

TEST(ExplainFourier, SeesALensOutOfFocusBesideBorders) {
  PATINA_NEEDS_SHARED("fourier/unknown_2");
  const ExplanationPtr e = explained({"unknown_2"});
  ASSERT_FALSE(e->effects.empty());
  EXPECT_EQ(e->effects.front().id, "defocus");
  // One pixel in the truth; the pictures that it is predicted from are blurred already.
  EXPECT_NEAR(parameter(e->effects.front(), "sigmaPx"), 0.7, 0.35);
}

TEST(ExplainFourier, FindsHorizonsOfSinglePlaces) {
  PATINA_NEEDS_SHARED("fourier/unknown_3");
  const ExplanationPtr e = explained({"unknown_3"});
  ASSERT_FALSE(e->effects.empty());
  const EffectFinding& found = e->effects.front();
  EXPECT_EQ(found.id, "self-shadowing");
  EXPECT_GT(e->before.holdoutRms, 1.4 * e->noiseFloorHoldout);
  EXPECT_LT(e->after.holdoutRms, 1.15 * e->noiseFloorHoldout);
  // A quarter of its points is predicted worse than 1.5 times the noise by a fit without; three quarters see
  // the whole screen.
  const double share = parameter(found, "share");
  EXPECT_GT(share, 0.05);
  EXPECT_LT(share, 0.4);
  ASSERT_TRUE(found.maps.contains("horizon_deg"));
}

TEST(ExplainFourier, SuggestsWhatSeparatesAndSaysWhereNothingDoes) {
  PATINA_NEEDS_SHARED("fourier/unknown_7_view_1");
  const auto capture = readFourierCapture(sharedData() / "fourier" / "unknown_7_view_1", {});
  ASSERT_TRUE(capture);
  auto fit = fitFourier(*capture, {}, {});
  ASSERT_TRUE(fit);
  auto laid = diagnosisCapture(*fit, 150, {});
  ASSERT_TRUE(laid);
  std::vector<DiagnosisCapture> captures;
  captures.push_back(std::move(*laid));
  DiagnosisSession session(std::move(captures));
  refineSession(session, 3, {});
  const ScoreTest test = scoreSession(session, {}, {});
  // No photograph tells an effect from itself.
  const Suggestion same = suggestCapture(session, test, "emission-spatial", "emission-spatial", {});
  EXPECT_LT(same.separationSigmas, 5);
  // A screen that is uneven over its surface, or over the angle: some capture tells more than none.
  const Suggestion screen = suggestCapture(session, test, "emission-spatial", "emission-angular", {});
  EXPECT_GT(screen.separationSigmas, same.separationSigmas);
  EXPECT_FALSE(screen.capture.empty());
}

TEST(ExplainFourier, StopsSoonWhenAsked) {
  PATINA_NEEDS_SHARED("fourier/unknown_4");
  std::stop_source stop;
  stop.request_stop();
  JobContext job;
  job.stop = stop.get_token();
  const auto result = explain({sharedData() / "fourier" / "unknown_4"}, {}, job);
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::Cancelled);
}

TEST(ExplainFourier, SaysWhatIsWrongWithItsOptions) {
  ExplainOptions options;
  options.testedTexels = 3;
  const auto result = explain({"nowhere"}, options, {});
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().what.find("testedTexels"), std::string::npos);
}

}  // namespace
}  // namespace patina::test
