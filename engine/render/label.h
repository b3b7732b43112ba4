#pragma once

#include <array>
#include <string_view>

#include "engine/image/image.h"

namespace patina {

/// Writes a line of text into a picture with a built-in 5 x 7 pixel face (capitals, digits and common signs;
/// other characters leave a gap). `x`, `y`: upper left corner, pixels; parts outside the picture are left
/// out. `scale`: pixels a dot.
void drawLabel(Image& picture, int x, int y, std::string_view text, int scale, std::array<float, 3> colour);
/// Its width, pixels.
int labelWidth(std::string_view text, int scale);
inline constexpr int kLabelDotsHigh = 7;

}  // namespace patina
