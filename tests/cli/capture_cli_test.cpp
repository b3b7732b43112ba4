#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <filesystem>
#include <map>
#include <random>
#include <regex>
#include <set>
#include <sstream>

#include "engine/capture/capture.h"
#include "engine/capture/two_shot_capture.h"
#include "tests/base/temp_folder.h"
#include "tests/cli/run_program.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using test::Finished;
using test::RunOptions;
using test::runProgram;
using test::TempFolder;
using Clock = std::chrono::steady_clock;

/// A rig small enough for many captures; the finest pattern has eight of its pixels a wave.
void writeRig(const fs::path& file) {
  test::writeText(file, R"({"scene": "laminate", "pixels": 16, "screenPx": 320})");
}

std::vector<std::string> command(const fs::path& rig, const fs::path& out, bool resume) {
  std::vector<std::string> words{PATINA_CLI_PATH, "capture",   "--camera", "simulated:" + rig.string(),
                                 "--screen",      "simulated", "--out",    out.string(),
                                 "--progress",    "json"};
  if (resume) words.emplace_back("--resume");
  return words;
}

RunOptions within(int seconds) {
  RunOptions options;
  options.secondsAtMost = seconds;
  return options;
}

std::map<std::string, std::string> contentOf(const fs::path& bundle) {
  std::map<std::string, std::string> content;
  for (const auto& entry : fs::recursive_directory_iterator(bundle))
    if (entry.is_regular_file() && entry.path().filename() != "journal.jsonl")
      content[entry.path().lexically_relative(bundle).string()] = test::readText(entry.path());
  return content;
}

/// Numbers of the photographs that the journal's whole lines count, in their order.
std::vector<int> counted(const fs::path& bundle) {
  std::vector<int> numbers;
  std::error_code ignored;
  if (!fs::exists(bundle / "journal.jsonl", ignored)) return numbers;
  std::istringstream lines(test::readText(bundle / "journal.jsonl"));
  for (std::string line; std::getline(lines, line);) {
    if (lines.eof() || line.find("\"event\":\"photo\"") == std::string::npos) continue;
    const std::size_t at = line.find("\"index\":");
    numbers.push_back(std::stoi(line.substr(at + 8)));
  }
  return numbers;
}

std::size_t filesIn(const fs::path& folder) {
  std::size_t count = 0;
  std::error_code ignored;
  for (fs::directory_iterator it(folder, ignored), end; it != end; it.increment(ignored))
    count += it->path().filename().string().front() != '.';
  return count;
}

TEST(CaptureCli, TakesABundleThatIsThere) {
  const TempFolder folder;
  writeRig(folder / "rig.json");
  const Finished done = runProgram(command(folder / "rig.json", folder / "bundle", false));
  ASSERT_EQ(done.status, 0) << done.err;
  const Result<FourierCapture> bundle = readFourierCapture(folder / "bundle");
  ASSERT_TRUE(bundle.ok()) << bundle.error().sentence();
  EXPECT_EQ(bundle->photos.size(), 167u);
  EXPECT_NE(done.err.find("\"stage\":\"photograph\""), std::string::npos);
  // Again into the same folder: not without being asked to go on.
  EXPECT_EQ(runProgram(command(folder / "rig.json", folder / "bundle", false)).status, 3);
  EXPECT_EQ(runProgram(command(folder / "rig.json", folder / "bundle", true)).status, 0);
}

TEST(CaptureCli, SigkillAtRandomMomentsLosesAtMostThePhotographInFlight) {
  const TempFolder folder;
  writeRig(folder / "rig.json");
  const auto start = Clock::now();
  ASSERT_EQ(runProgram(command(folder / "rig.json", folder / "whole", false), within(300)).status, 0);
  const double whole = std::chrono::duration<double>(Clock::now() - start).count();
  const auto expected = contentOf(folder / "whole");
  std::mt19937_64 random(PATINA_KILLS);
  int kills = 0, rounds = 0;
  double least = 1e9;
  while (kills < PATINA_KILLS) {
    // A capture is killed some times, and then left to its end.
    const fs::path bundle = folder / ("bundle" + std::to_string(rounds++));
    std::size_t before = 0;
    for (int k = 0; k < 3 && kills < PATINA_KILLS; ++k) {
      const double after = 0.1 + whole * std::uniform_real_distribution<double>(0, 0.45)(random);
      const auto begun = Clock::now();
      RunOptions options;
      options.secondsAtMost = 300;
      options.watch = [&](const std::string&) {
        return std::chrono::duration<double>(Clock::now() - begun).count() > after ? SIGKILL : 0;
      };
      const Finished killed = runProgram(command(folder / "rig.json", bundle, k > 0), options);
      if (killed.status == 0) break;  // it was quicker
      ASSERT_EQ(killed.status, 128 + SIGKILL) << killed.err;
      ++kills;
      least = std::min(least, after);
      const std::vector<int> now = counted(bundle);
      EXPECT_GE(now.size(), before);
      // What is there and isn't counted is the one in flight.
      EXPECT_LE(filesIn(bundle / "photos"), now.size() + 1);
      before = now.size();
    }
    const Finished done = runProgram(command(folder / "rig.json", bundle, true), within(300));
    ASSERT_EQ(done.status, 0) << done.err;
    // Nothing that counted was taken twice, and nothing on disk had to be taken again.
    const std::vector<int> numbers = counted(bundle);
    EXPECT_EQ(std::set<int>(numbers.begin(), numbers.end()).size(), numbers.size());
    EXPECT_EQ(numbers.size(), 167u);
    EXPECT_EQ(done.out.find("taken again"), std::string::npos) << done.out;
    EXPECT_EQ(contentOf(bundle), expected) << "killed after " << least << " s at the earliest";
  }
}

#if PATINA_KILLS < 10  // the rest once is enough

TEST(CaptureCli, InterruptedItKeepsWhatIsFinishedAndSaysHowToGoOn) {
  const TempFolder folder;
  writeRig(folder / "rig.json");
  RunOptions options;
  options.watch = [](const std::string& err) {
    static const std::regex kSome(R"re("photograph","done":[2-9][0-9],)re");
    return std::regex_search(err, kSome) ? SIGINT : 0;
  };
  const Finished stopped = runProgram(command(folder / "rig.json", folder / "bundle", false), options);
  EXPECT_EQ(stopped.status, 4) << stopped.err;
  const Result<FourierCapture> partial = readFourierCapture(folder / "bundle");
  ASSERT_TRUE(partial.ok()) << partial.error().sentence();
  EXPECT_LT(partial->photos.size(), 167u);
  EXPECT_EQ(runProgram(command(folder / "rig.json", folder / "bundle", true)).status, 0);
  EXPECT_EQ(readFourierCapture(folder / "bundle")->photos.size(), 167u);
}

TEST(CaptureCli, ListsCamerasAndSaysWhatNeedsTheWindow) {
  const Finished list = runProgram({PATINA_CLI_PATH, "capture", "--list"});
  EXPECT_EQ(list.status, 0);
  EXPECT_NE(list.out.find("simulated:laminate"), std::string::npos);
  EXPECT_NE(list.out.find("folder:PATH"), std::string::npos);
  const TempFolder folder;
  const std::string out = (folder / "x").string();
  const auto status = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {PATINA_CLI_PATH, "capture"});
    return runProgram(words);
  };
  const Finished screen = status({"--camera", "simulated:laminate", "--screen", "HDMI-1", "--out", out});
  EXPECT_EQ(screen.status, 2);
  EXPECT_NE(screen.err.find("window"), std::string::npos);
  EXPECT_EQ(status({"--camera", "v4l2:nowhere", "--screen", "simulated", "--out", out}).status, 3);
  EXPECT_EQ(status({"--screen", "simulated", "--out", out}).status, 2);
  EXPECT_EQ(status({"--camera", "simulated:moon", "--screen", "simulated", "--out", out}).status, 3);
  EXPECT_EQ(status({"--camera", "simulated:laminate", "--screen", "simulated", "--out", out, "--skip-checks"})
                .status,
            2);
  EXPECT_FALSE(fs::exists(out));
}

TEST(CaptureCli, TwoShotsWithTheSimulatedOperator) {
  const TempFolder folder;
  writeRig(folder / "rig.json");
  const std::string rig = "simulated:" + (folder / "rig.json").string(), out = (folder / "bundle").string();
  const Finished done = runProgram(
      {PATINA_CLI_PATH, "capture", "--camera", rig, "--kind", "two-shot", "--out", out}, within(170));
  ASSERT_EQ(done.status, 0) << done.err;
  EXPECT_NE(done.out.find("Move "), std::string::npos);
  const Result<TwoShotCapture> bundle = readTwoShotCapture(folder / "bundle");
  ASSERT_TRUE(bundle.ok()) << bundle.error().sentence();
  EXPECT_GE(bundle->shots.size(), 2u);
  EXPECT_EQ(bundle->whiteShots.size(), 2u);
}

#endif

}  // namespace
}  // namespace patina
