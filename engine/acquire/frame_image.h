#pragma once

#include <array>
#include <vector>

#include "engine/acquire/frame.h"
#include "engine/base/result.h"
#include "engine/capture/encoding.h"
#include "engine/image/image.h"

namespace patina {

/// How a frame becomes light.
struct FrameConversion {
  double black = -1;  ///< level taken off, share of full scale; below 0: what the frame says
  /// Measured response of a camera whose layout is not linear, R G B. Empty: sRGB's curve, a guess.
  std::vector<ResponseCurve> response;
  /// Half the resolution of a Bayer sensor, each pixel from its own cell of four: nothing is interpolated.
  bool binBayer = false;
};

/// R G B, proportional to light: 0 at the black level, 1 where the sensor clips (values beyond that are
/// kept; values below 0 too, or the mean of noise would be wrong). Bayer layouts by the gradient-corrected
/// linear filters of Malvar, He and Cutler (ICASSP 2004), whose taps add up to one: means are kept. Errors:
/// Malformed (too few bytes for the size, a JPEG that can't be read, a damaged frame), Unsupported (an odd
/// width of YUYV).
Result<Image> linearImage(const Frame& frame, const FrameConversion& conversion = {});

/// Where the sensor clipped, one channel, 1 or 0: samples of the frame itself at its white level; a pixel of
/// a Bayer sensor counts where any sample of its 3 x 3 neighbourhood does.
Result<Image> clippedMask(const Frame& frame);

/// Mean of frames of one scene, in light. All of one size.
Result<Image> meanImage(const std::vector<Frame>& frames, const FrameConversion& conversion = {});

}  // namespace patina
