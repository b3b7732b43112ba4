// The accuracy bounds of the clean bundles, held for every instruction set that this machine has. The bundle
// is chosen by the build.
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>

#include "engine/fourier/solver.h"
#include "tests/fourier/clean_bounds.h"

namespace patina::test {
namespace {

class EveryInstructionSet : public testing::TestWithParam<std::int64_t> {
 protected:
  // All kernels of the engine ask the same place which instruction set to use.
  static void choose(std::int64_t target) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  void TearDown() override { choose(0); }
};

TEST_P(EveryInstructionSet, KeepsTheBoundsOfACleanBundle) {
  const CleanBounds& bounds = PATINA_TARGETS_BUNDLE;
  PATINA_NEEDS_SHARED("fourier/" + std::string(bounds.bundle));
  choose(GetParam());
  ASSERT_STREQ(solverTarget(), hwy::TargetName(GetParam())) << "the instruction set was not chosen";
  expectWithinBounds(bounds);
}

INSTANTIATE_TEST_SUITE_P(PATINA_TARGETS_NAME, EveryInstructionSet,
                         testing::ValuesIn(hwy::SupportedAndGeneratedTargets()), [](const auto& info) {
                           std::string name = hwy::TargetName(info.param);
                           std::replace_if(
                               name.begin(), name.end(), [](char c) { return !std::isalnum(c); }, '_');
                           return name;
                         });

}  // namespace
}  // namespace patina::test
