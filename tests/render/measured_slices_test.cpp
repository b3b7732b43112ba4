#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "engine/render/brdf_slices.h"
#include "tests/base/temp_folder.h"
#include "tests/render/measured_material.h"

namespace patina {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

TEST(ThetaHAxis, GoesThereAndBack) {
  for (const ThetaHAxis axis : {ThetaHAxis::Root, ThetaHAxis::Even})
    for (const double part : {0.0, 0.1, 0.5, 1.0})
      EXPECT_NEAR(partOfThetaH(thetaHDegAt(part, axis), axis), part, 1e-12);
  EXPECT_NEAR(thetaHDegAt(0.5, ThetaHAxis::Root), 22.5, 1e-12);
  EXPECT_NEAR(thetaHDegAt(0.5, ThetaHAxis::Even), 45, 1e-12);
}

/// Grows with thetaH in red, with thetaD in green.
std::shared_ptr<const TabulatedBrdf> angular() {
  return test::tabulated([](const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) {
    const HalfDiffAngles angles = halfDiffFromDirections(toLight, toView);
    return Eigen::Array3d(1 + angles.thetaHRad, 1 + angles.thetaDRad, 0.5);
  });
}

TEST(SliceCurve, HoldsTheBrdfAndItsDeviation) {
  std::vector<float> sd(MerlGrid::kCells, 0.25f);
  const auto curve = sliceCurve(*angular(), &sd, 30);
  ASSERT_EQ(curve.size(), 90u);
  for (const SlicePoint& point : curve) {
    EXPECT_NEAR(point.brdf[0], 1 + point.thetaHDeg * kDegree, 2e-3);
    EXPECT_NEAR(point.brdf[1], 1 + 30 * kDegree, 2e-3);
    EXPECT_NEAR(point.sd, 0.25, 1e-6);
  }
  EXPECT_EQ(sliceCurve(*angular(), nullptr, 30)[10].sd, -1);
  // Beside phiD = 90 degrees light or eye go below the surface.
  EXPECT_TRUE(std::isnan(sliceCurve(*angular(), nullptr, 80, 0)[85].brdf[0]));
}

TEST(BrdfSlice, HasThetaHAcrossAndThetaDUp) {
  const Image slice = brdfSlice(*angular(), 90, 90, ThetaHAxis::Even);
  EXPECT_LT(slice.at(5, 45, 0), slice.at(80, 45, 0));
  EXPECT_NEAR(slice.at(44, 45, 0), 1 + 44.5 * kDegree, 0.01);
  EXPECT_GT(slice.at(45, 5, 1), slice.at(45, 80, 1)) << "thetaD = 90 degrees is the top row";
  const Image stretched = brdfSlice(*angular(), 90, 90, ThetaHAxis::Root);
  EXPECT_LT(stretched.at(44, 45, 0), slice.at(44, 45, 0));
}

TEST(PosteriorSdAt, LeavesUnknownCellsOut) {
  std::vector<float> sd(MerlGrid::kCells, -1.0f);
  const HalfDiffAngles angles{10 * kDegree, 20 * kDegree, 30 * kDegree};
  EXPECT_EQ(posteriorSdAt(sd, angles), -1);
  const Eigen::Vector3d at = MerlGrid::coordinates(angles);
  sd[MerlGrid::cell(static_cast<int>(at.x()), static_cast<int>(at.y()), static_cast<int>(at.z()))] = 0.4f;
  EXPECT_NEAR(posteriorSdAt(sd, angles), 0.4, 1e-6);
  EXPECT_THROW(posteriorSdAt({}, angles), std::invalid_argument);
  const Image picture = sdSlice(sd, 90, 90, ThetaHAxis::Even, 30);
  EXPECT_NEAR(*std::max_element(picture.samples().begin(), picture.samples().end()), 0.4, 1e-6);
}

TEST(SlicesCsv, HasALineForEachAngleAndNothingWhereNothingIsKnown) {
  const test::TempFolder folder;
  const auto file = folder.path() / "slices.csv";
  std::vector<float> sd(MerlGrid::kCells, -1.0f);
  ASSERT_TRUE(writeSlicesCsv(file, *angular(), &sd, {0, 45}).ok());
  std::ifstream in(file);
  std::string comment, header, line;
  std::getline(in, comment);
  std::getline(in, header);
  EXPECT_EQ(comment.front(), '#');
  EXPECT_EQ(header, "theta_d_deg,theta_h_deg,phi_d_deg,R,G,B,sd_ln");
  int lines = 0;
  while (std::getline(in, line)) {
    ++lines;
    EXPECT_EQ(std::count(line.begin(), line.end(), ','), 6);
    EXPECT_EQ(line.back(), ',') << "an unknown deviation is empty";
  }
  EXPECT_EQ(lines, 180);
  EXPECT_FALSE(writeSlicesCsv(folder.path() / "no folder" / "slices.csv", *angular(), nullptr, {0}).ok());
}

}  // namespace
}  // namespace patina
