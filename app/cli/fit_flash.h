#pragma once

#include <string>

#include "app/cli/verbs.h"
#include "engine/flash/fit.h"

namespace patina::cli {

/// Options of `fit` that hold for flash bundles, as they were typed.
struct FlashArguments {
  int size = 0;
  int materials = FlashFitOptions{}.materials;
  std::string effects = "none";
};

/// Fits the flash bundle, writes the maps to `out`, tells the figures. Returns an ExitStatus.
int runFlashFit(const std::string& bundle, const std::string& out, const FlashArguments& arguments,
                Context& context);

}  // namespace patina::cli
