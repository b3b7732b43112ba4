#include "engine/acquire/frame_image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
// after <cstdio>, which it needs
#include <jpeglib.h>

namespace patina {
namespace {

Frame frameOf(PixelLayout layout, BayerOrder order, int width, int height, std::vector<std::uint8_t> bytes) {
  Frame frame;
  frame.format.layout = layout;
  frame.format.bayer = order;
  frame.format.size = {width, height};
  frame.bytes = std::move(bytes);
  return frame;
}

std::vector<std::uint8_t> words(const std::vector<int>& values) {
  std::vector<std::uint8_t> bytes;
  for (const int value : values) {
    bytes.push_back(static_cast<std::uint8_t>(value & 255));
    bytes.push_back(static_cast<std::uint8_t>(value >> 8));
  }
  return bytes;
}

/// What colour is where, written out by hand.
const char* namesOf(BayerOrder order) {
  switch (order) {
    case BayerOrder::Rggb:
      return "RGGB";
    case BayerOrder::Grbg:
      return "GRBG";
    case BayerOrder::Gbrg:
      return "GBRG";
    case BayerOrder::Bggr:
      return "BGGR";
  }
  return "";
}
int channelAt(BayerOrder order, int x, int y) {
  const char colour = namesOf(order)[(y % 2) * 2 + x % 2];
  return colour == 'R' ? 0 : colour == 'G' ? 1 : 2;
}

constexpr double kRounding = 1.0 / 65535;  // of a 16-bit code, twice its half

class EveryOrder : public testing::TestWithParam<BayerOrder> {};

TEST_P(EveryOrder, ColoursOfAPlaneComeBackEverywhere) {
  // Three planes, each linear over the picture: filters whose taps add up right return them exactly, borders
  // aside.
  const auto plane = [](int channel, double x, double y) {
    return 0.2 + 0.1 * channel + 0.002 * x - 0.0015 * (channel + 1) * y;
  };
  constexpr int kWidth = 16, kHeight = 12;
  std::vector<int> values;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      values.push_back(static_cast<int>(std::lround(65535 * plane(channelAt(GetParam(), x, y), x, y))));
  const Result<Image> image =
      linearImage(frameOf(PixelLayout::Bayer16, GetParam(), kWidth, kHeight, words(values)));
  ASSERT_TRUE(image.ok());
  // The correction by another colour's second difference is zero on planes.
  for (int y = 2; y < kHeight - 2; ++y)
    for (int x = 2; x < kWidth - 2; ++x)
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(image->at(x, y, c), plane(c, x, y), 3 * kRounding) << x << ' ' << y << ' ' << c;
}

TEST_P(EveryOrder, UniformColourComesBackToTheBorder) {
  const double colour[3] = {0.7, 0.3, 0.15};
  constexpr int kSide = 8;
  std::vector<int> values;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x)
      values.push_back(static_cast<int>(std::lround(65535 * colour[channelAt(GetParam(), x, y)])));
  for (const bool binned : {false, true}) {
    FrameConversion conversion;
    conversion.binBayer = binned;
    const Result<Image> image =
        linearImage(frameOf(PixelLayout::Bayer16, GetParam(), kSide, kSide, words(values)), conversion);
    ASSERT_TRUE(image.ok());
    EXPECT_EQ(image->width(), binned ? kSide / 2 : kSide);
    for (int y = 0; y < image->height(); ++y)
      for (int x = 0; x < image->width(); ++x)
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(image->at(x, y, c), colour[c], 4 * kRounding);
  }
}

INSTANTIATE_TEST_SUITE_P(FrameImage, EveryOrder,
                         testing::Values(BayerOrder::Rggb, BayerOrder::Grbg, BayerOrder::Gbrg,
                                         BayerOrder::Bggr));

TEST(FrameImage, PackedSamplesAreThoseThatWerePacked) {
  // Packed by the definition: high bits a byte each, low bits together in the last one, first pixel lowest.
  std::mt19937 random(3);
  constexpr int kWidth = 12, kHeight = 4;
  for (const int bits : {10, 12}) {
    std::vector<int> values;
    for (int i = 0; i < kWidth * kHeight; ++i) values.push_back(static_cast<int>(random() % (1u << bits)));
    std::vector<std::uint8_t> packed;
    const int group = bits == 10 ? 4 : 2;
    for (std::size_t i = 0; i < values.size(); i += static_cast<std::size_t>(group)) {
      unsigned low = 0;
      for (int k = 0; k < group; ++k) {
        const int value = values[i + static_cast<std::size_t>(k)];
        packed.push_back(static_cast<std::uint8_t>(value >> (bits - 8)));
        low |= static_cast<unsigned>(value & ((1 << (bits - 8)) - 1)) << (k * (bits - 8));
      }
      packed.push_back(static_cast<std::uint8_t>(low));
    }
    const PixelLayout plain = bits == 10 ? PixelLayout::Bayer10 : PixelLayout::Bayer12;
    const PixelLayout tight = bits == 10 ? PixelLayout::Bayer10Packed : PixelLayout::Bayer12Packed;
    const Result<Image> expected =
        linearImage(frameOf(plain, BayerOrder::Grbg, kWidth, kHeight, words(values)));
    const Result<Image> got = linearImage(frameOf(tight, BayerOrder::Grbg, kWidth, kHeight, packed));
    ASSERT_TRUE(expected.ok() && got.ok());
    for (std::size_t i = 0; i < got->samples().size(); ++i)
      EXPECT_EQ(got->samples()[i], expected->samples()[i]) << bits;
  }
}

TEST(FrameImage, BlackAndWhiteLevelsSpanZeroToOne) {
  Frame frame = frameOf(PixelLayout::Grey16, BayerOrder::Rggb, 3, 1, words({4096, 4096 + 25000, 54096}));
  frame.black = 4096 / 65535.0;
  frame.white = 54096 / 65535.0;
  const Result<Image> image = linearImage(frame);
  ASSERT_TRUE(image.ok());
  EXPECT_NEAR(image->at(0, 0, 0), 0, 1e-6);
  EXPECT_NEAR(image->at(1, 0, 1), 0.5, 1e-6);
  EXPECT_NEAR(image->at(2, 0, 2), 1, 1e-6);
  FrameConversion measured;
  measured.black = 0;
  EXPECT_NEAR(linearImage(frame, measured)->at(0, 0, 0), 4096.0 / 54096, 1e-6);
}

TEST(FrameImage, BelowTheBlackLevelIsNegative) {
  // Noise round black must keep its mean.
  Frame frame = frameOf(PixelLayout::Grey8, BayerOrder::Rggb, 2, 1, {8, 12});
  frame.black = 10 / 255.0;
  const Result<Image> image = linearImage(frame);
  ASSERT_TRUE(image.ok());
  EXPECT_LT(image->at(0, 0, 0), 0);
  EXPECT_NEAR(image->at(0, 0, 0) + image->at(1, 0, 0), 0, 1e-6);
}

TEST(FrameImage, YuyvIsBt601ThroughSrgb) {
  // Red, by the standard's own numbers: 100 % red is Y 81, Cb 90, Cr 240 (8 bits, rounded).
  const Result<Image> red =
      linearImage(frameOf(PixelLayout::Yuyv, BayerOrder::Rggb, 2, 1, {81, 90, 81, 240}));
  ASSERT_TRUE(red.ok());
  constexpr double kCodeRounding = 0.02;  // half a code of chroma, times 1.8, through sRGB's slope of 2.4
  EXPECT_NEAR(red->at(0, 0, 0), 1, kCodeRounding);
  EXPECT_NEAR(red->at(0, 0, 1), 0, kCodeRounding);
  EXPECT_NEAR(red->at(1, 0, 2), 0, kCodeRounding);
  // Mid grey: Y 126 is 0.502 encoded, 0.216 in light.
  const Result<Image> grey =
      linearImage(frameOf(PixelLayout::Yuyv, BayerOrder::Rggb, 2, 1, {126, 128, 16, 128}));
  ASSERT_TRUE(grey.ok());
  EXPECT_NEAR(grey->at(0, 0, 1), 0.2157, 0.001);
  EXPECT_NEAR(grey->at(1, 0, 1), 0, 1e-6);
  EXPECT_FALSE(
      linearImage(frameOf(PixelLayout::Yuyv, BayerOrder::Rggb, 3, 1, std::vector<std::uint8_t>(12))).ok());
}

TEST(FrameImage, MeasuredResponseReplacesTheGuess) {
  FrameConversion conversion;
  conversion.response.assign(3, ResponseCurve{{0, 0.5, 1}, {0, 0.1, 1}});
  conversion.response[2].output[1] = 0.4;
  const Result<Image> image =
      linearImage(frameOf(PixelLayout::Rgb8, BayerOrder::Rggb, 1, 1, {51, 51, 51}), conversion);  // 0.2
  ASSERT_TRUE(image.ok());
  EXPECT_NEAR(image->at(0, 0, 0), 0.04, 1e-6);
  EXPECT_NEAR(image->at(0, 0, 2), 0.16, 1e-6);
}

TEST(FrameImage, MotionJpegIsDecodedAndACutOneIsNot) {
  constexpr int kSide = 32;
  jpeg_compress_struct info;
  jpeg_error_mgr manager;
  info.err = jpeg_std_error(&manager);
  jpeg_create_compress(&info);
  unsigned char* memory = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&info, &memory, &size);
  info.image_width = info.image_height = kSide;
  info.input_components = 3;
  info.in_color_space = JCS_RGB;
  jpeg_set_defaults(&info);
  jpeg_set_quality(&info, 95, TRUE);
  jpeg_start_compress(&info, TRUE);
  std::vector<std::uint8_t> row;
  for (int i = 0; i < kSide; ++i) row.insert(row.end(), {188, 100, 40});
  while (info.next_scanline < info.image_height) {
    JSAMPROW line = row.data();
    jpeg_write_scanlines(&info, &line, 1);
  }
  jpeg_finish_compress(&info);
  jpeg_destroy_compress(&info);
  std::vector<std::uint8_t> bytes(memory, memory + size);
  std::free(memory);
  const Result<Image> image = linearImage(frameOf(PixelLayout::Mjpeg, BayerOrder::Rggb, kSide, kSide, bytes));
  ASSERT_TRUE(image.ok());
  EXPECT_NEAR(image->at(5, 5, 0), linearFromSrgbPixel(188 / 255.0), 0.02);  // two codes of compression
  EXPECT_NEAR(image->at(5, 5, 2), linearFromSrgbPixel(40 / 255.0), 0.01);
  bytes.resize(bytes.size() / 2);
  const Result<Image> cut = linearImage(frameOf(PixelLayout::Mjpeg, BayerOrder::Rggb, kSide, kSide, bytes));
  ASSERT_FALSE(cut.ok());
  EXPECT_EQ(cut.error().code, ErrorCode::Malformed);
  EXPECT_FALSE(linearImage(frameOf(PixelLayout::Mjpeg, BayerOrder::Rggb, kSide + 1, kSide, bytes)).ok());
}

TEST(FrameImage, ShortOrDamagedFramesAreRefused) {
  const Result<Image> shortOne =
      linearImage(frameOf(PixelLayout::Bayer10, BayerOrder::Rggb, 8, 8, std::vector<std::uint8_t>(127)));
  ASSERT_FALSE(shortOne.ok());
  EXPECT_EQ(shortOne.error().code, ErrorCode::Malformed);
  Frame frame = frameOf(PixelLayout::Grey8, BayerOrder::Rggb, 2, 2, {1, 2, 3, 4});
  EXPECT_TRUE(linearImage(frame).ok());
  frame.metadata.damaged = true;
  EXPECT_FALSE(linearImage(frame).ok());
}

TEST(FrameImage, StrideSkipsThePadding) {
  Frame frame = frameOf(PixelLayout::Grey8, BayerOrder::Rggb, 2, 2, {51, 102, 9, 9, 153, 204});
  frame.strideBytes = 4;
  const Result<Image> image = linearImage(frame);
  ASSERT_TRUE(image.ok());
  EXPECT_NEAR(image->at(0, 1, 0), 0.6, 1e-6);
  EXPECT_NEAR(image->at(1, 1, 0), 0.8, 1e-6);
}

TEST(FrameImage, ClippedSamplesSpreadOverTheCellsThatUseThem) {
  std::vector<int> values(36, 500);
  values[2 * 6 + 3] = 1023;
  const Result<Image> mask =
      clippedMask(frameOf(PixelLayout::Bayer10, BayerOrder::Rggb, 6, 6, words(values)));
  ASSERT_TRUE(mask.ok());
  int count = 0;
  for (const float one : mask->samples()) count += one > 0;
  EXPECT_EQ(count, 9);
  EXPECT_EQ(mask->at(3, 2), 1);
  EXPECT_EQ(mask->at(2, 1), 1);
  EXPECT_EQ(mask->at(5, 2), 0);
}

TEST(FrameImage, MeanOfFramesIsTheMean) {
  const Frame a = frameOf(PixelLayout::Grey8, BayerOrder::Rggb, 1, 1, {51}),
              b = frameOf(PixelLayout::Grey8, BayerOrder::Rggb, 1, 1, {153});
  const Result<Image> mean = meanImage({a, b, b});
  ASSERT_TRUE(mean.ok());
  EXPECT_NEAR(mean->at(0, 0, 0), (0.2 + 0.6 + 0.6) / 3, 1e-6);
  EXPECT_FALSE(meanImage({}).ok());
  EXPECT_FALSE(meanImage({a, frameOf(PixelLayout::Grey8, BayerOrder::Rggb, 2, 1, {1, 2})}).ok());
}

}  // namespace
}  // namespace patina
