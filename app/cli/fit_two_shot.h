#pragma once

#include <string>

#include "app/cli/verbs.h"
#include "engine/twoshot/fit.h"

namespace patina::cli {

/// Options of `fit` that hold for two-shot bundles only, as they were typed.
struct TwoShotArguments {
  std::string basis, eta = "40", clusters = "1";
  bool noNoiseWeights = false;
  int rowsPerShot = TwoShotFitOptions{}.rowsPerShot;
};

/// Fits the two-shot bundle, writes the results and the pictures to `out`, tells the figures. Returns an
/// ExitStatus.
int runTwoShotFit(const std::string& bundle, const std::string& out, const TwoShotArguments& arguments,
                  Context& context);

}  // namespace patina::cli
