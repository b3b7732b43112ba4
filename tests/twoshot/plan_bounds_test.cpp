// The search on the built-in basis, within the bounds that an independent implementation sets.
#include <gtest/gtest.h>

#include <cstdio>
#include <numbers>

#include "engine/twoshot/plan.h"

namespace patina {
namespace {

class PlanBounds : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    Result<BasisPtr> built = builtInBasis({});
    ASSERT_TRUE(built.ok()) << built.error().sentence();
    basis_ = *built;
  }
  /// Error that the search itself reached (150 points a picture), as the bounds are stated.
  static double reached(const PlanOptions& options, Plan* out = nullptr) {
    const Result<Plan> plan = planDirections(basis_, options, {});
    EXPECT_TRUE(plan.ok());
    if (!plan) return 1e9;
    double best = 1e9;
    for (const double error : plan->restartErrors) best = std::min(best, error);
    std::printf("search %.4f; with 300 points: training %.4f, left out %.4f (worst tenth %.4f), %.1f s\n",
                best, plan->expected.training, plan->expected.unseen, plan->expected.unseenWorstTenth,
                plan->seconds);
    if (out) *out = *plan;
    return best;
  }
  static BasisPtr basis_;
};
BasisPtr PlanBounds::basis_;

TEST_F(PlanBounds, OnePhotograph) {
  PlanOptions options;
  options.shots = 1;
  EXPECT_LE(reached(options), 0.345);
}

TEST_F(PlanBounds, TwoPhotographs) {
  Plan plan;
  EXPECT_LE(reached(PlanOptions{}, &plan), 0.207);
  // Ours: the left-out materials of the built-in basis, all 100 of them.
  EXPECT_LE(plan.expected.unseen, 0.26);
}

TEST_F(PlanBounds, FivePointSamples) {
  PlanOptions options;
  options.fovDeg = 0;
  options.shots = 5;
  options.restarts = 4;
  EXPECT_LE(reached(options), 0.27);
}

TEST_F(PlanBounds, TwentyPointSamples) {
  PlanOptions options;
  options.fovDeg = 0;
  options.shots = 20;
  options.restarts = 1;
  EXPECT_LE(reached(options), 0.155);
}

TEST_F(PlanBounds, FixedCamera) {
  PlanOptions options;
  options.setup = PlanSetup::FixedCamera;
  EXPECT_LE(reached(options), 0.27);
}

TEST_F(PlanBounds, FixedLight) {
  PlanOptions options;
  options.setup = PlanSetup::FixedLight;
  EXPECT_LE(reached(options), 0.275);  // ours; the other implementation is 3 % worse here than for the camera
}

}  // namespace
}  // namespace patina
