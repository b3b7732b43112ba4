#pragma once

#include <array>

namespace patina {

/// Colours for numbers, of evenly rising lightness. Display-encoded (sRGB) R G B, 0 to 1.
enum class ColourMap {
  Viridis,  ///< dark violet, green, yellow: for parameters
  Magma,    ///< black, violet, cream: for errors
};

/// The colour of `value` in 0 to 1; clamped outside. Source: published key colours of the maps (Smith, van
/// der Walt 2015), nine each, linear between: within 0.02 of the full tables.
std::array<float, 3> mapColour(ColourMap map, float value);

}  // namespace patina
