#include "engine/acquire/frame_image.h"

#include <algorithm>
#include <cmath>

#include "engine/image/jpeg.h"

namespace patina {
namespace {

bool isBayer(PixelLayout layout) {
  switch (layout) {
    case PixelLayout::Bayer8:
    case PixelLayout::Bayer10:
    case PixelLayout::Bayer12:
    case PixelLayout::Bayer16:
    case PixelLayout::Bayer10Packed:
    case PixelLayout::Bayer12Packed:
      return true;
    default:
      return false;
  }
}

/// Channel (0 R, 1 G, 2 B) of the sensor's pixel.
int colourAt(BayerOrder order, int x, int y) {
  static constexpr int kColours[4][2][2] = {
      {{0, 1}, {1, 2}}, {{1, 0}, {2, 1}}, {{1, 2}, {0, 1}}, {{2, 1}, {1, 0}}};
  return kColours[static_cast<int>(order)][y & 1][x & 1];
}

Error tooShort(const Frame& frame) {
  return Error{
      ErrorCode::Malformed,
      "a frame of the camera holds " + std::to_string(frame.bytes.size()) + " bytes, too few for its size",
      frame.format.name, "choose another format, or a shorter cable"};
}

/// One row of samples, as shares of full scale.
void unpackRow(PixelLayout layout, const std::uint8_t* from, int width, float* to) {
  const float scale = 1.0f / static_cast<float>((1 << bitsOf(layout)) - 1);
  const auto word = [&](int i) { return static_cast<int>(from[2 * i] | from[2 * i + 1] << 8); };
  switch (layout) {
    case PixelLayout::Bayer10:
    case PixelLayout::Bayer12:
    case PixelLayout::Bayer16:
    case PixelLayout::Grey16: {
      for (int i = 0; i < width; ++i) to[i] = static_cast<float>(word(i)) * scale;
      break;
    }
    case PixelLayout::Bayer10Packed:
      for (int i = 0; i < width; ++i) {
        const std::uint8_t* group = from + i / 4 * 5;
        to[i] = static_cast<float>(group[i % 4] << 2 | (group[4] >> (2 * (i % 4)) & 3)) * scale;
      }
      break;
    case PixelLayout::Bayer12Packed:
      for (int i = 0; i < width; ++i) {
        const std::uint8_t* group = from + i / 2 * 3;
        to[i] = static_cast<float>(group[i % 2] << 4 | (group[2] >> (4 * (i % 2)) & 15)) * scale;
      }
      break;
    default:
      for (int i = 0; i < width; ++i) to[i] = static_cast<float>(from[i]) * scale;
  }
}

/// One channel as the sensor has it, share of full scale.
Result<Image> samplesOf(const Frame& frame) {
  const auto [width, height] = frame.format.size;
  const std::size_t least = rowBytes(frame.format.layout, width);
  const std::size_t stride = frame.strideBytes > 0 ? frame.strideBytes : least;
  if (width <= 0 || height <= 0 || stride < least ||
      frame.bytes.size() < stride * static_cast<std::size_t>(height - 1) + least)
    return tooShort(frame);
  Image samples(width, height, 1);
  for (int y = 0; y < height; ++y)
    unpackRow(frame.format.layout, frame.bytes.data() + stride * static_cast<std::size_t>(y), width,
              samples.pixel(0, y).data());
  return samples;
}

/// Reflected about the outermost pixel: keeps the colour of a Bayer sensor.
int inside(int i, int count) {
  if (count == 1) return 0;
  if (i < 0) i = -i;
  if (i >= count) i = 2 * (count - 1) - i;
  return std::clamp(i, 0, count - 1);
}

Image debayer(const Image& mosaic, BayerOrder order) {
  const int width = mosaic.width(), height = mosaic.height();
  Image out(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const auto at = [&](int dx, int dy) {
        return mosaic.at(inside(x + dx, width), inside(y + dy, height));
      };
      const float centre = at(0, 0);
      const float across = at(-1, 0) + at(1, 0), down = at(0, -1) + at(0, 1);
      const float across2 = at(-2, 0) + at(2, 0), down2 = at(0, -2) + at(0, 2);
      const float corners = at(-1, -1) + at(1, -1) + at(-1, 1) + at(1, 1);
      const std::span<float> rgb = out.pixel(x, y);
      const int colour = colourAt(order, x, y);
      rgb[static_cast<std::size_t>(colour)] = centre;
      if (colour != 1) {
        rgb[1] = (4 * centre + 2 * (across + down) - (across2 + down2)) / 8;
        rgb[static_cast<std::size_t>(2 - colour)] = (6 * centre + 2 * corners - 1.5f * (across2 + down2)) / 8;
      } else {
        const auto beside = static_cast<std::size_t>(colourAt(order, x + 1, y));
        rgb[beside] = (5 * centre + 4 * across - corners - across2 + 0.5f * down2) / 8;
        rgb[2 - beside] = (5 * centre + 4 * down - corners - down2 + 0.5f * across2) / 8;
      }
    }
  return out;
}

Image binned(const Image& mosaic, BayerOrder order) {
  Image out(mosaic.width() / 2, mosaic.height() / 2, 3);
  for (int y = 0; y < out.height(); ++y)
    for (int x = 0; x < out.width(); ++x)
      for (int j = 0; j < 2; ++j)
        for (int i = 0; i < 2; ++i) {
          const int colour = colourAt(order, i, j);
          out.at(x, y, colour) += mosaic.at(2 * x + i, 2 * y + j) * (colour == 1 ? 0.5f : 1.0f);
        }
  return out;
}

/// R' G' B' in 0..1.
Result<Image> encodedRgb(const Frame& frame) {
  const auto [width, height] = frame.format.size;
  if (frame.format.layout == PixelLayout::Mjpeg) {
    const std::string_view bytes(reinterpret_cast<const char*>(frame.bytes.data()), frame.bytes.size());
    const Result<JpegPixels> pixels = decodeJpeg(bytes, "frame of the camera", frame.format.size);
    if (!pixels) return pixels.error();
    Image image(width, height, 3);
    for (std::size_t i = 0; i < pixels->rgb.size(); ++i)
      image.samples()[i] = static_cast<float>(pixels->rgb[i]) / 255.0f;
    return image;
  }
  const std::size_t least = rowBytes(frame.format.layout, width);
  const std::size_t stride = frame.strideBytes > 0 ? frame.strideBytes : least;
  if (width <= 0 || height <= 0 || stride < least ||
      frame.bytes.size() < stride * static_cast<std::size_t>(height - 1) + least)
    return tooShort(frame);
  Image image(width, height, 3);
  if (frame.format.layout == PixelLayout::Rgb8) {
    for (int y = 0; y < height; ++y)
      for (int i = 0; i < 3 * width; ++i)
        image.pixel(0, y).data()[i] =
            static_cast<float>(
                frame.bytes[stride * static_cast<std::size_t>(y) + static_cast<std::size_t>(i)]) /
            255.0f;
    return image;
  }
  if (width % 2 != 0)
    return Error{ErrorCode::Unsupported, "frames of this format have an even width", frame.format.name,
                 "choose another size"};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const std::uint8_t* pair = frame.bytes.data() + stride * static_cast<std::size_t>(y) + x / 2 * 4;
      const float luma = (static_cast<float>(pair[x % 2 == 0 ? 0 : 2]) - 16) / 219;
      const float u = (static_cast<float>(pair[1]) - 128) / 224,
                  v = (static_cast<float>(pair[3]) - 128) / 224;
      // BT.601: Kr = 0.299, Kb = 0.114
      image.at(x, y, 0) = luma + 1.402f * v;
      image.at(x, y, 1) = luma - 0.344136f * u - 0.714136f * v;
      image.at(x, y, 2) = luma + 1.772f * u;
    }
  return image;
}

void linearise(Image& image, const std::vector<ResponseCurve>& response) {
  for (std::size_t i = 0; i < image.samples().size(); ++i) {
    const double value = std::clamp<double>(image.samples()[i], 0, 1);
    image.samples()[i] = static_cast<float>(response.size() == 3 ? linearFromResponse(response[i % 3], value)
                                                                 : linearFromSrgbPixel(value));
  }
}

}  // namespace

Result<Image> linearImage(const Frame& frame, const FrameConversion& conversion) {
  if (frame.metadata.damaged)
    return Error{ErrorCode::Malformed, "the camera says that this frame is damaged", frame.format.name,
                 "photograph again; a shorter or better cable helps where it happens often"};
  Image image;
  if (frame.format.layout == PixelLayout::Linear) {
    image = frame.linear;
    if (image.empty() || image.channels() != 3) return tooShort(frame);
  } else if (isLinear(frame.format.layout)) {
    const Result<Image> samples = samplesOf(frame);
    if (!samples) return samples.error();
    if (isBayer(frame.format.layout)) {
      image =
          conversion.binBayer ? binned(*samples, frame.format.bayer) : debayer(*samples, frame.format.bayer);
    } else {
      image = Image(samples->width(), samples->height(), 3);
      for (std::size_t i = 0; i < image.samples().size(); ++i) image.samples()[i] = samples->samples()[i / 3];
    }
  } else {
    Result<Image> encoded = encodedRgb(frame);
    if (!encoded) return encoded.error();
    image = std::move(*encoded);
    linearise(image, conversion.response);
  }
  const double black = conversion.black >= 0 ? conversion.black : frame.black;
  const double range = frame.white - black;
  if (!(range > 0))
    return Error{ErrorCode::Invalid, "the camera's black level is not below its white level",
                 frame.format.name, "take the black level anew"};
  if (black != 0 || range != 1)
    for (float& sample : image.samples()) sample = static_cast<float>((sample - black) / range);
  return image;
}

Result<Image> clippedMask(const Frame& frame) {
  const bool bayer = isBayer(frame.format.layout);
  // The last code but one counts too: noise and rounding put clipped pixels there.
  const double codes =
      frame.format.layout == PixelLayout::Linear ? 1e6 : std::pow(2.0, bitsOf(frame.format.layout));
  const auto limit = static_cast<float>(frame.white - 1.5 / codes);
  Image samples;
  if (frame.format.layout == PixelLayout::Linear) {
    samples = frame.linear;
  } else {
    Result<Image> read = isLinear(frame.format.layout) ? samplesOf(frame) : encodedRgb(frame);
    if (!read) return read.error();
    samples = std::move(*read);
  }
  const int width = samples.width(), height = samples.height();
  Image mask(width, height, 1);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      bool clipped = false;
      const int reach = bayer ? 1 : 0;
      for (int j = std::max(0, y - reach); j <= std::min(height - 1, y + reach); ++j)
        for (int i = std::max(0, x - reach); i <= std::min(width - 1, x + reach); ++i)
          for (const float sample : samples.pixel(i, j)) clipped |= sample >= limit;
      mask.at(x, y) = clipped ? 1.0f : 0.0f;
    }
  return mask;
}

Result<Image> meanImage(const std::vector<Frame>& frames, const FrameConversion& conversion) {
  if (frames.empty())
    return Error{ErrorCode::Invalid, "there is no frame to make a photograph of", "", "photograph again"};
  Result<Image> sum = linearImage(frames.front(), conversion);
  if (!sum) return sum;
  for (std::size_t f = 1; f < frames.size(); ++f) {
    const Result<Image> next = linearImage(frames[f], conversion);
    if (!next) return next.error();
    if (next->width() != sum->width() || next->height() != sum->height())
      return Error{ErrorCode::Invalid, "the camera changed the size of its frames", frames[f].format.name,
                   "photograph again"};
    for (std::size_t i = 0; i < sum->samples().size(); ++i) sum->samples()[i] += next->samples()[i];
  }
  const float share = 1.0f / static_cast<float>(frames.size());
  if (frames.size() > 1)
    for (float& sample : sum->samples()) sample *= share;
  return sum;
}

}  // namespace patina
