#pragma once

#include <filesystem>
#include <memory>

#include "app/window/services.h"

namespace patina::test {

/// Takes a two-shot bundle with the simulated rig: two shots, one held out, a white tile for each; `pixels`
/// across. `sheet`: a rectangle under one camera, of two materials.
void simulateTwoShotBundle(const std::filesystem::path& folder, int pixels = 48, bool sheet = false);

/// A reconstruction with made-up but consistent answers, for tests of the window alone: predictions are the
/// photographs, 20 % brighter; the material is a GGX one. No basis.
std::shared_ptr<const TwoShotFit> fakeTwoShotFit(const TwoShotCapture& capture,
                                                 const TwoShotFitOptions& options = {}, int materials = 1,
                                                 bool cancelled = false);

/// The engine's services, with a fake reconstruction that takes `delayMs` and polls stop, and a fake search
/// for directions of the same length.
Services fakeTwoShotServices(int delayMs = 0, int materials = 1);

}  // namespace patina::test
