// patina-cli calibrate from outside: what it prints, its exit status, what it leaves behind.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "engine/calibration/calibration_file.h"
#include "engine/image/exr.h"
#include "engine/image/png.h"
#include "tests/base/temp_folder.h"
#include "tests/cli/run_program.h"
#include "tests/test_data.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using test::Finished;
using test::TempFolder;
using testing::HasSubstr;

Finished cli(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), PATINA_CLI_PATH);
  return test::runProgram(arguments);
}

TEST(CalibrateCli, HelpSaysUnitsAndDefaults) {
  const Finished all = cli({"calibrate", "--help"});
  EXPECT_EQ(all.status, 0);
  for (const char* part : {"camera", "screen", "white", "response", "board"}) {
    EXPECT_THAT(all.out, HasSubstr(part));
    const Finished help = cli({"calibrate", part, "--help"});
    EXPECT_EQ(help.status, 0) << part;
    EXPECT_THAT(help.out, HasSubstr("--out"));
    EXPECT_THAT(help.out, HasSubstr("default"));
    EXPECT_THAT(help.out, HasSubstr("--progress"));
  }
}

TEST(CalibrateCli, WrongUseAndBadInputAreToldApart) {
  const TempFolder folder;
  const std::string out = folder / "c.json";
  EXPECT_EQ(cli({"calibrate"}).status, 2);
  EXPECT_EQ(cli({"calibrate", "camera", "x.png"}).status, 2) << "no --out";
  EXPECT_EQ(cli({"calibrate", "camera", "x.png", "--out", out, "--board", "chess"}).status, 2);
  EXPECT_EQ(cli({"calibrate", "response", "x.png", "--out", out, "--exposures", "1,2"}).status, 2);
  EXPECT_EQ(cli({"calibrate", "screen", "x.png", "--out", out}).status, 2);
  EXPECT_EQ(cli({"calibrate", "board", "--out", folder / "b.txt"}).status, 2);
  const Finished missing = cli({"calibrate", "camera", folder / "none.png", "--out", out});
  EXPECT_EQ(missing.status, 3);
  EXPECT_THAT(missing.err, HasSubstr("none.png"));
  const Finished nowhere =
      cli({"calibrate", "camera", folder / "none.png", "--out", folder / "no/such/c.json"});
  EXPECT_EQ(nowhere.status, 3);
  ASSERT_TRUE(writePng(folder / "grey.png", Image(100, 80, 3, 0.5f)).ok());
  const Finished noBoard = cli({"calibrate", "camera", folder / "grey.png", "--out", out});
  EXPECT_EQ(noBoard.status, 3);
  EXPECT_THAT(noBoard.err, HasSubstr("grey.png: nothing like a board"));
  const Finished notLinear = cli({"calibrate", "white", folder / "grey.png", "--out", out});
  EXPECT_EQ(notLinear.status, 3);
  EXPECT_THAT(notLinear.err, HasSubstr("--encoding"));
  EXPECT_FALSE(fs::exists(out)) << "nothing half-written";
}

TEST(CalibrateCli, DrawsABoardThatItFinds) {
  const TempFolder folder;
  ASSERT_EQ(cli({"calibrate", "board", "--out", folder / "board.pdf"}).status, 0);
  EXPECT_TRUE(test::readText(folder / "board.pdf").starts_with("%PDF"));
  ASSERT_EQ(
      cli({"calibrate", "board", "--out", folder / "board.svg", "--board", "checkerboard:10x7:20"}).status,
      0);
  EXPECT_THAT(test::readText(folder / "board.svg"), HasSubstr("<svg"));
  ASSERT_EQ(cli({"calibrate", "board", "--out", folder / "board.png", "--square-px", "80"}).status, 0);
  const Result<Image> drawn = readPng(folder / "board.png");
  ASSERT_TRUE(drawn.ok());
  const BoardDetection found = detectBoard(*drawn, Board::forCamera());
  EXPECT_TRUE(found.found) << found.whyNot;
}

TEST(CalibrateCli, CalibratesARealCamera) {
  PATINA_NEEDS_SHARED("calibration/chessboard/left01.jpg");
  const TempFolder folder;
  std::vector<std::string> arguments = {
      "calibrate", "camera",     "--board", "checkerboard:10x7:25", "--out", folder / "camera.json",
      "--device",  "left camera"};
  for (const auto& entry : fs::directory_iterator(test::sharedData() / "calibration/chessboard"))
    if (entry.path().extension() == ".jpg") arguments.push_back(entry.path().string());
  const Finished finished = cli(arguments);
  ASSERT_EQ(finished.status, 0) << finished.err;
  EXPECT_THAT(finished.out, HasSubstr("left08.jpg"));
  EXPECT_THAT(finished.out, HasSubstr("To do better: bring the board to the top left of the picture."));
  const Result<CalibrationRecord> record = readCalibration(folder / "camera.json", "camera");
  ASSERT_TRUE(record.ok()) << record.error().sentence();
  EXPECT_LE(record->residual, 0.20);
  EXPECT_EQ(record->device, "left camera");
  EXPECT_EQ(std::get<StoredCamera>(record->content).views, 13);
  arguments.insert(arguments.end(), {"--leave-out", "left08.jpg"});
  const Finished fewer = cli(arguments);
  ASSERT_EQ(fewer.status, 0) << fewer.err;
  EXPECT_EQ(std::get<StoredCamera>(readCalibration(folder / "camera.json")->content).views, 12);
  EXPECT_LT(readCalibration(folder / "camera.json")->residual, record->residual);
}

TEST(CalibrateCli, MeasuresATileAndAScreensCurve) {
  const TempFolder folder;
  ASSERT_TRUE(writeExr(folder / "tile.exr", Image(80, 60, 3, 0.5f), {"R", "G", "B"}).ok());
  const Finished tile = cli({"calibrate", "white", folder / "tile.exr", "--out", folder / "white.json",
                             "--reflectance", "0.98", "--exposure", "0.5", "--saturation", "1"});
  ASSERT_EQ(tile.status, 0) << tile.err;
  const Result<CalibrationRecord> white = readCalibration(folder / "white.json", "white-tile");
  ASSERT_TRUE(white.ok());
  EXPECT_NEAR(std::get<StoredWhiteTile>(white->content).irradiance[1], M_PI * 0.5 / 0.98 / 0.5, 1e-5);
  const Result<Image> map = readExr(folder / "white.exr", {"R", "G", "B"});
  ASSERT_TRUE(map.ok());
  EXPECT_NEAR(map->at(40, 30, 1), M_PI * 0.5 / 0.98 / 0.5, 1e-5);

  std::vector<std::string> arguments = {"calibrate", "screen", "--out", folder / "curve.json"};
  std::string grey;
  for (int i = 0; i <= 16; ++i) {
    const double value = i / 16.0;
    const fs::path file = folder / ("grey" + std::to_string(i) + ".exr");
    ASSERT_TRUE(
        writeExr(file, Image(20, 20, 3, static_cast<float>(0.01 + std::pow(value, 2.2))), {"R", "G", "B"})
            .ok());
    arguments.push_back(file.string());
    grey += (i ? "," : "") + std::to_string(value);
  }
  arguments.insert(arguments.end(), {"--grey", grey});
  const Finished curve = cli(arguments);
  ASSERT_EQ(curve.status, 0) << curve.err;
  const Result<CalibrationRecord> screen = readCalibration(folder / "curve.json", "screen-response");
  ASSERT_TRUE(screen.ok());
  EXPECT_NEAR(std::get<StoredScreenResponse>(screen->content).response.exponent, 2.2, 0.01);
}

TEST(CalibrateCli, RecoversARealFilmsResponse) {
  PATINA_NEEDS_SHARED("hdr/memorial0061.png");
  const TempFolder folder;
  std::vector<std::string> arguments = {"calibrate",          "response",    "--out",
                                        folder / "film.json", "--exposures", "32,16,8,4,2,1,0.5,0.25"};
  for (int i = 61; i <= 68; ++i)
    arguments.push_back((test::sharedData() / "hdr" / ("memorial00" + std::to_string(i) + ".png")).string());
  const Finished finished = cli(arguments);
  ASSERT_EQ(finished.status, 0) << finished.err;
  EXPECT_THAT(finished.out, HasSubstr("not linear"));
  EXPECT_TRUE(readResponse(folder / "film.json").ok()) << "a bundle can name it";
  EXPECT_TRUE(readCalibration(folder / "film.json", "camera-response").ok());
}

TEST(CalibrateCli, ABracketIsMergedToLinearLight) {
  const TempFolder folder;
  // A ramp whose bright end clips in the longer exposure and whose dark end is noise-free in both.
  Image shorter(64, 16, 3), longer(64, 16, 3);
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 64; ++x)
      for (int c = 0; c < 3; ++c) {
        const float light = 0.2f + 2.0f * static_cast<float>(x) / 63;
        shorter.at(x, y, c) = 0.25f * light;
        longer.at(x, y, c) = std::min(1.0f, light);
      }
  ASSERT_TRUE(writeExr(folder / "short.exr", shorter, {"R", "G", "B"}).ok());
  ASSERT_TRUE(writeExr(folder / "long.exr", longer, {"R", "G", "B"}).ok());
  const std::string out = folder / "merged.exr";
  const Finished merged = cli({"calibrate", "merge", folder / "short.exr", folder / "long.exr", "--exposures",
                               "0.25,1", "--out", out});
  ASSERT_EQ(merged.status, 0) << merged.err;
  const Result<Image> radiance = readExr(out, {"R", "G", "B"});
  ASSERT_TRUE(radiance.ok());
  for (const int x : {0, 20, 40, 63})
    EXPECT_NEAR(radiance->at(x, 8, 1), 0.2f + 2.0f * static_cast<float>(x) / 63, 2e-3f) << x;
  EXPECT_EQ(cli({"calibrate", "merge", folder / "short.exr", "--exposures", "1,2", "--out", out}).status, 2);
}

TEST(CalibrateCli, RechecksATileAndSaysWhenItsLightChanged) {
  const TempFolder folder;
  // Light that falls off a little, as a lamp's does.
  const auto tileUnder = [](float light) {
    Image tile(40, 30, 3);
    for (int y = 0; y < 30; ++y)
      for (int x = 0; x < 40; ++x)
        for (int c = 0; c < 3; ++c) tile.at(x, y, c) = light * (1 - 0.001f * static_cast<float>(x + y));
    return tile;
  };
  const Image tile = tileUnder(0.6f);
  ASSERT_TRUE(writeExr(folder / "tile.exr", tile, {"R", "G", "B"}).ok());
  const std::string white = folder / "white.json";
  ASSERT_EQ(cli({"calibrate", "white", folder / "tile.exr", "--out", white}).status, 0);
  const Finished same = cli({"calibrate", "recheck", white, folder / "tile.exr"});
  EXPECT_EQ(same.status, 0) << same.err;
  EXPECT_THAT(same.out, HasSubstr("Good: "));
  const Image dimmer = tileUnder(0.55f);
  ASSERT_TRUE(writeExr(folder / "dimmer.exr", dimmer, {"R", "G", "B"}).ok());
  const Finished changed = cli({"calibrate", "recheck", white, folder / "dimmer.exr"});
  EXPECT_EQ(changed.status, 3);
  EXPECT_THAT(changed.out, HasSubstr("Not good: "));
  EXPECT_EQ(cli({"calibrate", "recheck", white, folder / "tile.exr", folder / "tile.exr"}).status, 2);
}

}  // namespace
}  // namespace patina
