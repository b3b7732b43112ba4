// The house rules on the whole tree, and on a small tree with planted violations so that the scan itself is
// known to see.
#include "tests/house/house_rules.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

namespace patina::test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr int kMaxLines = 600;
// The repository held more than this when the test was written; fewer means that the scan looks in the wrong
// place.
constexpr std::size_t kFewestSourceFiles = 20;

const fs::path kRoot = PATINA_SOURCE_DIR;

TEST(HouseRules, TheScanFindsTheSources) {
  EXPECT_GE(sourceFiles(kRoot).size(), kFewestSourceFiles);
}

TEST(HouseRules, NoIncludeClimbs) {
  const auto violations = checkIncludes(kRoot);
  EXPECT_EQ(describe(violations), "");
}

TEST(HouseRules, NothingLinksQt5OrHighgui) {
  const auto violations = checkLinkedModules(kRoot);
  EXPECT_EQ(describe(violations), "");
}

TEST(HouseRules, FilesStayShort) {
  const auto violations = checkLengths(kRoot, kMaxLines);
  EXPECT_EQ(describe(violations), "");
}

TEST(HouseRules, NoPathsOfSomebodysMachine) {
  const auto violations = checkForeignPaths(kRoot);
  EXPECT_EQ(describe(violations), "");
}

TEST(HouseRules, NoAmbiguousNames) {
  const auto violations = checkNames(kRoot);
  EXPECT_EQ(describe(violations), "");
}

// A temporary tree that a test plants files in.
class PlantedTree : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "patina_house_XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    root_ = pattern;
    plant("engine/base/result.h", "#pragma once\n#include <string>\n");
    plant("engine/fourier/fit.h", "#pragma once\n#include <Eigen/Core>\n#include \"engine/base/result.h\"\n");
    plant("devices/camera.h", "#pragma once\n#include \"engine/base/result.h\"\n");
    plant("widgets/view.h",
          "#pragma once\n#include <QWidget>\n#include <vtkNew.h>\n#include \"engine/fourier/fit.h\"\n");
    plant("app/main.cpp",
          "#include <CLI/CLI.hpp>\n#include \"devices/camera.h\"\n#include \"widgets/view.h\"\n");
  }
  void TearDown() override { fs::remove_all(root_); }

  void plant(const fs::path& file, const std::string& text) {
    fs::create_directories((root_ / file).parent_path());
    std::ofstream(root_ / file) << text;
  }

  // The only violation in the tree after planting, or a description of what was found instead.
  std::string onlyInclude(const fs::path& file, const std::string& include) {
    plant(file, "// first line\n#include " + include + "\n");
    const auto violations = checkIncludes(root_);
    if (violations.size() != 1)
      return "found " + std::to_string(violations.size()) + ":\n" + describe(violations);
    EXPECT_EQ(violations[0].file, file.string());
    EXPECT_EQ(violations[0].line, 2);
    return violations[0].rule;
  }

  fs::path root_;
};

TEST_F(PlantedTree, IsCleanToBeginWith) {
  EXPECT_THAT(describe(checkIncludes(root_)), IsEmpty());
  EXPECT_THAT(sourceFiles(root_), SizeIs(5));
}

TEST_F(PlantedTree, EngineMayNotKnowQt) {
  EXPECT_THAT(onlyInclude("engine/base/bad.cpp", "<QString>"), HasSubstr("engine/ may not know"));
}

TEST_F(PlantedTree, EngineMayNotKnowVtk) {
  EXPECT_THAT(onlyInclude("engine/base/bad.h", "<vtkImageData.h>"), HasSubstr("engine/ may not know"));
}

TEST_F(PlantedTree, EngineMayNotKnowADeviceApi) {
  EXPECT_THAT(onlyInclude("engine/base/bad.h", "<linux/videodev2.h>"), HasSubstr("engine/ may not know"));
}

TEST_F(PlantedTree, EngineMayNotEnterOtherFolders) {
  EXPECT_THAT(onlyInclude("engine/base/bad.h", "\"devices/camera.h\""),
              HasSubstr("engine/ may not enter devices/"));
}

TEST_F(PlantedTree, EngineRoomsFollowTheLight) {
  EXPECT_THAT(onlyInclude("engine/base/bad.h", "\"engine/fourier/fit.h\""), HasSubstr("climbs"));
}

TEST_F(PlantedTree, AnUnknownEngineRoomIsNamed) {
  EXPECT_THAT(onlyInclude("engine/attic/bad.h", "\"engine/base/result.h\""),
              HasSubstr("not in the order of rooms"));
}

TEST_F(PlantedTree, OpenCvStaysOutOfEngineHeaders) {
  EXPECT_THAT(onlyInclude("engine/base/bad.h", "<opencv2/core.hpp>"), HasSubstr("stays inside .cpp"));
}

TEST_F(PlantedTree, OpenCvIsWelcomeInEngineSources) {
  EXPECT_THAT(onlyInclude("engine/base/good.cpp", "<opencv2/core.hpp>"), HasSubstr("found 0"));
}

TEST_F(PlantedTree, OpenCvStaysOutOfTheWindow) {
  EXPECT_THAT(onlyInclude("widgets/bad.cpp", "<opencv2/imgproc.hpp>"), HasSubstr("widgets/ may not know"));
}

TEST_F(PlantedTree, HighguiStaysOutEverywhere) {
  EXPECT_THAT(onlyInclude("tests/bad.cpp", "<opencv2/highgui.hpp>"), HasSubstr("stay out"));
}

TEST_F(PlantedTree, DevicesMayNotKnowWidgets) {
  EXPECT_THAT(onlyInclude("devices/bad.cpp", "<QWidget>"), HasSubstr("knows no widgets"));
}

TEST_F(PlantedTree, DevicesMayNameGuiModulesHeaders) {
  EXPECT_THAT(onlyInclude("devices/good.cpp", "<QtGui/QScreen>"), HasSubstr("found 0"));
}

TEST_F(PlantedTree, WidgetsMayNotEnterDevices) {
  EXPECT_THAT(onlyInclude("widgets/bad.cpp", "\"devices/camera.h\""),
              HasSubstr("widgets/ may not enter devices/"));
}

TEST_F(PlantedTree, WidgetsMayNotEnterTheApp) {
  plant("app/session.h", "");
  EXPECT_THAT(onlyInclude("widgets/bad.cpp", "\"app/session.h\""), HasSubstr("widgets/ may not enter app/"));
}

TEST_F(PlantedTree, IncludesAreWrittenFromTheRoot) {
  EXPECT_THAT(onlyInclude("engine/base/bad.cpp", "\"result.h\""), HasSubstr("from the root"));
  fs::remove(root_ / "engine/base/bad.cpp");
  EXPECT_THAT(onlyInclude("engine/fourier/bad.cpp", "\"../base/result.h\""), HasSubstr("from the root"));
}

TEST_F(PlantedTree, AnIncludeOfNothingIsNamed) {
  EXPECT_THAT(onlyInclude("engine/base/bad.cpp", "\"engine/base/gone.h\""), HasSubstr("no such file"));
}

TEST_F(PlantedTree, SpacesDoNotHideAnInclude) {
  plant("engine/base/bad.cpp", "  #  include<QString> // harmless\n");
  EXPECT_THAT(checkIncludes(root_), SizeIs(1));
}

TEST_F(PlantedTree, Qt5StaysOut) {
  EXPECT_THAT(onlyInclude("widgets/bad.cpp", "<QVTKOpenGLNativeWidget.h>"), HasSubstr("Qt 5"));
  plant("widgets/CMakeLists.txt",
        "# Qt5 in a comment is harmless\nfind_package(Qt5 REQUIRED)\nlink(opencv_highgui)\n");
  const auto violations = checkLinkedModules(root_);
  ASSERT_THAT(violations, SizeIs(2));
  EXPECT_EQ(violations[0].line, 2);
  EXPECT_EQ(violations[1].line, 3);
}

TEST_F(PlantedTree, LongFilesAreSeen) {
  plant("app/long.cpp", std::string(kMaxLines + 1, '\n'));
  plant("app/just_right.cpp", std::string(kMaxLines, '\n'));
  const auto violations = checkLengths(root_, kMaxLines);
  ASSERT_THAT(violations, SizeIs(1));
  EXPECT_EQ(violations[0].file, "app/long.cpp");
}

TEST_F(PlantedTree, PathsOfAMachineAreSeen) {
  // Put together here, so that this file does not hold them.
  for (const std::string folder : {"home", "work", "tmp", "root"}) {
    const std::string path = "/" + folder + "/someone";
    plant("docs/notes.md", "One\nSee " + path + ".\n");
    const auto violations = checkForeignPaths(root_);
    ASSERT_THAT(violations, SizeIs(1)) << path;
    EXPECT_EQ(violations[0].line, 2);
  }
  const auto inside = [](const std::string& folder) { return "/" + folder + "/"; };
  plant("docs/notes.md", "engine" + inside("work") + "a, ${x}" + inside("tmp") + "b, ~" + inside("home") +
                             "c and https://x.org" + inside("home") + "y are no paths of a machine.\n");
  EXPECT_THAT(describe(checkForeignPaths(root_)), IsEmpty());
}

TEST_F(PlantedTree, AmbiguousNamesAreSeen) {
  plant("app/names.cpp",
        "// roughness in a comment\nconst char* k = \"roughness\";\nfloat perceptualRoughness = 0;\nfloat wi "
        "= 0;\n");
  const auto violations = checkNames(root_);
  ASSERT_THAT(violations, SizeIs(1));
  EXPECT_EQ(violations[0].line, 4);
}

TEST(WithoutCommentsAndStrings, KeepsLinesAndCode) {
  EXPECT_EQ(withoutCommentsAndStrings("a // b\nc /* d\ne */ f"), "a     \nc     \n     f");
  EXPECT_EQ(withoutCommentsAndStrings("x = \"a\\\"b\" + 'c' + 1'000;"), "x =        +     + 1'000;");
  EXPECT_EQ(withoutCommentsAndStrings("y = R\"re(wi \" )re\" wo"), "y = " + std::string(14, ' ') + " wo");
}

TEST(ForbiddenLibraries, AreFoundInLddsOutput) {
  EXPECT_THAT(
      forbiddenLibraries(
          "\tlibQt6Core.so.6 => /usr/lib/libQt6Core.so.6 (0x1)\n\tlibc.so.6 => /lib/libc.so.6 (0x2)\n"),
      IsEmpty());
  EXPECT_THAT(forbiddenLibraries(
                  "\tlibQt5Core.so.5 => /usr/lib/x (0x1)\n\tlibopencv_highgui.so.406 => /usr/lib/y (0x2)\n"),
              ElementsAre("libQt5Core.so.5", "libopencv_highgui.so.406"));
  EXPECT_THAT(forbiddenLibraries("\tlibvtkCommonCore.so.9 => not found\n"),
              ElementsAre("libvtkCommonCore.so.9 => not found"));
}

}  // namespace
}  // namespace patina::test
