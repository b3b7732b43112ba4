#include "devices/watched_folder/watched_folder.h"

#include <gtest/gtest.h>
#include <tiffio.h>

#include <chrono>
#include <cstring>
#include <fstream>
#include <thread>

#include "engine/acquire/frame_image.h"
#include "engine/image/exr.h"
#include "engine/image/png.h"
#include "tests/base/temp_folder.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using test::TempFolder;

void writeGrey(const fs::path& file, float value) {
  const Image image(4, 3, 3, value);
  ASSERT_TRUE(writeExr(file, image, {"R", "G", "B"}).ok());
}

void writeTiff(const fs::path& file, int bits, const std::vector<std::uint8_t>& row, int width, int rows) {
  TIFF* tiff = TIFFOpen(file.c_str(), "w");
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, width);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, rows);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 3);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_RGB);
  if (bits == 32) TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_IEEEFP);
  for (int y = 0; y < rows; ++y)
    TIFFWriteScanline(tiff, const_cast<std::uint8_t*>(row.data()), static_cast<std::uint32_t>(y));
  TIFFClose(tiff);
}

void add(std::vector<std::uint8_t>& bytes, const void* from, std::size_t size) {
  const auto* first = static_cast<const std::uint8_t*>(from);
  bytes.insert(bytes.end(), first, first + size);
}

/// A raw photograph as DNG, made from the format's description: 16-bit samples, RGGB, black 256, white 4095,
/// 1/50 s.
void writeDng(const fs::path& file, int width, int height, const std::vector<std::uint16_t>& samples) {
  TIFF* tiff = TIFFOpen(file.c_str(), "w");
  TIFFSetField(tiff, TIFFTAG_SUBFILETYPE, 0);
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, width);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, height);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 16);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_NONE);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, 32803);
  TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, height);
  TIFFSetField(tiff, TIFFTAG_MAKE, "Patina");
  TIFFSetField(tiff, TIFFTAG_MODEL, "Test");
  TIFFSetField(tiff, TIFFTAG_UNIQUECAMERAMODEL, "Patina Test");
  const std::uint8_t version[4] = {1, 4, 0, 0};
  TIFFSetField(tiff, TIFFTAG_DNGVERSION, version);
  const std::uint16_t repeat[2] = {2, 2};
  TIFFSetField(tiff, TIFFTAG_CFAREPEATPATTERNDIM, repeat);
  const std::uint8_t pattern[4] = {0, 1, 1, 2};
  TIFFSetField(tiff, TIFFTAG_CFAPATTERN, 4, pattern);
  const float black[4] = {256, 256, 256, 256};
  const std::uint16_t blackRepeat[2] = {2, 2};
  TIFFSetField(tiff, TIFFTAG_BLACKLEVELREPEATDIM, blackRepeat);
  TIFFSetField(tiff, TIFFTAG_BLACKLEVEL, 4, black);
  const std::uint32_t white = 4095;
  TIFFSetField(tiff, TIFFTAG_WHITELEVEL, 1, &white);
  const float matrix[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  TIFFSetField(tiff, TIFFTAG_COLORMATRIX1, 9, matrix);
  TIFFSetField(tiff, TIFFTAG_DNGBACKWARDVERSION, version);
  TIFFSetField(tiff, TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT);
  const float neutral[3] = {1, 1, 1};
  TIFFSetField(tiff, TIFFTAG_ASSHOTNEUTRAL, 3, neutral);
  for (int y = 0; y < height; ++y)
    TIFFWriteScanline(tiff, const_cast<std::uint16_t*>(samples.data() + static_cast<std::size_t>(y) * width),
                      static_cast<std::uint32_t>(y));
  TIFFClose(tiff);
}

TEST(Photograph, ExrIsLight) {
  const TempFolder folder;
  writeGrey(folder / "a.exr", 1.75f);
  const Result<Frame> frame = readPhotograph(folder / "a.exr");
  ASSERT_TRUE(frame.ok());
  EXPECT_NEAR(linearImage(*frame)->at(1, 1, 2), 1.75, 1e-6);
}

TEST(Photograph, TiffOf16BitsAndFloatIsLightOf8BitsIsEncoded) {
  const TempFolder folder;
  std::vector<std::uint8_t> row;
  const std::uint16_t words[6] = {13107, 26214, 39321, 0, 65535, 6553};  // 0.2 0.4 0.6, 0 1 0.1
  add(row, words, sizeof words);
  writeTiff(folder / "w.tif", 16, row, 2, 3);
  const auto sixteen = readPhotograph(folder / "w.tif");
  ASSERT_TRUE(sixteen.ok()) << sixteen.error().sentence();
  const Image image = linearImage(*sixteen).value();
  EXPECT_NEAR(image.at(0, 2, 0), 0.2, 1e-5);
  EXPECT_NEAR(image.at(0, 0, 2), 0.6, 1e-5);
  EXPECT_NEAR(image.at(1, 1, 1), 1, 1e-6);

  row.clear();
  const float floats[6] = {0.25f, 3.5f, -0.125f, 1, 2, 3};
  add(row, floats, sizeof floats);
  writeTiff(folder / "f.tiff", 32, row, 2, 1);
  EXPECT_EQ(linearImage(readPhotograph(folder / "f.tiff").value()).value().at(0, 0, 1), 3.5f);

  writeTiff(folder / "b.tif", 8, {188, 188, 0, 0, 0, 255}, 2, 1);
  const auto eight = readPhotograph(folder / "b.tif");
  ASSERT_TRUE(eight.ok());
  EXPECT_FALSE(isLinear(eight->format.layout));
  EXPECT_NEAR(linearImage(*eight).value().at(0, 0, 0), 0.503, 0.001);
}

TEST(Photograph, PngOf8BitsIsEncoded) {
  const TempFolder folder;
  ASSERT_TRUE(writePng(folder / "a.png", Image(3, 2, 3, 188 / 255.0f)).ok());
  const auto frame = readPhotograph(folder / "a.png");
  ASSERT_TRUE(frame.ok());
  EXPECT_NEAR(linearImage(*frame).value().at(0, 0, 0), 0.503, 0.001);
}

TEST(Photograph, RawIsTheSensorsOwnNumbersBetweenItsLevels) {
  const TempFolder folder;
  constexpr int kWidth = 256, kHeight = 192;  // smaller ones some libraries take for thumbnails
  // Red 0.5, green 0.25, blue 0.125 of the range from 256 to 4095.
  std::vector<std::uint16_t> samples;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const double level = y % 2 == 0 ? (x % 2 == 0 ? 0.5 : 0.25) : (x % 2 == 0 ? 0.25 : 0.125);
      samples.push_back(static_cast<std::uint16_t>(256 + level * (4095 - 256) + 0.5));
    }
  writeDng(folder / "a.dng", kWidth, kHeight, samples);
  const auto frame = readPhotograph(folder / "a.dng");
  ASSERT_TRUE(frame.ok()) << frame.error().sentence();
  EXPECT_EQ(frame->format.layout, PixelLayout::Bayer16);
  const Image image = linearImage(*frame).value();
  constexpr double kCode = 1.0 / 3839;
  EXPECT_NEAR(image.at(20, 20, 0), 0.5, kCode);
  EXPECT_NEAR(image.at(21, 20, 1), 0.25, kCode);
  EXPECT_NEAR(image.at(33, 31, 2), 0.125, kCode);
}

TEST(Photograph, WhatCantBeReadIsASentence) {
  const TempFolder folder;
  EXPECT_EQ(readPhotograph(folder / "no.exr").error().code, ErrorCode::NotFound);
  test::writeText(folder / "a.txt", "x");
  EXPECT_EQ(readPhotograph(folder / "a.txt").error().code, ErrorCode::Unsupported);
  for (const char* name : {"a.exr", "a.tif", "a.png", "a.cr2", "a.jpg", "a.dng"}) {
    test::writeText(folder / name, "this is no photograph");
    const auto frame = readPhotograph(folder / name);
    ASSERT_FALSE(frame.ok()) << name;
    EXPECT_FALSE(frame.error().what.empty());
  }
}

TEST(WatchedFolder, WaitsForAPhotographThatIsNewAndWhole) {
  const TempFolder folder;
  writeGrey(folder / "old.exr", 0.1f);
  WatchedFolderProvider provider;
  auto camera = provider.open("folder:" + folder.path().string()).value();
  const TempFolder elsewhere;
  writeGrey(elsewhere / "new.exr", 0.7f);
  const std::string bytes = test::readText(elsewhere / "new.exr");
  std::jthread writer([&] {
    // In two halves, as over a slow cable.
    std::this_thread::sleep_for(milliseconds(150));
    std::ofstream out(folder / "new.exr", std::ios::binary);
    out << bytes.substr(0, bytes.size() / 2) << std::flush;
    std::this_thread::sleep_for(milliseconds(700));
    out << bytes.substr(bytes.size() / 2) << std::flush;
  });
  const auto frames = camera->still({}, {});
  ASSERT_TRUE(frames.ok()) << frames.error().sentence();
  EXPECT_NEAR(linearImage(frames->front()).value().at(0, 0, 0), 0.7, 1e-6);
}

TEST(WatchedFolder, AFinishedSetComesInTheOrderOfItsNames) {
  const TempFolder folder;
  for (const int i : {3, 1, 2})
    writeGrey(folder / ("p" + std::to_string(i) + ".exr"), 0.1f * static_cast<float>(i));
  WatchedFolderProvider provider;
  auto camera = provider.open("folder:" + folder.path().string() + "?existing").value();
  for (const int i : {1, 2, 3}) {
    const auto frames = camera->still({}, {});
    ASSERT_TRUE(frames.ok());
    EXPECT_NEAR(linearImage(frames->front()).value().at(0, 0, 0), 0.1 * i, 1e-6);
  }
  StillRequest request;
  request.timeout = milliseconds(300);
  EXPECT_NE(camera->still(request, {}).error().what.find("no picture came"), std::string::npos);
}

TEST(WatchedFolder, AGoneFolderADamagedFileAndCancellingAreSentences) {
  auto folder = std::make_unique<TempFolder>();
  WatchedFolderProvider provider;
  EXPECT_EQ(provider.open("folder:/nowhere/at/all").error().code, ErrorCode::NotFound);
  auto camera = provider.open("folder:" + folder->path().string()).value();
  std::stop_source stop;
  std::jthread stopper([&] {
    std::this_thread::sleep_for(milliseconds(100));
    stop.request_stop();
  });
  EXPECT_EQ(camera->still({}, stop.get_token()).error().code, ErrorCode::Cancelled);
  EXPECT_EQ(camera->set(CameraControlId::ExposureS, 1).error().code, ErrorCode::Unsupported);
  folder.reset();
  EXPECT_EQ(camera->still({}, {}).error().code, ErrorCode::NotFound);
}

}  // namespace
}  // namespace patina
