#pragma once

#include <Eigen/Core>

#include "engine/image/image.h"

namespace patina {

/// How far a photograph is shifted against another of the same scene under other light.
struct PictureShift {
  Eigen::Vector2d px = Eigen::Vector2d::Zero();  ///< photo(x) = reference(x - px)
  double uncertaintyPx = 1e9;                    ///< standard deviation; large where the scene has no texture
};
/// From the texture of both: local brightness is free (other light), the logarithm's difference, with what is
/// smooth taken off, is compared with the reference's gradient. Good for shifts below a pixel or two. `mask`:
/// one channel, pixels that count; empty: all. Source: Lucas and Kanade 1981, one step, with a free gain.
PictureShift pictureShift(const Image& reference, const Image& photo, const Image& mask);

/// How much of the finest detail that a picture could hold is there: energy of the finest scale over that of
/// the next, from two photographs of the same scene whose noise is independent and so drops out. About 0.25
/// and more for sharp texture, below 0.08 for a blurred one. Negative: no texture to tell by.
double sharpness(const Image& one, const Image& other, const Image& mask);

/// One channel: the mean of all.
Image greyOf(const Image& image);

}  // namespace patina
