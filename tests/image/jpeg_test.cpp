#include "engine/image/jpeg.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "engine/image/exr.h"
#include "engine/image/photo_file.h"
#include "tests/base/temp_folder.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using test::TempFolder;
using testing::HasSubstr;

const fs::path kSamples = fs::path(PATINA_SOURCE_DIR) / "tests/fuzz/corpus/jpeg";
// Pictures of quality 90 with byte (5 i + 20 y) mod 256 at byte i of row y: a smooth ramp, kept within some
// codes.
constexpr double kLoss = 14.0 / 255;

TEST(ReadJpeg, GivesThreeChannelsOfColourAndOfGrey) {
  const Result<Image> grey = readJpeg(kSamples / "grey.jpg");
  ASSERT_TRUE(grey.ok()) << grey.error().sentence();
  EXPECT_EQ(grey->width(), 16);
  EXPECT_EQ(grey->height(), 8);
  EXPECT_EQ(grey->channels(), 3);
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 16; ++x)
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(grey->at(x, y, c), (5 * x + 20 * y) / 255.0, kLoss) << x << ", " << y;
  for (const char* name : {"rgb.jpg", "progressive.jpg"}) {
    const Result<Image> colour = readJpeg(kSamples / name, ImageSize{16, 8});
    ASSERT_TRUE(colour.ok()) << colour.error().sentence();
    EXPECT_GT(colour->at(12, 3, 2), colour->at(2, 1, 2));
  }
}

TEST(ReadJpeg, RefusesTruncationOtherSizesAndOtherFiles) {
  const std::string whole = test::readText(kSamples / "rgb.jpg");
  for (std::size_t length = 0; length + 2 < whole.size(); length += 7)
    EXPECT_FALSE(readJpegBytes(std::string_view(whole).substr(0, length), "cut.jpg").ok()) << length;
  EXPECT_THAT(readJpegBytes(whole, "photo.jpg", ImageSize{8, 8}).error().what, HasSubstr("16 x 8"));
  EXPECT_EQ(readJpeg(kSamples / "none.jpg").error().code, ErrorCode::NotFound);
  EXPECT_EQ(readJpegBytes("hello", "x").error().code, ErrorCode::Malformed);
}

TEST(PhotoFile, IsToldByItsContent) {
  const TempFolder folder;
  fs::copy_file(kSamples / "rgb.jpg", folder / "misnamed.png");
  const Result<PhotoFile> jpeg = readPhotoFile(folder / "misnamed.png");
  ASSERT_TRUE(jpeg.ok()) << jpeg.error().sentence();
  EXPECT_FALSE(jpeg->linear);
  EXPECT_EQ(jpeg->codes, 255);
  const Result<PhotoFile> png =
      readPhotoFile(fs::path(PATINA_SOURCE_DIR) / "tests/fuzz/corpus/png/grey16.png");
  ASSERT_TRUE(png.ok());
  EXPECT_EQ(png->codes, 65535);
  Image image(4, 3, 3, 2.5f);
  ASSERT_TRUE(writeExr(folder / "linear.exr", image, {"R", "G", "B"}).ok());
  const Result<PhotoFile> exr = readPhotoFile(folder / "linear.exr");
  ASSERT_TRUE(exr.ok());
  EXPECT_TRUE(exr->linear);
  EXPECT_EQ(exr->image.at(1, 1, 1), 2.5f);
  ASSERT_TRUE(writeExr(folder / "grey.exr", Image(4, 3, 1, 0.25f), {"Y"}).ok());
  EXPECT_EQ(readPhotoFile(folder / "grey.exr")->image.at(0, 0, 2), 0.25f);
  image.at(2, 1, 0) = NAN;
  ASSERT_TRUE(writeExr(folder / "nan.exr", image, {"R", "G", "B"}).ok());
  EXPECT_FALSE(readPhotoFile(folder / "nan.exr").ok());
  EXPECT_EQ(readPhotoFile(fs::path(PATINA_SOURCE_DIR) / "README.md").error().code, ErrorCode::Unsupported);
  EXPECT_EQ(readPhotoFile(folder / "none").error().code, ErrorCode::NotFound);
}

}  // namespace
}  // namespace patina
