// Photographs in strips of rows are the photographs as a whole.
#include "engine/capture/photo_rows.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <limits>
#include <random>

#include "engine/image/png.h"
#include "tests/capture/small_bundle.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using test::TempFolder;
using testing::HasSubstr;

constexpr int kSide = 75;  // no multiple of a compressed block's rows

Image noise(float low, float high) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> value(low, high);
  Image image(kSide, kSide, 3);
  for (float& sample : image.samples()) sample = value(random);
  return image;
}

/// A bundle with one photograph, written by `write`.
template <typename Write>
FourierCapture bundle(const fs::path& folder, const std::string& file, const std::string& encoding,
                      Write write) {
  FourierCapture capture = test::smallCapture(folder, 0, kSide);
  capture.photos = {{file, PhotoRole::Window, 1, {0, 0}, 0, false, encoding}};
  fs::create_directories(folder);
  write(folder / file);
  return capture;
}

/// 16 bits a sample, interlaced or not.
void writePng16(const fs::path& file, bool interlaced) {
  std::FILE* out = std::fopen(file.c_str(), "wb");
  ASSERT_NE(out, nullptr);
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, out);
  png_set_IHDR(png, info, kSide, kSide, 16, PNG_COLOR_TYPE_RGB,
               interlaced ? PNG_INTERLACE_ADAM7 : PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  std::mt19937 random(5);
  std::vector<unsigned char> bytes(kSide * kSide * 6);
  for (auto& byte : bytes) byte = static_cast<unsigned char>(random());
  std::vector<png_bytep> rows;
  for (int y = 0; y < kSide; ++y) rows.push_back(bytes.data() + y * kSide * 6);
  png_write_image(png, rows.data());
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
  std::fclose(out);
}

void expectSameInStrips(FourierCapture capture, int rowsAtOnce, int skipped = 0) {
  const Result<Image> whole = readPhoto(capture, capture.photos[0]);
  ASSERT_TRUE(whole.ok()) << whole.error().sentence();
  auto rows = PhotoRows::open(capture, capture.photos[0], PhotoRows::makeTables());
  ASSERT_TRUE(rows.ok()) << rows.error().sentence();
  ASSERT_TRUE(rows->skip(skipped).ok());
  std::vector<float> strip;
  for (int y = skipped; y < kSide; y += rowsAtOnce) {
    const int count = std::min(rowsAtOnce, kSide - y);
    strip.resize(static_cast<std::size_t>(count) * kSide * 3);
    const Status read = rows->next(count, strip);
    ASSERT_TRUE(read.ok()) << read.error().sentence();
    const auto expected = whole->samples().subspan(static_cast<std::size_t>(y) * kSide * 3, strip.size());
    ASSERT_TRUE(std::equal(strip.begin(), strip.end(), expected.begin())) << "row " << y;
  }
}

class Strips : public testing::TestWithParam<int> {};

TEST_P(Strips, OfOpenExrAreTheWhole) {
  TempFolder folder;
  for (const bool half : {false, true}) {
    auto capture = bundle(folder / "b", "p.exr", "", [&](const fs::path& file) {
      ASSERT_TRUE(writeExr(file, noise(-1, 1), {"R", "G", "B"}, {}, half).ok());
    });
    expectSameInStrips(capture, GetParam());
    capture.radianceScale = 0.3;
    expectSameInStrips(capture, GetParam(), 16);
  }
}

TEST_P(Strips, OfPngAreTheWhole) {
  TempFolder folder;
  const auto eight = bundle(folder / "8", "p.png", "srgb",
                            [&](const fs::path& file) { ASSERT_TRUE(writePng(file, noise(0, 1)).ok()); });
  expectSameInStrips(eight, GetParam());
  expectSameInStrips(eight, GetParam(), 17);
  for (const bool interlaced : {false, true}) {
    auto sixteen = bundle(folder / "16", "p.png", "gamma:1.8",
                          [&](const fs::path& file) { writePng16(file, interlaced); });
    sixteen.radianceScale = 1.7;
    expectSameInStrips(sixteen, GetParam());
    expectSameInStrips(sixteen, GetParam(), 20);
  }
}

INSTANTIATE_TEST_SUITE_P(Rows, Strips, testing::Values(1, 16, 32, 40, kSide));

Status readAll(const FourierCapture& capture) {
  auto rows = PhotoRows::open(capture, capture.photos[0], PhotoRows::makeTables());
  if (!rows) return rows.error();
  std::vector<float> strip(static_cast<std::size_t>(kSide) * 3 * 25);
  for (int y = 0; y < kSide; y += 25) {
    Status read = rows->next(25, strip);
    if (!read) return read;
  }
  return Done{};
}

TEST(PhotoRows, TruncatedFilesAreNamed) {
  TempFolder folder;
  const auto exr = bundle(folder / "e", "p.exr", "", [&](const fs::path& file) {
    ASSERT_TRUE(writeExr(file, noise(0, 1), {"R", "G", "B"}).ok());
  });
  const auto png = bundle(folder / "p", "p.png", "srgb",
                          [&](const fs::path& file) { ASSERT_TRUE(writePng(file, noise(0, 1)).ok()); });
  for (const FourierCapture& capture : {exr, png}) {
    const fs::path file = capture.folder / capture.photos[0].file;
    const auto size = fs::file_size(file);
    ASSERT_TRUE(readAll(capture).ok());
    for (const double share : {0.9, 0.5, 0.01, 0.0}) {
      fs::resize_file(file, static_cast<std::uintmax_t>(static_cast<double>(size) * share));
      const Status read = readAll(capture);
      ASSERT_FALSE(read.ok()) << file << " " << share;
      EXPECT_EQ(read.error().code, ErrorCode::Malformed);
      EXPECT_THAT(read.error().where, HasSubstr(capture.photos[0].file));
    }
  }
}

TEST(PhotoRows, NamesAPixelThatIsNoNumberByItsPlaceInThePicture) {
  TempFolder folder;
  Image image = noise(0, 1);
  image.at(7, 60, 2) = std::numeric_limits<float>::quiet_NaN();
  const auto capture = bundle(folder / "b", "p.exr", "", [&](const fs::path& file) {
    ASSERT_TRUE(writeExr(file, image, {"R", "G", "B"}).ok());
  });
  const Status read = readAll(capture);
  ASSERT_FALSE(read.ok());
  EXPECT_THAT(read.error().what, HasSubstr("NaN at pixel (7, 60), channel 2"));
}

TEST(PhotoRows, RefusesAnotherSizeAndAMissingFile) {
  TempFolder folder;
  auto capture = bundle(folder / "b", "p.exr", "", [&](const fs::path& file) {
    ASSERT_TRUE(writeExr(file, noise(0, 1), {"R", "G", "B"}).ok());
  });
  capture.camera.width = kSide + 1;
  auto rows = PhotoRows::open(capture, capture.photos[0], PhotoRows::makeTables());
  ASSERT_TRUE(rows.ok());
  std::vector<float> row(static_cast<std::size_t>(kSide + 1) * 3);
  const Status read = rows->next(1, row);
  ASSERT_FALSE(read.ok());
  EXPECT_EQ(read.error().code, ErrorCode::Invalid);
  capture.photos[0].file = "gone.exr";
  EXPECT_EQ(PhotoRows::open(capture, capture.photos[0], PhotoRows::makeTables()).error().code,
            ErrorCode::NotFound);
}

}  // namespace
}  // namespace patina
