#pragma once

namespace patina {

/// A number in 0 to 1 for each pixel, neighbours as different as can be: sampling noise shifted by it becomes
/// fine grain without lines or clumps. The mask repeats every 64 pixels; `channel` gives others, by shifts.
/// Source: greedy void filling with a Gaussian of 1.9 pixels, after Ulichney 1993. Made at first use (about
/// 30 ms). Threading: any.
float blueNoise(int x, int y, int channel);

}  // namespace patina
