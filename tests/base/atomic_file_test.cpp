#include "engine/base/atomic_file.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <functional>

#include "tests/base/temp_folder.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using test::everythingIn;
using test::readText;
using test::TempFolder;
using test::writeText;
using Names = std::vector<std::string>;

constexpr int kNoNamespace = 77;  // the child could not have what the test needs

/// Runs `body` in a child process and gives its exit status; what it must not change for others, it can
/// change there.
int inChild(const std::function<int()>& body) {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(body());
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

/// Its own view of mounts, without being root where the system allows that.
bool ownMounts() {
  if (::unshare(CLONE_NEWNS) != 0 && ::unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0) return false;
  return ::mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0;
}

/// Files can't grow beyond `bytes`, which then is an error instead of a signal.
void limitFileSize(rlim_t bytes) {
  ::signal(SIGXFSZ, SIG_IGN);
  const rlimit limit{bytes, bytes};
  ::setrlimit(RLIMIT_FSIZE, &limit);
}

TEST(WriteFileAtomically, WritesAndReplaces) {
  TempFolder folder;
  ASSERT_TRUE(writeFileAtomically(folder / "f", "one").ok());
  EXPECT_EQ(readText(folder / "f"), "one");
  ASSERT_TRUE(writeFileAtomically(folder / "f", std::string(100000, 'x')).ok());
  EXPECT_EQ(readText(folder / "f"), std::string(100000, 'x'));
  EXPECT_EQ(everythingIn(folder.path()), Names{"f"});
}

TEST(WriteFileAtomically, KeepsPermissionsAndFollowsLinks) {
  TempFolder folder;
  writeText(folder / "real", "old");
  fs::permissions(folder / "real", fs::perms::owner_read | fs::perms::owner_write);
  fs::create_symlink("real", folder / "link");
  ASSERT_TRUE(writeFileAtomically(folder / "link", "new").ok());
  EXPECT_TRUE(fs::is_symlink(folder / "link"));
  EXPECT_EQ(readText(folder / "real"), "new");
  EXPECT_EQ(fs::status(folder / "real").permissions(), fs::perms::owner_read | fs::perms::owner_write);
}

TEST(WriteFileAtomically, NeverReplacesADeviceOrAFolder) {
  TempFolder folder;
  Status full = writeFileAtomically("/dev/full", "x");
  ASSERT_FALSE(full.ok());
  EXPECT_EQ(full.error().code, ErrorCode::Refused);
  EXPECT_TRUE(fs::is_character_file("/dev/full"));
  EXPECT_EQ(writeFileAtomically(folder.path(), "x").error().code, ErrorCode::Refused);
}

TEST(WriteFileAtomically, FailsWithoutItsFolder) {
  TempFolder folder;
  Status written = writeFileAtomically(folder / "none" / "f", "x");
  ASSERT_FALSE(written.ok());
  EXPECT_EQ(written.error().code, ErrorCode::WriteFailed);
  EXPECT_FALSE(written.error().tryThis.empty());
}

TEST(WriteFileAtomically, LeavesTheOldFileWhenTheNewOneIsTooLarge) {
  TempFolder folder;
  writeText(folder / "f", "old");
  const int status = inChild([&] {
    limitFileSize(1000);
    Status written = writeFileAtomically(folder / "f", std::string(5000, 'x'));
    return !written.ok() && written.error().code == ErrorCode::WriteFailed ? 0 : 1;
  });
  EXPECT_EQ(status, 0);
  EXPECT_EQ(readText(folder / "f"), "old");
  EXPECT_EQ(everythingIn(folder.path()), Names{"f"});
}

TEST(WriteFileAtomically, LeavesTheOldFileOnAFullDisk) {
  TempFolder folder;
  const int status = inChild([&] {
    if (!ownMounts() || ::mount("none", folder.path().c_str(), "tmpfs", 0, "size=64k") != 0)
      return kNoNamespace;
    if (!writeFileAtomically(folder / "f", "old").ok()) return 1;
    Status written = writeFileAtomically(folder / "f", std::string(1 << 20, 'x'));
    if (written.ok() || written.error().code != ErrorCode::WriteFailed) return 2;
    if (written.error().what.find("no space") == std::string::npos) return 3;
    if (readText(folder / "f") != "old") return 4;
    return everythingIn(folder.path()) == Names{"f"} ? 0 : 5;
  });
  if (status == kNoNamespace) GTEST_SKIP() << "this system lets nobody mount a small disk";
  EXPECT_EQ(status, 0);
}

TEST(StagedFolder, AppearsOnlyWhenCommitted) {
  TempFolder folder;
  {
    Result<StagedFolder> staged = StagedFolder::create(folder / "out");
    ASSERT_TRUE(staged.ok());
    writeText(staged->path() / "a", "1");
    EXPECT_FALSE(fs::exists(folder / "out"));
    ASSERT_TRUE(staged->commit().ok());
  }
  EXPECT_EQ(everythingIn(folder.path()), (Names{"out", "out/a"}));
}

TEST(StagedFolder, LeavesNothingWhenDropped) {
  TempFolder folder;
  {
    Result<StagedFolder> staged = StagedFolder::create(folder / "deep" / "er" / "out");
    ASSERT_TRUE(staged.ok());
    writeText(staged->path() / "a", "1");
  }
  EXPECT_EQ(everythingIn(folder.path()), Names{}) << "the parents that were made are gone too";
}

TEST(StagedFolder, TakesATrailingSlash) {
  TempFolder folder;
  Result<StagedFolder> staged = StagedFolder::create((folder / "out").string() + "/");
  ASSERT_TRUE(staged.ok());
  writeText(staged->path() / "a", "1");
  ASSERT_TRUE(staged->commit().ok());
  EXPECT_EQ(readText(folder / "out" / "a"), "1");
}

TEST(StagedFolder, ReplacesItsOwnFilesAndKeepsOthers) {
  TempFolder folder;
  fs::create_directories(folder / "out" / "maps");
  writeText(folder / "out" / "maps" / "a", "old");
  writeText(folder / "out" / "notes", "mine");
  Result<StagedFolder> staged = StagedFolder::create(folder / "out");
  ASSERT_TRUE(staged.ok());
  fs::create_directories(staged->path() / "maps" / "new");
  writeText(staged->path() / "maps" / "a", "new");
  writeText(staged->path() / "maps" / "new" / "b", "new");
  EXPECT_EQ(readText(folder / "out" / "maps" / "a"), "old");
  ASSERT_TRUE(staged->commit().ok());
  EXPECT_EQ(readText(folder / "out" / "maps" / "a"), "new");
  EXPECT_EQ(everythingIn(folder / "out"), (Names{"maps", "maps/a", "maps/new", "maps/new/b", "notes"}));
}

TEST(StagedFolder, KeepsTheFolderWhenDropped) {
  TempFolder folder;
  fs::create_directory(folder / "out");
  writeText(folder / "out" / "notes", "mine");
  {
    Result<StagedFolder> staged = StagedFolder::create(folder / "out");
    ASSERT_TRUE(staged.ok());
    writeText(staged->path() / "a", "1");
  }
  EXPECT_EQ(everythingIn(folder.path()), (Names{"out", "out/notes"}));
}

TEST(StagedFolder, ChangesNothingWhereAFolderIsInTheWay) {
  TempFolder folder;
  fs::create_directories(folder / "out" / "b");
  writeText(folder / "out" / "a", "old");
  {
    Result<StagedFolder> staged = StagedFolder::create(folder / "out");
    ASSERT_TRUE(staged.ok());
    writeText(staged->path() / "a", "new");
    writeText(staged->path() / "b", "new");
    Status committed = staged->commit();
    ASSERT_FALSE(committed.ok());
    EXPECT_EQ(committed.error().code, ErrorCode::Refused);
  }
  EXPECT_EQ(readText(folder / "out" / "a"), "old");
  EXPECT_EQ(everythingIn(folder / "out"), (Names{"a", "b"}));
}

TEST(StagedFolder, PutsBackWhatItReplacedWhenOneFileCannotBe) {
  TempFolder folder;
  fs::create_directory(folder / "out");
  writeText(folder / "out" / "a", "old a");
  writeText(folder / "out" / "z", "old z");
  writeText(folder / "other", "mounted");
  const int status = inChild([&] {
    // A file that something is mounted on can't be renamed over: the last of three fails.
    if (!ownMounts() ||
        ::mount((folder / "other").c_str(), (folder / "out" / "z").c_str(), nullptr, MS_BIND, nullptr) != 0) {
      return kNoNamespace;
    }
    Result<StagedFolder> staged = StagedFolder::create(folder / "out");
    if (!staged) return 1;
    for (const char* name : {"a", "m", "z"}) writeText(staged->path() / name, "new");
    fs::create_directory(staged->path() / "maps");
    if (staged->commit().ok()) return 2;
    if (readText(folder / "out" / "a") != "old a") return 3;
    *staged = std::move(StagedFolder::create(folder / "second")).value();  // drops the first
    return everythingIn(folder / "out") == Names{"a", "z"} ? 0 : 4;
  });
  if (status == kNoNamespace) GTEST_SKIP() << "this system lets nobody mount over a file";
  EXPECT_EQ(status, 0);
  EXPECT_EQ(readText(folder / "out" / "z"), "old z");
}

TEST(StagedFolder, RefusesAFileInItsPlace) {
  TempFolder folder;
  writeText(folder / "out", "a file");
  Result<StagedFolder> staged = StagedFolder::create(folder / "out");
  ASSERT_FALSE(staged.ok());
  EXPECT_EQ(staged.error().code, ErrorCode::Refused);
  EXPECT_FALSE(StagedFolder::create(folder / "out" / "below").ok());
  EXPECT_FALSE(StagedFolder::create("").ok());
  EXPECT_FALSE(StagedFolder::create("/proc/patina/out").ok());
  EXPECT_EQ(everythingIn(folder.path()), Names{"out"});
}

TEST(StagedFolder, RespectsTheUmask) {
  TempFolder folder;
  Result<StagedFolder> staged = StagedFolder::create(folder / "out");
  ASSERT_TRUE(staged.ok());
  ASSERT_TRUE(staged->commit().ok());
  const mode_t mask = ::umask(0);
  ::umask(mask);
  struct stat status {};
  ASSERT_EQ(::stat((folder / "out").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0777 & ~mask);
}

}  // namespace
}  // namespace patina
