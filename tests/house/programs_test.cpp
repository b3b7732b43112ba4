// Checks on what the build left and on the form of the sources: each needs a tool of the system.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <set>
#include <sstream>
#include <string>

#include "tests/house/house_rules.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::IsEmpty;

struct CommandOutcome {
  int status = -1;
  std::string output;  // both streams
};

CommandOutcome runCommand(const std::string& command) {
  CommandOutcome outcome;
  FILE* pipe = ::popen((command + " 2>&1").c_str(), "r");
  if (!pipe) return outcome;
  std::array<char, 4096> buffer;
  for (std::size_t count; (count = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;) {
    outcome.output.append(buffer.data(), count);
  }
  outcome.status = ::pclose(pipe);
  return outcome;
}

std::string quoted(const fs::path& path) {
  return "'" + path.string() + "'";
}

TEST(Programs, LoadNoQt5AndNoHighgui) {
  ASSERT_TRUE(fs::is_directory(PATINA_PROGRAMS_DIR));
  int checked = 0;
  for (const auto& entry : fs::directory_iterator(PATINA_PROGRAMS_DIR)) {
    const auto permissions = entry.status().permissions();
    if (!entry.is_regular_file() || (permissions & fs::perms::owner_exec) == fs::perms::none) continue;
    const CommandOutcome ldd = runCommand("ldd " + quoted(entry.path()));
    // An ldd that doesn't work would list nothing and pass everything.
    ASSERT_THAT(ldd.output, HasSubstr("libc.so")) << entry.path();
    EXPECT_THAT(forbiddenLibraries(ldd.output), IsEmpty()) << entry.path();
    ++checked;
  }
  EXPECT_GE(checked, 1);
}

TEST(Programs, TheShippedOnesWereChecked) {
  std::istringstream names(PATINA_SHIPPED_PROGRAMS);
  for (std::string name; names >> name;) {
    EXPECT_TRUE(fs::exists(fs::path(PATINA_PROGRAMS_DIR) / name))
        << name << " is not built, so nothing checked what it loads";
  }
}

TEST(Formatting, IsClangFormats) {
  const CommandOutcome version = runCommand("clang-format --version");
  if (version.status != 0) GTEST_SKIP() << "no clang-format here";
  if (version.output.find("version 14.") == std::string::npos) {
    GTEST_SKIP() << "versions differ in what they call formatted; the sources follow 14, here is "
                 << version.output;
  }
  const fs::path root = PATINA_SOURCE_DIR;
  std::string command = "cd " + quoted(root) + " && clang-format --dry-run --Werror";
  for (const fs::path& file : sourceFiles(root)) command += " " + quoted(file);
  const CommandOutcome outcome = runCommand(command);
  std::set<std::string> misformatted;
  std::istringstream messages(outcome.output);
  for (std::string line; std::getline(messages, line);) {
    if (line.find(": error:") != std::string::npos) misformatted.insert(line.substr(0, line.find(':')));
  }
  EXPECT_THAT(misformatted, IsEmpty()) << "run clang-format -i on these";
  EXPECT_TRUE(outcome.status == 0 || !misformatted.empty()) << outcome.output;

  // And it does notice: the same command on a badly formatted file.
  const CommandOutcome planted =
      runCommand("echo 'int   x ;' | clang-format --dry-run --Werror --assume-filename=x.cpp");
  EXPECT_NE(planted.status, 0);
}

}  // namespace
}  // namespace patina::test
