#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "engine/image/exr.h"
#include "engine/report/explanation_files.h"
#include "tests/base/temp_folder.h"
#include "tests/report/made_up_explanation.h"
#include "tests/ui/fake_fit.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using test::TempFolder;

Explanation withFits() {
  Explanation e = test::madeUpExplanation();
  FourierCapture capture;
  capture.folder = "/somewhere/brushed_plate";
  capture.sampleWidthMm = 48, capture.sampleHeightMm = 32;
  e.fourierBefore = e.fourierAfter = std::make_shared<const test::FakeFit>(capture, 24, 16);
  return e;
}

TEST(WriteExplanation, LeavesReportFitAndMapsOfEffects) {
  TempFolder folder;
  const fs::path out = folder / "out";
  const Status written = writeExplanation(out, withFits());
  ASSERT_TRUE(written.ok()) << written.error().sentence();
  for (const char* file :
       {"explain.json", "report.html", "fit.json", "maps/diffuse.exr", "maps/anisotropy_ratio.exr"})
    EXPECT_TRUE(fs::exists(out / file)) << file;
  const auto map = readExr(out / "maps/anisotropy_ratio.exr", {"anisotropy.ratio"});
  ASSERT_TRUE(map.ok()) << map.error().sentence();
  EXPECT_EQ(map->width(), 48);
  EXPECT_FLOAT_EQ(map->at(0, 0), 1);
  const auto fit = nlohmann::json::parse(test::readText(out / "fit.json"));
  EXPECT_EQ(fit.at("options").at("effects"), "anisotropy,flicker");
  const auto json = nlohmann::json::parse(test::readText(out / "explain.json"));
  EXPECT_EQ(json.at("effects")[0].at("maps")[0], "maps/anisotropy_ratio.exr");
}

TEST(WriteExplanation, ANewResultTakesAwayTheMapsOfTheOldOne) {
  TempFolder folder;
  const fs::path out = folder / "out";
  ASSERT_TRUE(writeExplanation(out, withFits()).ok());
  test::writeText(out / "maps" / "mine.exr", "a person's own");
  Explanation clean = withFits();
  clean.effects.clear();
  ASSERT_TRUE(writeExplanation(out, clean).ok());
  EXPECT_FALSE(fs::exists(out / "maps/anisotropy_ratio.exr"));
  EXPECT_TRUE(fs::exists(out / "maps/mine.exr"));
  EXPECT_TRUE(fs::exists(out / "maps/diffuse.exr"));
}

TEST(WriteExplanation, AStrangersListOfMapsRemovesNothing) {
  TempFolder folder;
  const fs::path out = folder / "out";
  fs::create_directories(out);
  test::writeText(folder / "precious.exr", "x");
  test::writeText(
      out / "explain.json",
      R"({"effects": [{"maps": ["../precious.exr", "/etc/hostname", "maps/../../precious.exr", 7]}]})");
  ASSERT_TRUE(writeExplanation(out, withFits()).ok());
  EXPECT_TRUE(fs::exists(folder / "precious.exr"));
}

TEST(WriteExplanation, FailureLeavesTheEarlierResult) {
  TempFolder folder;
  const fs::path out = folder / "out";
  ASSERT_TRUE(writeExplanation(out, withFits()).ok());
  const std::string before = test::readText(out / "explain.json");
  fs::remove(out / "report.html");
  fs::create_directories(out / "report.html");  // a folder stands where the page should be
  Explanation other = withFits();
  other.kind = "another";
  const Status written = writeExplanation(out, other);
  ASSERT_FALSE(written.ok());
  EXPECT_EQ(written.error().code, ErrorCode::Refused);
  EXPECT_EQ(test::readText(out / "explain.json"), before);
}

TEST(WriteExplanation, NeverWritesIntoABundle) {
  TempFolder folder;
  const fs::path bundle = folder / "bundle";
  fs::create_directories(bundle);
  Explanation e = withFits();
  e.bundles = {bundle};
  for (const fs::path& out : {bundle, bundle / "result", bundle / "a" / ".." / "b"}) {
    const Status written = writeExplanation(out, e);
    ASSERT_FALSE(written.ok()) << out;
    EXPECT_EQ(written.error().code, ErrorCode::Refused);
  }
  const fs::path other = folder / "other";
  fs::create_directories(other);
  test::writeText(other / "capture.json", "{}");
  EXPECT_FALSE(writeExplanation(other, e).ok()) << "another bundle";
  EXPECT_TRUE(test::everythingIn(bundle).empty());
}

TEST(WriteExplanation, WithoutAFitThereAreStillWords) {
  TempFolder folder;
  Explanation e = test::hostileExplanation();
  e.cancelled = true;
  const Status written = writeExplanation(folder / "out", e);
  ASSERT_TRUE(written.ok()) << written.error().sentence();
  EXPECT_TRUE(fs::exists(folder / "out" / "report.html"));
  for (const std::string& name : test::everythingIn(folder / "out"))
    EXPECT_EQ(name.find('<'), std::string::npos) << name;
}

}  // namespace
}  // namespace patina
