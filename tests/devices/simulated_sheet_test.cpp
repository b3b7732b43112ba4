#include "devices/simulated/simulated_sheet.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "devices/simulated/simulated_rig.h"
#include "engine/surface/svbrdf.h"

namespace patina {
namespace {

TEST(SimulatedScenes, AreUsableAndShowEveryMaterial) {
  ASSERT_GE(simulatedSceneNames().size(), 3u);
  for (const std::string& name : simulatedSceneNames()) {
    const SimulatedSheet sheet = simulatedScene(name);
    EXPECT_EQ(sheet.name, name);
    EXPECT_TRUE(sheet.validate().empty()) << name;
    EXPECT_FALSE(simulatedSceneSummary(name).empty()) << name;
    const SheetSampler sampler(sheet);
    std::set<int> seen;
    for (int j = 0; j < 64; ++j)
      for (int i = 0; i < 64; ++i)
        seen.insert(sampler.materialAt((i / 63.0 - 0.5) * sheet.widthMm, (j / 63.0 - 0.5) * sheet.heightMm));
    EXPECT_EQ(seen.size(), sheet.materials.size()) << name;
  }
}

TEST(SimulatedScenes, UnknownNameIsRefusedByValidation) {
  EXPECT_FALSE(simulatedScene("granite").validate().empty());
}

TEST(SheetSampler, NormalsAreUnitAndAsRoughAsAsked) {
  for (const std::string& name : simulatedSceneNames()) {
    const SimulatedSheet sheet = simulatedScene(name);
    const SheetSampler sampler(sheet);
    double squares = 0;
    int count = 0;
    for (double y = -150; y <= 150; y += 5)  // farther than the sheet: its own 120 mm hold few waves
      for (double x = -150; x <= 150; x += 5, ++count) {
        const Eigen::Vector3d n = sampler.at(x, y).normal;
        ASSERT_NEAR(n.norm(), 1, 1e-12);
        squares += 0.5 * (n.x() * n.x() + n.y() * n.y()) / (n.z() * n.z());
      }
    EXPECT_NEAR(std::sqrt(squares / count), sheet.slopeRms, 0.25 * sheet.slopeRms)
        << name;  // seven random waves
  }
}

TEST(SheetSampler, ReliefComesFromAHeightField) {
  // The slopes' curl vanishes: d(p)/dy = d(q)/dx.
  const SimulatedSheet sheet = simulatedScene("laminate");
  const SheetSampler sampler(sheet);
  const auto slope = [&](double x, double y) {
    const Eigen::Vector3d n = sampler.at(x, y).normal;
    return Eigen::Vector2d(n.x() / n.z(), n.y() / n.z());
  };
  constexpr double h = 1e-3;
  for (double x : {-40.0, 3.0, 31.0})
    for (double y : {-22.0, 17.0}) {
      const double pAlongY = (slope(x, y + h).x() - slope(x, y - h).x()) / (2 * h);
      const double qAlongX = (slope(x + h, y).y() - slope(x - h, y).y()) / (2 * h);
      EXPECT_NEAR(pAlongY, qAlongX, 1e-8);
    }
}

TEST(SheetSampler, SameSeedSameSheet) {
  SimulatedSheet sheet = simulatedScene("laminate");
  const SheetPoint first = SheetSampler(sheet).at(12.3, -4.5), again = SheetSampler(sheet).at(12.3, -4.5);
  EXPECT_EQ(first.normal, again.normal);
  sheet.seed += 1;
  EXPECT_NE(first.normal, SheetSampler(sheet).at(12.3, -4.5).normal);
}

TEST(SheetTruth, LaysOutMapsAsTheFitDoes) {
  SimulatedSheet sheet = simulatedScene("cardstock");
  sheet.heightMm = 60;
  const SheetTruth truth = sheetTruth(sheet, 24, 12, 1);
  const SheetPoint topLeft = SheetSampler(sheet).at(-57.5, 27.5);  // row 0 at +y, column 0 at -x
  EXPECT_FLOAT_EQ(truth.sigma.at(0, 0), static_cast<float>(topLeft.sigma));
  EXPECT_FLOAT_EQ(truth.normal.at(0, 0, 1), static_cast<float>(topLeft.normal.y()));
  int borders = 0;
  for (float m : truth.material.samples()) borders += m < 0;
  EXPECT_GT(borders, 0);
  EXPECT_LT(borders, 24 * 12);
}

}  // namespace
}  // namespace patina
