#include "devices/v4l2/v4l2_formats.h"

#include <linux/videodev2.h>

namespace patina {
namespace {

struct Entry {
  std::uint32_t code;
  PixelLayout layout;
  BayerOrder bayer;
};

constexpr Entry kEntries[] = {{V4L2_PIX_FMT_SRGGB8, PixelLayout::Bayer8, BayerOrder::Rggb},
                              {V4L2_PIX_FMT_SGRBG8, PixelLayout::Bayer8, BayerOrder::Grbg},
                              {V4L2_PIX_FMT_SGBRG8, PixelLayout::Bayer8, BayerOrder::Gbrg},
                              {V4L2_PIX_FMT_SBGGR8, PixelLayout::Bayer8, BayerOrder::Bggr},
                              {V4L2_PIX_FMT_SRGGB10, PixelLayout::Bayer10, BayerOrder::Rggb},
                              {V4L2_PIX_FMT_SGRBG10, PixelLayout::Bayer10, BayerOrder::Grbg},
                              {V4L2_PIX_FMT_SGBRG10, PixelLayout::Bayer10, BayerOrder::Gbrg},
                              {V4L2_PIX_FMT_SBGGR10, PixelLayout::Bayer10, BayerOrder::Bggr},
                              {V4L2_PIX_FMT_SRGGB12, PixelLayout::Bayer12, BayerOrder::Rggb},
                              {V4L2_PIX_FMT_SGRBG12, PixelLayout::Bayer12, BayerOrder::Grbg},
                              {V4L2_PIX_FMT_SGBRG12, PixelLayout::Bayer12, BayerOrder::Gbrg},
                              {V4L2_PIX_FMT_SBGGR12, PixelLayout::Bayer12, BayerOrder::Bggr},
                              {V4L2_PIX_FMT_SRGGB16, PixelLayout::Bayer16, BayerOrder::Rggb},
                              {V4L2_PIX_FMT_SGRBG16, PixelLayout::Bayer16, BayerOrder::Grbg},
                              {V4L2_PIX_FMT_SGBRG16, PixelLayout::Bayer16, BayerOrder::Gbrg},
                              {V4L2_PIX_FMT_SBGGR16, PixelLayout::Bayer16, BayerOrder::Bggr},
                              {V4L2_PIX_FMT_SRGGB10P, PixelLayout::Bayer10Packed, BayerOrder::Rggb},
                              {V4L2_PIX_FMT_SGRBG10P, PixelLayout::Bayer10Packed, BayerOrder::Grbg},
                              {V4L2_PIX_FMT_SGBRG10P, PixelLayout::Bayer10Packed, BayerOrder::Gbrg},
                              {V4L2_PIX_FMT_SBGGR10P, PixelLayout::Bayer10Packed, BayerOrder::Bggr},
                              {V4L2_PIX_FMT_SRGGB12P, PixelLayout::Bayer12Packed, BayerOrder::Rggb},
                              {V4L2_PIX_FMT_SGRBG12P, PixelLayout::Bayer12Packed, BayerOrder::Grbg},
                              {V4L2_PIX_FMT_SGBRG12P, PixelLayout::Bayer12Packed, BayerOrder::Gbrg},
                              {V4L2_PIX_FMT_SBGGR12P, PixelLayout::Bayer12Packed, BayerOrder::Bggr},
                              {V4L2_PIX_FMT_GREY, PixelLayout::Grey8, BayerOrder::Rggb},
                              {V4L2_PIX_FMT_Y16, PixelLayout::Grey16, BayerOrder::Rggb},
                              {V4L2_PIX_FMT_YUYV, PixelLayout::Yuyv, BayerOrder::Rggb},
                              {V4L2_PIX_FMT_MJPEG, PixelLayout::Mjpeg, BayerOrder::Rggb},
                              {V4L2_PIX_FMT_JPEG, PixelLayout::Mjpeg, BayerOrder::Rggb},
                              {V4L2_PIX_FMT_RGB24, PixelLayout::Rgb8, BayerOrder::Rggb}};

}  // namespace

std::optional<V4l2Layout> layoutOfPixelFormat(std::uint32_t pixelFormat) {
  for (const Entry& entry : kEntries)
    if (entry.code == pixelFormat) return V4l2Layout{entry.layout, entry.bayer};
  return {};
}

std::uint32_t pixelFormatOfLayout(PixelLayout layout, BayerOrder bayer) {
  for (const Entry& entry : kEntries)
    if (entry.layout == layout && entry.bayer == bayer) return entry.code;
  return 0;
}

}  // namespace patina
