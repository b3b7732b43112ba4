#include "engine/acquire/capture_journal.h"

#include <gtest/gtest.h>

#include "tests/base/temp_folder.h"

namespace patina {
namespace {

using test::TempFolder;

TEST(CaptureJournal, LinesComeBack) {
  const TempFolder folder;
  {
    auto journal = CaptureJournal::open(folder / "j").value();
    EXPECT_TRUE(journal.lines().empty());
    ASSERT_TRUE(journal.append({{"a", 1}}).ok());
    ASSERT_TRUE(journal.append({{"b", "two\nlines"}}).ok());
  }
  const auto journal = CaptureJournal::open(folder / "j").value();
  ASSERT_EQ(journal.lines().size(), 2u);
  EXPECT_EQ(journal.lines()[1]["b"], "two\nlines");
  EXPECT_EQ(test::readText(folder / "j"), "{\"a\":1}\n{\"b\":\"two\\nlines\"}\n");
}

TEST(CaptureJournal, ALastLineCutAnywhereIsDroppedAndTheNextOneIsWhole) {
  const std::string first = "{\"a\":1}\n", second = "{\"b\":2}\n";
  for (std::size_t kept = 0; kept < second.size(); ++kept) {
    const TempFolder folder;
    test::writeText(folder / "j", first + second.substr(0, kept));
    {
      auto journal = CaptureJournal::open(folder / "j");
      ASSERT_TRUE(journal.ok()) << kept;
      EXPECT_EQ(journal->lines().size(), 1u);
      ASSERT_TRUE(journal->append({{"c", 3}}).ok());
    }
    EXPECT_EQ(test::readText(folder / "j"), first + "{\"c\":3}\n") << kept;
  }
}

TEST(CaptureJournal, ATailOfZeroesIsWhatAPowerCutLeaves) {
  const TempFolder folder;
  test::writeText(folder / "j", "{\"a\":1}\n" + std::string(40, '\0') + "\n");
  const auto journal = CaptureJournal::open(folder / "j");
  ASSERT_TRUE(journal.ok());
  EXPECT_EQ(journal->lines().size(), 1u);
}

TEST(CaptureJournal, DamageBeforeTheEndIsNotHiddenAway) {
  const TempFolder folder;
  test::writeText(folder / "j", "{\"a\":1}\n{\"b\":\n{\"c\":3}\n");
  const auto journal = CaptureJournal::open(folder / "j");
  ASSERT_FALSE(journal.ok());
  EXPECT_NE(journal.error().what.find("line 2"), std::string::npos);
  EXPECT_EQ(test::readText(folder / "j"), "{\"a\":1}\n{\"b\":\n{\"c\":3}\n");  // untouched
}

TEST(CaptureJournal, AFolderThatIsGoneIsASentence) {
  EXPECT_EQ(CaptureJournal::open("/nowhere/at/all/j").error().code, ErrorCode::WriteFailed);
}

TEST(FileHash, IsXxh3AndChangesWithEveryByte) {
  const TempFolder folder;
  test::writeText(folder / "f", "");
  EXPECT_EQ(*fileHash(folder / "f"), "2d06800538d394c2");  // XXH3's published value for no input
  test::writeText(folder / "f", "abc");
  const std::string before = *fileHash(folder / "f");
  test::writeText(folder / "f", "abd");
  EXPECT_NE(*fileHash(folder / "f"), before);
  EXPECT_FALSE(fileHash(folder / "none").ok());
}

}  // namespace
}  // namespace patina
