#include "engine/base/text.h"

#include <gtest/gtest.h>

namespace patina {
namespace {

TEST(InQuotes, KeepsPlainAndAccentedText) {
  EXPECT_EQ(inQuotes("photo_001.exr"), "'photo_001.exr'");
  EXPECT_EQ(inQuotes("Füße 材料"), "'Füße 材料'");
}

TEST(InQuotes, DisarmsTerminalControl) {
  EXPECT_EQ(inQuotes("\x1b[2Jx\n"), "'\\x1B[2Jx\\x0A'");
  EXPECT_EQ(inQuotes("\xC2\x9B"), "'\\xC2\\x9B'") << "U+009B starts a control sequence too";
}

TEST(InQuotes, ShowsBrokenUtf8AsCodes) {
  EXPECT_EQ(inQuotes("a\xFFz"), "'a\\xFFz'");
  EXPECT_EQ(inQuotes("\xE6\x9D"), "'\\xE6\\x9D'") << "cut off in the middle of a character";
}

TEST(InQuotes, CutsLongText) {
  const std::string shown = inQuotes(std::string(10000, 'x'));
  EXPECT_LT(shown.size(), 250u);
  EXPECT_TRUE(shown.ends_with("...'"));
}

TEST(NearestWord, FindsSwappedMissingAndStrangeLetters) {
  EXPECT_EQ(nearestWord("fti", {"fit", "demo"}), "fit");
  EXPECT_EQ(nearestWord("widthmm", {"height_mm", "width_mm"}), "width_mm");
  EXPECT_EQ(nearestWord("Width-MM", {"width_mm"}), "width_mm");
}

TEST(NearestWord, FindsNothingFarAway) {
  EXPECT_EQ(nearestWord("screen", {"camera", "sample"}), "");
  EXPECT_EQ(nearestWord("", {"a"}), "");
  EXPECT_EQ(nearestWord("fit", {}), "");
  EXPECT_EQ(nearestWord(std::string(100000, 'a'), {std::string(100000, 'a')}), "")
      << "must not take quadratic time";
}

TEST(Counted, UsesThePlural) {
  EXPECT_EQ(counted(1, "photo"), "1 photo");
  EXPECT_EQ(counted(0, "photo"), "0 photos");
}

}  // namespace
}  // namespace patina
