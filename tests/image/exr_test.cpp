#include "engine/image/exr.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <ImfTiledOutputFile.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <thread>

#include "tests/base/temp_folder.h"
#include "tests/test_data.h"

namespace patina {
namespace {

using test::TempFolder;

/// A file that OpenEXR writes itself: R half, G float, B 32-bit integer, A half, in a data window at (-5, 7).
std::filesystem::path mixedFile(const TempFolder& folder, int width, int height) {
  const Imath::Box2i window({-5, 7}, {-5 + width - 1, 7 + height - 1});
  Imf::Header header(Imath::Box2i({0, 0}, {99, 99}), window);
  header.compression() = Imf::PIZ_COMPRESSION;
  header.channels().insert("R", Imf::Channel(Imf::HALF));
  header.channels().insert("G", Imf::Channel(Imf::FLOAT));
  header.channels().insert("B", Imf::Channel(Imf::UINT));
  header.channels().insert("A", Imf::Channel(Imf::HALF));
  const std::size_t count = static_cast<std::size_t>(width) * height;
  std::vector<Imath::half> red(count), alpha(count, Imath::half(0.5f));
  std::vector<float> green(count);
  std::vector<unsigned> blue(count);
  for (std::size_t i = 0; i < count; ++i) {
    red[i] = Imath::half(static_cast<float>(i) * 0.25f);
    green[i] = static_cast<float>(i) * 1e-6f - 1.0f;
    blue[i] = static_cast<unsigned>(i * 3);
  }
  Imf::FrameBuffer frame;
  const auto w = static_cast<std::size_t>(width);
  frame.insert("R", Imf::Slice::Make(Imf::HALF, red.data(), window, 2, 2 * w));
  frame.insert("A", Imf::Slice::Make(Imf::HALF, alpha.data(), window, 2, 2 * w));
  frame.insert("G", Imf::Slice::Make(Imf::FLOAT, green.data(), window, 4, 4 * w));
  frame.insert("B", Imf::Slice::Make(Imf::UINT, blue.data(), window, 4, 4 * w));
  const auto file = folder / "mixed.exr";
  Imf::OutputFile output(file.c_str(), header);
  output.setFrameBuffer(frame);
  output.writePixels(height);
  return file;
}

TEST(ReadExr, ConvertsHalfFloatAndIntegerFromAnyDataWindow) {
  TempFolder folder;
  const auto file = mixedFile(folder, 9, 4);
  const Result<Image> image = readExr(file, {"B", "R", "G"});
  ASSERT_TRUE(image.ok()) << image.error().sentence();
  ASSERT_EQ(image->width(), 9);
  ASSERT_EQ(image->height(), 4);
  for (std::size_t i = 0; i < 36; ++i) {
    EXPECT_EQ(image->samples()[3 * i + 0], static_cast<float>(i * 3));
    EXPECT_EQ(image->samples()[3 * i + 1], static_cast<float>(i) * 0.25f);
    EXPECT_EQ(image->samples()[3 * i + 2], static_cast<float>(i) * 1e-6f - 1.0f);
  }
}

TEST(ReadExr, ReadsTiles) {
  TempFolder folder;
  Imf::Header header(20, 10);
  header.channels().insert("Y", Imf::Channel(Imf::FLOAT));
  header.setTileDescription(Imf::TileDescription(8, 8, Imf::ONE_LEVEL));
  std::vector<float> values(200);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i);
  {
    Imf::TiledOutputFile output((folder / "t.exr").c_str(), header);
    Imf::FrameBuffer frame;
    frame.insert("Y", Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(values.data()), 4, 80));
    output.setFrameBuffer(frame);
    output.writeTiles(0, output.numXTiles() - 1, 0, output.numYTiles() - 1);
  }
  const Result<Image> image = readExr(folder / "t.exr", {"Y"});
  ASSERT_TRUE(image.ok()) << image.error().sentence();
  EXPECT_EQ(image->at(19, 9), 199.0f);
}

TEST(ReadExr, RefusesEveryTruncation) {
  TempFolder folder;
  const std::string whole = test::readText(mixedFile(folder, 9, 40));
  ASSERT_GT(whole.size(), 500u);
  for (std::size_t length = 0; length < whole.size(); length += 7) {
    const Result<Image> image =
        readExrBytes(std::string_view(whole).substr(0, length), "cut.exr", {"R", "G", "B"});
    ASSERT_FALSE(image.ok()) << length << " of " << whole.size() << " bytes";
    EXPECT_EQ(image.error().code, ErrorCode::Malformed);
    EXPECT_EQ(image.error().where, "cut.exr");
  }
}

TEST(ReadExr, NamesTheChannelThatIsMissing) {
  TempFolder folder;
  const Result<Image> image = readExr(mixedFile(folder, 2, 2), {"R", "normal.X"});
  ASSERT_FALSE(image.ok());
  EXPECT_EQ(image.error().code, ErrorCode::Malformed);
  EXPECT_NE(image.error().what.find("'normal.X'"), std::string::npos);
  EXPECT_NE(image.error().what.find("'A', 'B', 'G', 'R'"), std::string::npos) << "says what there is";
}

TEST(ReadExr, RefusesAnotherSizeThanExpected) {
  TempFolder folder;
  const auto file = mixedFile(folder, 9, 4);
  EXPECT_TRUE(readExr(file, {"R"}, ImageSize{9, 4}).ok());
  const Result<Image> image = readExr(file, {"R"}, ImageSize{4, 9});
  ASSERT_FALSE(image.ok());
  EXPECT_EQ(image.error().code, ErrorCode::Invalid);
}

TEST(ReadExr, RefusesAbsurdSizesWithoutTakingTheMemory) {
  TempFolder folder;
  std::string bytes = test::readText(mixedFile(folder, 2, 2));
  const std::size_t window = bytes.find(std::string("dataWindow\0box2i\0\x10\0\0\0", 21));
  ASSERT_NE(window, std::string::npos);
  const auto setInt = [&](std::size_t index, std::int32_t value) {
    for (int b = 0; b < 4; ++b) {
      bytes[window + 21 + 4 * index + static_cast<std::size_t>(b)] = static_cast<char>(value >> (8 * b));
    }
  };
  for (const std::int32_t end : {100000, 300000, 2000000000}) {
    setInt(2, end);
    setInt(3, end);
    EXPECT_EQ(readExrBytes(bytes, "x", {"R"}).error().code, ErrorCode::Malformed) << end;
  }
  for (const std::int32_t start : {-2000000000, -1000000000, 1000000000}) {
    for (std::size_t i = 0; i < 4; ++i) setInt(i, start + static_cast<std::int32_t>(i / 2));
    EXPECT_EQ(readExrBytes(bytes, "x", {"R"}).error().code, ErrorCode::Malformed) << start;
  }
}

TEST(ReadExr, RefusesOtherFiles) {
  EXPECT_EQ(readExrBytes("", "x", {"R"}).error().what, "the file is empty");
  EXPECT_EQ(readExrBytes("hello", "x", {"R"}).error().what, "this is not an OpenEXR image");
  EXPECT_EQ(readExr("/nowhere/x.exr", {"R"}).error().code, ErrorCode::NotFound);
  EXPECT_EQ(exrChannels("/nowhere/x.exr").error().code, ErrorCode::NotFound);
}

TEST(ReadExr, MayBeCalledFromManyThreads) {
  TempFolder folder;
  const auto file = mixedFile(folder, 64, 64);
  std::atomic<int> good{0};
  {
    std::vector<std::jthread> threads;
    for (int t = 0; t < 4; ++t) {
      threads.emplace_back([&] {
        for (int i = 0; i < 25; ++i) {
          const Result<Image> image = readExr(file, {"R", "G", "B"});
          if (image && image->at(63, 63, 2) == 4095.0f * 3) ++good;
        }
      });
    }
  }
  EXPECT_EQ(good, 100);
}

TEST(WriteExr, KeepsEveryFloatAndTheAttributes) {
  TempFolder folder;
  Image image(5, 3, 2);
  for (std::size_t i = 0; i < image.samples().size(); ++i) {
    image.samples()[i] = std::sin(static_cast<float>(i)) * 1e-3f;
  }
  ASSERT_TRUE(writeExr(folder / "a.exr", image, {"normal.X", "normal.Y"}, {{"units", "none"}}).ok());
  const Result<Image> back = readExr(folder / "a.exr", {"normal.X", "normal.Y"});
  ASSERT_TRUE(back.ok());
  EXPECT_TRUE(std::equal(back->samples().begin(), back->samples().end(), image.samples().begin()));
  EXPECT_EQ(*exrChannels(folder / "a.exr"), (std::vector<std::string>{"normal.X", "normal.Y"}));
  const Imf::InputFile file((folder / "a.exr").c_str());
  EXPECT_EQ(file.header().typedAttribute<Imf::StringAttribute>("units").value(), "none");
  EXPECT_EQ(test::everythingIn(folder.path()), std::vector<std::string>{"a.exr"});
}

TEST(WriteExr, RoundsToHalf) {
  TempFolder folder;
  Image image(2, 1, 1);
  image.at(0, 0) = 0.1f;
  image.at(1, 0) = 3.0f;
  ASSERT_TRUE(writeExr(folder / "a.exr", image, {"Y"}, {}, true).ok());
  const Result<Image> back = readExr(folder / "a.exr", {"Y"});
  ASSERT_TRUE(back.ok());
  EXPECT_NEAR(back->at(0, 0), 0.1f, 0.1f / 2048) << "eleven bits";
  EXPECT_NE(back->at(0, 0), 0.1f);
  EXPECT_EQ(back->at(1, 0), 3.0f);
}

TEST(WriteExr, SaysWhenItCannot) {
  TempFolder folder;
  Status written = writeExr(folder / "none" / "a.exr", Image(1, 1, 1), {"Y"});
  ASSERT_FALSE(written.ok());
  EXPECT_EQ(written.error().code, ErrorCode::WriteFailed);
  EXPECT_THROW((void)writeExr(folder / "a.exr", Image(1, 1, 1), {"R", "G"}), std::invalid_argument);
  EXPECT_TRUE(test::everythingIn(folder.path()).empty());
}

TEST(RequireFinite, NamesThePixel) {
  Image image(4, 3, 3, 1.0f);
  EXPECT_TRUE(requireFinite(image, "x").ok());
  image.at(2, 1, 1) = NAN;
  Status status = requireFinite(image, "photo.exr");
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, ErrorCode::Invalid);
  EXPECT_EQ(status.error().where, "photo.exr");
  EXPECT_NE(status.error().what.find("a NaN at pixel (2, 1), channel 1"), std::string::npos);
  image.at(0, 0, 0) = -INFINITY;
  EXPECT_NE(requireFinite(image, "x").error().what.find("an infinite value at pixel (0, 0)"),
            std::string::npos);
}

TEST(ReadExr, ReadsPhotographsOfOtherPrograms) {
  PATINA_NEEDS_SHARED("fourier/clean_cardstock/photo_000.exr");
  const Result<Image> image =
      readExr(test::sharedData() / "fourier/clean_cardstock/photo_000.exr", {"R", "G", "B"});
  ASSERT_TRUE(image.ok()) << image.error().sentence();
  EXPECT_EQ(image->width(), 96);
  EXPECT_TRUE(requireFinite(*image, "x").ok());
}

}  // namespace
}  // namespace patina
