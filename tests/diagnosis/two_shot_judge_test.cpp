#include "engine/diagnosis/two_shot_judge.h"

#include <gtest/gtest.h>

#include <cmath>

#include "engine/diagnosis/two_shot_odds.h"
#include "engine/twoshot/smooth_correction.h"

// Which evidence is enough, and the free-form correction that is tried when none has a name.
namespace patina {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180;
constexpr JudgedBy kFirst{20, 0.01, 0, 0};

/// Overwhelming evidence for an effect of the set-up.
TwoShotEvidence plain() {
  TwoShotEvidence e;
  e.id = "sample-tilt";
  e.refined = e.held = true;
  e.lnEvidence = 200, e.lnHeld = 150, e.reach = 0.2;
  e.fitRatio = 0.4, e.heldRatio = 0.5, e.heldBetter = 1, e.heldWorst = 0.8;
  e.grain = 0.01, e.fine = 0.03, e.broad = 0.08;
  return e;
}

/// A lobe that the photographs plainly show: what drawn retroreflections did to the reconstruction's errors.
TwoShotEvidence plainLobe(const char* id) {
  TwoShotEvidence e = plain();
  e.id = id, e.surface = e.lobe = true;
  e.fitRatio = 0.12, e.heldRatio = 0.25;
  return e;
}

TEST(TwoShotJudge, OverwhelmingEvidenceIsEnough) {
  const TwoShotVerdict verdict = judge(plain(), kFirst);
  EXPECT_TRUE(verdict.passes);
  EXPECT_TRUE(verdict.answers);
  EXPECT_GT(verdict.gain, 3);  // ln odds of twenty to one
}

TEST(TwoShotJudge, HeldOutPhotographsMayRefuse) {
  TwoShotEvidence e = plain();
  e.lnHeld = -40, e.heldRatio = 0.9;
  EXPECT_FALSE(judge(e, kFirst).passes);
  e.heldRatio = 0.5;
  EXPECT_TRUE(judge(e, kFirst).passes) << "pictures that are plainly better outweigh a process' tight bounds";
  e = plain();
  e.heldRatio = 1.4;
  EXPECT_FALSE(judge(e, kFirst).passes);
}

TEST(TwoShotJudge, ChanceIsNotEnough) {
  TwoShotEvidence e = plain();
  e.lnEvidence = 6, e.lnHeld = 3;
  EXPECT_FALSE(judge(e, kFirst).passes);
}

TEST(TwoShotJudge, SurroundingsMayRefuse) {
  TwoShotEvidence e = plain();
  e.lnAround = -30;
  EXPECT_FALSE(judge(e, kFirst).passes);
}

TEST(TwoShotJudge, WhatAnotherExplainsOfTheSurroundingsMustBeExplained) {
  TwoShotEvidence e = plain();
  JudgedBy by = kFirst;
  by.around = 200;
  EXPECT_FALSE(judge(e, by).passes);
  e.lnAround = 190;
  EXPECT_TRUE(judge(e, by).passes);
}

TEST(TwoShotJudge, TheWholeReconstructionHasTheLastWord) {
  TwoShotEvidence e = plain();
  TwoShotVerdict verdict = judge(e, kFirst);
  e.wholeRatio = 0.8;
  verifyWhole(e, verdict);
  EXPECT_TRUE(verdict.passes);
  e.wholeRatio = 1.05;
  verifyWhole(e, verdict);
  EXPECT_FALSE(verdict.passes);
  verdict = judge(e, kFirst);
  e.wholeRatio = 0.9, e.wholeSumRatio = 1.2;
  verifyWhole(e, verdict);
  EXPECT_FALSE(verdict.passes) << "one photograph's gain pays for the others' loss";
}

TEST(TwoShotJudge, ALobeThatHeldOutPhotographsDontSeeIsDecidedByTheFittedOnes) {
  TwoShotEvidence e = plainLobe("retroreflection");
  TwoShotVerdict verdict = judge(e, kFirst);
  e.wholeRatio = e.wholeSumRatio = 0.98, e.wholeFitRatio = 0.4;
  verifyWhole(e, verdict);
  EXPECT_TRUE(verdict.passes);
  e.wholeFitRatio = 0.8;
  verifyWhole(e, verdict);
  EXPECT_FALSE(verdict.passes);
}

TEST(TwoShotJudge, AStrengthThatMakesNoSenseIsRefused) {
  TwoShotEvidence e = plain();
  e.sensible = false;
  EXPECT_FALSE(judge(e, kFirst).passes);
}

TEST(TwoShotJudge, ALobeMustServeTheReconstruction) {
  TwoShotEvidence e = plainLobe("clearcoat");
  EXPECT_TRUE(judge(e, kFirst).passes);
  e.heldRatio = 1;
  EXPECT_FALSE(judge(e, kFirst).passes) << "held-out photographs gain nothing";
  e = plainLobe("clearcoat");
  e.fitRatio = 0.95;
  EXPECT_FALSE(judge(e, kFirst).passes) << "fitted photographs gain nothing";
}

TEST(TwoShotJudge, AFreeCorrectionNeedsHeldOutPhotographs) {
  TwoShotEvidence e = plain();
  e.id = "basis-deviation", e.surface = e.lobe = e.free = true;
  EXPECT_TRUE(judge(e, kFirst).passes);
  e.held = false;
  EXPECT_FALSE(judge(e, kFirst).passes);
  e.held = true, e.heldBetter = 0.5;
  EXPECT_FALSE(judge(e, kFirst).passes) << "half of the photographs gain, half lose";
}

TEST(TwoShotOdds, ProbabilitiesLeaveTheirShareToNothing) {
  const std::vector<double> p = probabilitiesOf({0, std::log(2.0)});
  ASSERT_EQ(p.size(), 2u);
  EXPECT_NEAR(p[0], 0.25, 1e-12);
  EXPECT_NEAR(p[1], 0.5, 1e-12);
}

TEST(TwoShotOdds, WeightsThatAreFittedAreCalibrated) {
  // Two answers with one feature each: 300 captures where the first is right as often as a weight of 2 says.
  std::vector<WeighedCapture> captures;
  for (int i = 0; i < 300; ++i) {
    WeighedCapture capture;
    EvidenceFeatures x = EvidenceFeatures::Zero();
    x[7] = i % 3 - 1;
    capture.tried = {x};
    const double p = 1 / (1 + std::exp(-2 * x[7]));
    capture.right = {static_cast<char>((i / 3) % 100 < 100 * p)};
    captures.push_back(capture);
  }
  const EvidenceFeatures w = fitEvidenceWeights(captures, EvidenceFeatures::Zero(), 10);
  // A hundred captures of each kind, rounded to whole ones.
  EXPECT_NEAR(w[7], 2, 0.15);
  EXPECT_NEAR(w[0], 0, 1e-9);
}

TEST(SmoothCorrection, IsTheProcessAnswerWhereItWasLearntAndNothingFarAway) {
  // One row, at a thetaH of 12 and a thetaD of 20 degrees.
  BasisDeviation sizes;
  sizes.brightness = {0.01, 0.05, 0.2}, sizes.colour = {0.01, 0.02, 0.05};
  const HalfDiffAngles at{12 * kDegree, 20 * kDegree, 70 * kDegree};
  Eigen::MatrixXd place(1, 3), weight(1, 3);
  place.row(0) = smoothPlace(at);
  weight << 3, -1, 2;
  const SmoothCorrection correction(place, weight, sizes);
  Eigen::RowVector3d mixed = weight.row(0);
  mixed[0] *= 0.05 * 0.05 + 0.2 * 0.2;
  mixed.tail<2>() *= 0.02 * 0.02 + 0.05 * 0.05;
  const Eigen::RowVector3d expected = mixed * channelCombinations();
  const Eigen::Array3d found = correction.lnFactor(at);
  // The table is linear between its nodes, half a reach of the fine deviations apart.
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(found[c], expected[c], 0.1 * expected.norm());
  const Eigen::Array3d far = correction.lnFactor({75 * kDegree, 85 * kDegree, 0});
  EXPECT_LT(far.abs().maxCoeff(), 0.01 * expected.norm());
}

}  // namespace
}  // namespace patina
