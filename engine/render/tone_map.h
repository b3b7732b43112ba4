#pragma once

#include "engine/image/image.h"

namespace patina {

/// The sRGB code value, 0 to 1, of a linear value. Below 0: 0; above 1: 1. Source: IEC 61966-2-1.
float srgbFromLinear(float linear);
/// The linear value of an sRGB code value.
float linearFromSrgb(float encoded);

/// How values near and above the display's white are shown.
enum class Highlights {
  Clip,      ///< one to one up to white, then white: for maps, whose values should stay comparable
  Shoulder,  ///< one to one up to 0.6, then bent so that only infinity is white: for pictures with highlights
};

/// A picture for the display: linear R G B (or one channel) times `exposure`, highlights treated, sRGB
/// encoded, 0 to 1. Non-finite samples become black. Returns an image of the same shape. Thread-safe.
Image toneMap(const Image& linear, float exposure = 1.0f, Highlights highlights = Highlights::Shoulder);

/// The exposure that brings the given fraction of the samples (those above zero) to below `target`. 1 for an
/// image without light.
float autoExposure(const Image& linear, float fraction = 0.95f, float target = 0.8f);

}  // namespace patina
