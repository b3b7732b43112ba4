#pragma once

#include <cstdint>
#include <optional>

#include "engine/acquire/frame.h"

namespace patina {

struct V4l2Layout {
  PixelLayout layout = PixelLayout::Grey8;
  BayerOrder bayer = BayerOrder::Rggb;
};

/// Our layout of a V4L2 four-character code; none for those that aren't read.
std::optional<V4l2Layout> layoutOfPixelFormat(std::uint32_t pixelFormat);
/// The reverse; 0 where V4L2 has none.
std::uint32_t pixelFormatOfLayout(PixelLayout layout, BayerOrder bayer);

}  // namespace patina
