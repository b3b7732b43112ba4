#pragma once

#include "engine/diagnosis/explanation.h"

namespace patina::test {

/// An explanation with made-up but consistent answers: anisotropy and flicker were added, two others
/// considered, one pair can't be told apart. Without fits.
Explanation madeUpExplanation();
/// One where nothing is missing: no effects, residual at the noise.
Explanation madeUpCleanExplanation();
/// One whose texts hold markup and broken characters and whose numbers are none, infinite or absurd.
Explanation hostileExplanation();

/// A photograph of a round sample of `width` x `height` pixels, known but for noise, whose prediction before
/// lacks a pattern of `strength` standard deviations; the prediction after lacks nothing.
ResidualPicture madeUpPicture(int width, int height, float strength, unsigned seed = 1);

}  // namespace patina::test
