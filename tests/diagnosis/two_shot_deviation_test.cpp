#include <gtest/gtest.h>

#include <cmath>

#include "engine/brdf/half_diff.h"
#include "engine/diagnosis/two_shot_search.h"
#include "engine/twoshot/deviation.h"

// What an assumed set-up does to a photograph and back, and the arithmetic of the score test.
namespace patina {
namespace {

constexpr double kRounding = 1e-9;

PhotoPoint somewhere() {
  PhotoPoint point;
  point.shot = 1;
  point.toLight = Eigen::Vector3d(0.3, -0.2, 0.9).normalized();
  point.cameraMm = {-120, 90, 250};
  point.positionMm = {20, -35};
  point.cornerShare = 0.4;
  point.rate = {2.1, 1.9, 1.4};
  point.exposureS = 0.5;
  return point;
}

TwoShotDeviation everything() {
  TwoShotDeviation d;
  d.tiltDeg = {1.5, -0.7};
  d.heightMm = 3;
  d.lightPerM = 1.2, d.whiteLitAlike = false;
  d.vignetting = 0.3;
  d.stray.assign(3, Eigen::Array3d(0.01, 0.02, 0.03));
  d.lnGain = {0, 0.2, 0};
  d.blackLevel = {0.001, 0.002, 0.001};
  d.lnResponse = -0.05, d.responseTop = 2;
  d.crosstalk = 0.04;
  d.coat = CoatLobe{0.8, 0.2};
  d.sheen = 0.1, d.fresnel = 0.3;
  d.tint << 0.2, -0.1, 0.05, 0.3;
  return d;
}

TEST(TwoShotDeviation, WhatIsPutInIsTakenOut) {
  const TwoShotDeviation d = everything();
  const PhotoPoint point = somewhere();
  const DirectionPair pair = d.directions(point);
  const Eigen::Array3d base(0.4, 0.2, 0.1),
      back = d.baseFromSeen(d.seenFromBase(base, point, pair), point, pair);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(back[c], base[c], kRounding);
}

TEST(TwoShotDeviation, SlopeIsTheDerivative) {
  const TwoShotDeviation d = everything();
  const PhotoPoint point = somewhere();
  const DirectionPair pair = d.directions(point);
  const Eigen::Array3d seen(0.5, 0.4, 0.3);
  Eigen::Array3d slope;
  d.baseFromSeen(seen, point, pair, &slope);
  const double step = 1e-6;
  for (int c = 0; c < 3; ++c) {
    Eigen::Array3d more = seen, less = seen;
    more[c] += step, less[c] -= step;
    const double expected =
        (d.baseFromSeen(more, point, pair)[c] - d.baseFromSeen(less, point, pair)[c]) / (2 * step);
    EXPECT_NEAR(slope[c], expected, 1e-5 * std::abs(expected));
  }
}

TEST(TwoShotDeviation, NothingIsNothing) {
  const TwoShotDeviation none;
  EXPECT_TRUE(none.none());
  EXPECT_FALSE(everything().none());
  const PhotoPoint point = somewhere();
  const DirectionPair pair = none.directions(point);
  EXPECT_EQ(none.seenFromBase({0.3, 0.2, 0.1}, point, pair)[1], 0.2);
  EXPECT_NEAR((pair.toLight - point.toLight).norm(), 0, kRounding);
}

TEST(TwoShotDeviation, TiltTurnsTheMirrorDirectionTwice) {
  // A sample whose normal leans by 2 degrees towards +x sends the light of the zenith 4 degrees towards +x.
  TwoShotDeviation d;
  d.tiltDeg = {0, 2};
  PhotoPoint point;
  const double angle = 4 * M_PI / 180;
  point.cameraMm = 300 * Eigen::Vector3d(std::sin(angle), 0, std::cos(angle));
  EXPECT_NEAR(d.angles(d.directions(point)).thetaHRad, 0, 1e-8);
}

TEST(TwoShotDeviation, BlurKeepsTheSum) {
  Image image(64, 64, 3);
  for (int c = 0; c < 3; ++c) image.at(32, 30, c) = 1;
  for (const double sigma : {1.0, 4.0}) {
    const Image blurred = blurredImage(image, sigma);
    double sum = 0, squares = 0;
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x)
        sum += blurred.at(x, y, 1), squares += blurred.at(x, y, 1) * (x - 32) * (x - 32);
    EXPECT_NEAR(sum, 1, 1e-4);
    // Three running means come within 10 % of the variance asked for.
    EXPECT_NEAR(squares, sigma * sigma, 0.1 * sigma * sigma);
  }
}

TEST(ChiSquaredTail, KnownQuantiles) {
  // 5 % quantiles of the tables.
  EXPECT_NEAR(chiSquaredTail(3.841, 1), 0.05, 1e-4);
  EXPECT_NEAR(chiSquaredTail(5.991, 2), 0.05, 1e-4);
  EXPECT_NEAR(chiSquaredTail(7.815, 3), 0.05, 1e-4);
  EXPECT_NEAR(chiSquaredTail(14.067, 7), 0.05, 1e-4);
  EXPECT_EQ(chiSquaredTail(0, 4), 1);
}

}  // namespace
}  // namespace patina
