#include <gtest/gtest.h>

#include <fstream>

#include "engine/brdf/brdf_file.h"
#include "engine/brdf/tabulated_brdf.h"
#include "engine/twoshot/basis.h"
#include "tests/base/temp_folder.h"

namespace patina {
namespace {

namespace fs = std::filesystem;

/// The most memory that this process held at once, since `forgetPeak`; 0 where the system doesn't tell.
double peakGibibytes() {
  std::ifstream status("/proc/self/status");
  for (std::string key; status >> key;) {
    double kibibytes = 0;
    if (key == "VmHWM:" && status >> kibibytes) return kibibytes / 1024 / 1024;
  }
  return 0;
}

bool forgetPeak() {
  std::ofstream file("/proc/self/clear_refs");
  return static_cast<bool>(file << "5\n" << std::flush);
}

// 300 columns of 1,458,000 cells are 3.5 GB as doubles, and a p x p matrix 17 TB: they must never be held.
TEST(BasisMemory, ThreeHundredColumnsFromFilesStayBelowFourGibibytes) {
  constexpr double kMostGibibytes = 4;
  constexpr int kMaterials = 100, kTables = 10;  // each table under ten names: the reader doesn't know
  if (!forgetPeak() || peakGibibytes() == 0) GTEST_SKIP() << "the system doesn't tell the peak of memory";
  test::TempFolder folder;
  std::vector<fs::path> files;
  for (int i = 0; i < kMaterials; ++i) {
    files.push_back(folder / ("material_" + std::to_string(i) + ".binary"));
    if (i < kTables) {
      const auto table = tabulate(*builtInMaterials()[7 * i]);
      ASSERT_TRUE(table.ok()) << table.error().sentence();
      ASSERT_TRUE(writeMerl(files.back(), **table).ok());
    } else {
      fs::create_hard_link(files[i % kTables], files.back());
    }
  }
  ASSERT_TRUE(forgetPeak());
  const auto built = buildBasis(files, folder / "out.basis", {}, {});
  ASSERT_TRUE(built.ok()) << built.error().sentence();
  const double peak = peakGibibytes();
  RecordProperty("peak_gib", std::to_string(peak));
  EXPECT_LT(peak, kMostGibibytes);
  EXPECT_GT(peak, 0.01) << "nothing was measured";
  EXPECT_EQ((*built)->columnCount(), 3 * kMaterials);
  EXPECT_GT((*built)->cellCount(BasisRegion::All), 1'000'000u);
}

}  // namespace
}  // namespace patina
