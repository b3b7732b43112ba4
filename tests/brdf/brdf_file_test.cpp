#include "engine/brdf/brdf_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "engine/brdf/analytic_brdf.h"
#include "engine/brdf/tabulated_brdf.h"
#include "tests/base/temp_folder.h"
#include "tests/brdf/brdf_samples.h"

namespace patina {
namespace {

using testing::HasSubstr;

TEST(BrdfFile, TellsTheFormatByTheContent) {
  const test::TempFolder folder;
  // Endings that lie.
  test::writeText(folder / "a.dat", test::smallRgl({0.0f}, [](int, int, int) { return 1.0f; }).build());
  test::writeText(folder / "b.bsdf", "#DIM 1 1\n#PARAM_IN COS_TH\n#PARAM_OUT INV_STERADIAN\n0.5 1\n1 2\n");
  const auto lambert = parseAnalyticBrdf("lambert");
  const auto table = tabulate(**lambert);
  ASSERT_TRUE(table && writeMerl(folder / "c.txt", **table));
  for (const auto& [name, format] : {std::pair{"a.dat", "rgl"}, {"b.bsdf", "alta"}, {"c.txt", "merl"}}) {
    const Result<BrdfPtr> brdf = readBrdf(folder / name);
    ASSERT_TRUE(brdf) << brdf.error().sentence();
    EXPECT_EQ((*brdf)->origin().format, format);
    EXPECT_EQ((*brdf)->origin().file, (folder / name).string());
  }
}

TEST(BrdfFile, SaysWhatItCannotRead) {
  const test::TempFolder folder;
  EXPECT_EQ(readBrdf(folder / "none").error().code, ErrorCode::NotFound);
  EXPECT_EQ(readBrdf(folder.path()).error().code, ErrorCode::NotFound);
  test::writeText(folder / "empty.binary", "");
  EXPECT_THAT(readBrdf(folder / "empty.binary").error().sentence(), HasSubstr("empty"));
  test::writeText(folder / "photo.binary", "\x89PNG\r\n\x1a\n and so on");
  EXPECT_EQ(readBrdf(folder / "photo.binary").error().code, ErrorCode::Unsupported);
  const std::uint32_t sizes[] = {90, 90, 180};
  test::writeText(folder / "cut.binary", std::string(reinterpret_cast<const char*>(sizes), 12) + "short");
  EXPECT_THAT(readBrdf(folder / "cut.binary").error().sentence(), HasSubstr("cut off"));
}

TEST(BrdfFile, ListsFilesByTheirEndingSorted) {
  const test::TempFolder folder;
  for (const char* name : {"b.binary", "a.BSDF", "c.dat", "d.alta", "e.txt"})
    test::writeText(folder / name, "x");
  std::filesystem::create_directory(folder / "z.binary");
  const auto files = listBrdfFiles(folder.path());
  ASSERT_TRUE(files);
  std::vector<std::string> names;
  for (const auto& file : *files) names.push_back(file.filename().string());
  EXPECT_THAT(names, testing::ElementsAre("a.BSDF", "b.binary", "c.dat", "d.alta"));
  EXPECT_EQ(listBrdfFiles(folder / "none").error().code, ErrorCode::NotFound);
}

}  // namespace
}  // namespace patina
