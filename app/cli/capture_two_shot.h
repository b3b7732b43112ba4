#pragma once

#include <string>

#include "app/cli/verbs.h"

namespace patina::cli {

struct TwoShotCaptureArguments {
  std::string camera, out, plan;
  bool resume = false;
};
/// A two-shot capture with the simulated rig and a simulated operator, who aims a little beside the plan.
int runTwoShotCapture(const TwoShotCaptureArguments& arguments, Context& context);

}  // namespace patina::cli
