#include "engine/acquire/frame.h"

namespace patina {

bool isLinear(PixelLayout layout) {
  switch (layout) {
    case PixelLayout::Yuyv:
    case PixelLayout::Mjpeg:
    case PixelLayout::Rgb8:
      return false;
    default:
      return true;
  }
}

int bitsOf(PixelLayout layout) {
  switch (layout) {
    case PixelLayout::Bayer10:
    case PixelLayout::Bayer10Packed:
      return 10;
    case PixelLayout::Bayer12:
    case PixelLayout::Bayer12Packed:
      return 12;
    case PixelLayout::Bayer16:
    case PixelLayout::Grey16:
      return 16;
    case PixelLayout::Linear:
      return 32;
    default:
      return 8;
  }
}

std::size_t rowBytes(PixelLayout layout, int width) {
  const auto pixels = static_cast<std::size_t>(width);
  switch (layout) {
    case PixelLayout::Bayer8:
    case PixelLayout::Grey8:
      return pixels;
    case PixelLayout::Bayer10:
    case PixelLayout::Bayer12:
    case PixelLayout::Bayer16:
    case PixelLayout::Grey16:
    case PixelLayout::Yuyv:
      return 2 * pixels;
    case PixelLayout::Bayer10Packed:
      return (pixels + 3) / 4 * 5;
    case PixelLayout::Bayer12Packed:
      return (pixels + 1) / 2 * 3;
    case PixelLayout::Rgb8:
      return 3 * pixels;
    case PixelLayout::Mjpeg:
    case PixelLayout::Linear:
      return 0;
  }
  return 0;
}

}  // namespace patina
