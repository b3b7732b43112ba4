#include "app/cli/stage_titles.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

/// Stage ids in a source: the literals that a call of `progress`, a `Counter` or a `forRows` begins with.
std::set<std::string> stagesIn(const std::string& source) {
  static const std::regex kCall(
      R"re((?:\bprogress\(|\bCounter \w+\{|\bforRows\([^",]*,\s*)\s*(?:\w+ \? "([a-z -]+)" : )?"([a-z -]+)")re");
  std::set<std::string> stages;
  for (std::sregex_iterator call(source.begin(), source.end(), kCall), end; call != end; ++call) {
    for (const int group : {1, 2})
      if ((*call)[group].matched) stages.insert((*call)[group]);
  }
  return stages;
}

std::set<std::string> stagesBelow(const char* room) {
  std::set<std::string> stages;
  for (const auto& entry : fs::recursive_directory_iterator(fs::path(PATINA_SOURCE_DIR) / room)) {
    if (entry.path().extension() != ".cpp") continue;
    std::ifstream in(entry.path());
    std::ostringstream text;
    text << in.rdbuf();
    stages.merge(stagesIn(text.str()));
  }
  return stages;
}

TEST(StageTitle, EveryStageHasWords) {
  std::set<std::string> stages = stagesBelow("engine");
  stages.merge(stagesBelow("devices"));
  ASSERT_GE(stages.size(), 12u) << "the scan finds too little: the calls look different now";
  for (const char* known : {"read", "solve", "posterior", "holdout", "expose", "compare"})
    EXPECT_TRUE(stages.contains(known)) << known;
  for (const std::string& stage : stages) EXPECT_NE(stageTitle(stage), stage) << "give it a title";
}

TEST(StageTitle, TheScanSeesAPlantedStage) {
  EXPECT_EQ(stagesIn("job.progress(\"planted\", 1, 2, \"rows\");"), std::set<std::string>{"planted"});
  EXPECT_EQ(stagesIn("job.progress(last ? \"one\" : \"two\", 1, 2, \"rows\");"),
            (std::set<std::string>{"one", "two"}));
}

TEST(StageTitle, AnUnknownIdIsShownAsItIs) {
  EXPECT_EQ(stageTitle("unheard of"), "unheard of");
}

}  // namespace
}  // namespace patina::cli
