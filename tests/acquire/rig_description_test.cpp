#include "engine/acquire/rig_description.h"

#include <gtest/gtest.h>

#include "devices/simulated/live_rig.h"
#include "engine/capture/capture.h"
#include "tests/base/temp_folder.h"

namespace patina {
namespace {

using test::TempFolder;

TEST(RigDescription, ComesBackFromItsFile) {
  const TempFolder folder;
  const RigDescription rig = (*LiveRig::create(LiveRig::desk("laminate", 8)))->description();
  EXPECT_TRUE(rig.problems().empty());
  ASSERT_TRUE(writeRigDescription(folder / "rig.json", rig).ok());
  const Result<RigDescription> read = readRigDescription(folder / "rig.json");
  ASSERT_TRUE(read.ok()) << read.error().sentence();
  EXPECT_EQ(read->camera.intrinsics, rig.camera.intrinsics);
  EXPECT_EQ(read->camera.translationMm, rig.camera.translationMm);
  EXPECT_EQ(read->screen.originMm, rig.screen.originMm);
  EXPECT_EQ(read->screenResponse.level, rig.screenResponse.level);
  EXPECT_EQ(read->radianceOfFullScaleSecond, rig.radianceOfFullScaleSecond);
  EXPECT_EQ(read->sampleWidthMm, rig.sampleWidthMm);
}

TEST(RigDescription, SlipsAreNamed) {
  const TempFolder folder;
  const RigDescription rig = (*LiveRig::create(LiveRig::desk("laminate", 8)))->description();
  ASSERT_TRUE(writeRigDescription(folder / "rig.json", rig).ok());
  const std::string text = test::readText(folder / "rig.json");
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = text;
    const std::size_t at = changed.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    test::writeText(folder / "x.json", changed.replace(at, from.size(), to));
    return readRigDescription(folder / "x.json");
  };
  EXPECT_FALSE(with("\"camera\"", "\"kamera\"").ok());
  EXPECT_FALSE(with("\"radiance_of_full_scale_second\": ", "\"radiance_of_full_scale_second\": -").ok());
  EXPECT_FALSE(with("\"screen_response\": [", "\"screen_response\": [1,").ok());
  EXPECT_EQ(readRigDescription(folder / "none.json").error().code, ErrorCode::NotFound);
  test::writeText(folder / "t.json", "nonsense");
  EXPECT_EQ(readRigDescription(folder / "t.json").error().code, ErrorCode::Malformed);
  EXPECT_FALSE(RigDescription{}.problems().empty());
}

}  // namespace
}  // namespace patina
