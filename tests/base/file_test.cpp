#include "engine/base/file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "tests/base/temp_folder.h"

namespace patina {
namespace {

using test::TempFolder;

TEST(ReadFile, GivesEveryByte) {
  TempFolder folder;
  const std::string bytes("a\0b\r\n\xFF", 6);
  test::writeText(folder / "f", bytes);
  Result<std::string> read = readFile(folder / "f", 6);
  ASSERT_TRUE(read.ok());
  EXPECT_EQ(*read, bytes);
}

TEST(ReadFile, RefusesOneByteTooMany) {
  TempFolder folder;
  test::writeText(folder / "f", "1234567");
  Result<std::string> read = readFile(folder / "f", 6);
  ASSERT_FALSE(read.ok());
  EXPECT_EQ(read.error().code, ErrorCode::Malformed);
  EXPECT_EQ(read.error().where, (folder / "f").string());
}

TEST(ReadFile, SaysWhatIsNotThere) {
  TempFolder folder;
  EXPECT_EQ(readFile(folder / "none", 10).error().code, ErrorCode::NotFound);
  EXPECT_EQ(readFile(folder.path(), 10).error().code, ErrorCode::NotFound);
  test::writeText(folder / "f", "x");
  EXPECT_EQ(readFile(folder / "f" / "below", 10).error().code, ErrorCode::NotFound);
}

TEST(ReadFile, DoesNotWaitForAPipe) {
  TempFolder folder;
  ASSERT_EQ(::mkfifo((folder / "pipe").c_str(), 0600), 0);
  Result<std::string> read = readFile(folder / "pipe", 10);
  ASSERT_FALSE(read.ok());
  EXPECT_EQ(read.error().code, ErrorCode::Refused);
  EXPECT_EQ(readFile("/dev/zero", 10).error().code, ErrorCode::Refused);
}

}  // namespace
}  // namespace patina
