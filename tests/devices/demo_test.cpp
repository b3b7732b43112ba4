#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "engine/capture/capture.h"
#include "engine/fourier/maps.h"
#include "engine/image/png.h"

namespace patina {
namespace {

namespace fs = std::filesystem;

int run(const std::string& arguments, const fs::path& log) {
  const std::string command = std::string(PATINA_CLI) + " " + arguments + " > " + log.string() + " 2>&1";
  const int status = std::system(command.c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

std::string text(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

class Demo : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "patina-demo-XXXXXX").string();
    folder_ = mkdtemp(name.data());
  }
  void TearDown() override {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  fs::path folder_;
};

TEST_F(Demo, LeavesACaptureAFitAndPicturesAndCanBeRunAgain) {
  const fs::path out = folder_ / "out", log = folder_ / "log.txt";
  for (int again = 0; again < 2; ++again) {
    ASSERT_EQ(run("demo --scene mirror-mix --out " + out.string(), log), 0) << text(log);
    EXPECT_TRUE(readFourierCapture(out / "capture").ok());
    const auto maps = readMaps(out / "fit" / "maps");
    ASSERT_TRUE(maps.ok()) << maps.error().sentence();
    EXPECT_GT(maps->width, 40);
    EXPECT_TRUE(fs::exists(out / "fit" / "fit.json"));
    for (const char* picture : {"maps.png", "relit.png", "spheres.png"}) {
      const auto image = readPng(out / picture);
      ASSERT_TRUE(image.ok()) << picture;
      float low = 1, high = 0;
      for (float v : image->samples()) low = std::min(low, v), high = std::max(high, v);
      EXPECT_GT(high - low, 0.5f) << picture << " shows nothing";
      EXPECT_NE(text(log).find((out / picture).string()), std::string::npos)
          << "the output names what to look at";
    }
    EXPECT_EQ(std::distance(fs::directory_iterator(out), {}), 5)
        << "capture, fit and three pictures, nothing half-written";
  }
}

TEST_F(Demo, AnUnknownSceneIsWrongUseAndLeavesNothing) {
  const fs::path log = folder_ / "log.txt";
  EXPECT_EQ(run("demo --scene granite --out " + (folder_ / "out").string(), log), 2);
  EXPECT_NE(text(log).find("cardstock"), std::string::npos);
  EXPECT_FALSE(fs::exists(folder_ / "out"));
}

TEST_F(Demo, AStrangersFolderIsBadInput) {
  const fs::path log = folder_ / "log.txt";
  fs::create_directories(folder_ / "out" / "capture");
  std::ofstream(folder_ / "out" / "capture" / "thesis.txt") << "irreplaceable";
  EXPECT_EQ(run("demo --out " + (folder_ / "out").string(), log), 3);
  EXPECT_TRUE(fs::exists(folder_ / "out" / "capture" / "thesis.txt"));
}

}  // namespace
}  // namespace patina
