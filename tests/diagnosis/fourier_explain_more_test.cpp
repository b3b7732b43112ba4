#include <gtest/gtest.h>

#include "tests/diagnosis/explained_bundles.h"

// The slower ones of the shared bundles: measured materials, and bundles explained together.
namespace patina::test {
namespace {

TEST(ExplainFourierSlow, SeesAScreenWarmUpThroughMaterialsThatTheLobeDoesNotFollow) {
  PATINA_NEEDS_SHARED("fourier/unknown_6");
  const ExplanationPtr e = explained({"unknown_6"});
  EXPECT_EQ(firstOf(*e), "screen-drift");
  // The drift is most of that error: the same materials without it leave a third (measured_satin_dragoneye).
  EXPECT_LT(e->after.holdoutRms, 0.5 * e->before.holdoutRms);
}

TEST(ExplainFourierSlow, TwoViewsOfASheetShareAnUnevenScreen) {
  PATINA_NEEDS_SHARED("fourier/unknown_7_view_2");
  EXPECT_EQ(firstOf(*explained({"unknown_7_view_1", "unknown_7_view_2"})), "emission-spatial");
}

TEST(ExplainFourierSlow, AWhitePaperUnderTheSameScreenShowsItsEmission) {
  PATINA_NEEDS_SHARED("fourier/unknown_8_paper");
  EXPECT_EQ(firstOf(*explained({"unknown_8", "unknown_8_paper"})), "emission-angular");
}

TEST(ExplainFourierSlow, AddsNothingToCleanSheets) {
  PATINA_NEEDS_SHARED("fourier/clean_laminate");
  for (const char* bundle : {"clean_laminate", "clean_cardstock"})
    EXPECT_EQ(firstOf(*explained({bundle})), "");
}

}  // namespace
}  // namespace patina::test
