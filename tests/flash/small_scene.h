#pragma once

#include "devices/simulated/flash_rig.h"

namespace patina::test {

/// Two materials in spots, nine photographs, two of them held out; small, so that a fit takes seconds.
inline FlashScene smallFlashScene(std::uint64_t seed = 1) {
  FlashScene scene;
  scene.sheet.widthMm = scene.sheet.heightMm = 68;
  scene.sheet.pattern = SheetPattern::Spots;
  scene.sheet.periodMm = 25, scene.sheet.reliefPeriodMm = 15;
  scene.sheet.sigmaVariation = 0;
  scene.sheet.seed = seed;
  scene.sheet.materials = {{{0.30, 0.10, 0.05}, {0.04, 0.04, 0.04}, 0.12, 1.2},
                           {{0.05, 0.10, 0.30}, {0.05, 0.05, 0.05}, 0.20, 1.4}};
  scene.positionsMm = flashPositions(68, 68);
  scene.holdout = {6, 8};
  scene.pixels = 96;
  scene.samplesASide = 1;
  return scene;
}

}  // namespace patina::test
