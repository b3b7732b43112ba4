#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/capture/small_bundle.h"
#include "tests/cli/run_program.h"
#include "tests/report/well_formed.h"

// `patina-cli explain` from outside: what it prints, its exit status, and what it leaves behind.
namespace patina {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::Finished;
using test::RunOptions;
using test::TempFolder;
using testing::HasSubstr;

constexpr int kFrequencies = 12;  // enough for the model to be determined

Finished cli(std::vector<std::string> arguments, const RunOptions& options = {}) {
  arguments.insert(arguments.begin(), PATINA_CLI_PATH);
  return test::runProgram(arguments, options);
}

TEST(CliExplain, HelpSaysWhatItLeavesAndItsDefaults) {
  const Finished help = cli({"explain", "--help"});
  EXPECT_EQ(help.status, 0);
  for (const char* text :
       {"BUNDLE", "--out", "report.html", "--size", "default: 0", "--texels", "default: 800", "--max-effects",
        "--false-alarms", "--no-pictures", "--progress", "--threads"})
    EXPECT_THAT(help.out, HasSubstr(text));
}

TEST(CliExplain, WrongUseExitsWithTwoAndASentence) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  const std::string b = (folder / "b").string();
  const std::map<std::string, std::vector<std::string>> wrong = {
      {"bundles", {"explain", "--out", "o"}},
      {"--out", {"explain", b}},
      {"--texels", {"explain", b, "--out", "o", "--texels", "many"}},
      {"never written to", {"explain", b, "--out", (folder / "b" / "inside").string()}},
      {"Try: patina-cli explain --help", {"explain", b, "--out", (folder / "o").string(), "--texels", "-3"}},
  };
  for (const auto& [words, arguments] : wrong) {
    const Finished finished = cli(arguments);
    EXPECT_EQ(finished.status, 2) << words << ": " << finished.err;
    EXPECT_THAT(finished.err, HasSubstr(words));
    EXPECT_EQ(finished.out, "");
  }
  EXPECT_FALSE(fs::exists(folder / "o"));
}

TEST(CliExplain, BadInputExitsWithThreeAndLeavesNothing) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  fs::create_directories(folder / "broken");
  test::writeText(folder / "broken" / "capture.json", R"({"version": 1, "kind": "fourier"})");
  const auto before = test::everythingIn(folder.path());
  for (const std::vector<std::string>& bundles :
       {std::vector<std::string>{"nowhere"}, {"broken"}, {"b", "nowhere"}, {"b", "broken"}}) {
    std::vector<std::string> arguments{"explain"};
    for (const std::string& bundle : bundles) arguments.push_back((folder / bundle).string());
    arguments.insert(arguments.end(), {"--out", (folder / "o").string(), "--texels", "100"});
    const Finished finished = cli(arguments);
    EXPECT_EQ(finished.status, 3) << bundles.back() << ": " << finished.err;
    EXPECT_THAT(finished.err, HasSubstr("Error: "));
    EXPECT_THAT(finished.err, HasSubstr(bundles.back())) << "says which";
    EXPECT_EQ(test::everythingIn(folder.path()), before);
  }
}

TEST(CliExplain, LeavesReportNumbersAndFitAndSaysItInWords) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  const auto bundle = test::everythingIn(folder / "b");
  const fs::path out = folder / "new" / "out";
  const Finished finished =
      cli({"explain", (folder / "b").string(), "--out", out.string(), "--texels", "100", "--stats"});
  ASSERT_EQ(finished.status, 0) << finished.err;
  for (const char* text : {"standard model", "Error on", "report.html", "Time, s"})
    EXPECT_THAT(finished.out, HasSubstr(text));
  for (const char* file : {"explain.json", "report.html", "fit.json", "maps/diffuse.exr", "maps/normal.exr"})
    EXPECT_TRUE(fs::exists(out / file)) << file;
  const json report = json::parse(test::readText(out / "explain.json"));
  EXPECT_EQ(report.at("kind"), "fourier");
  for (const char* key : {"noise_floor", "before", "after", "effects", "considered", "confusable", "suggest",
                          "unexplained", "budget"})
    EXPECT_TRUE(report.contains(key)) << key;
  EXPECT_TRUE(report.at("before").at("fit_rms").is_number());
  EXPECT_EQ(report.at("cancelled"), false);
  EXPECT_EQ(test::whyNotWellFormed(test::readText(out / "report.html")), "");
  EXPECT_EQ(test::everythingIn(folder / "b"), bundle) << "the bundle is never changed";
}

TEST(CliExplain, CancelledExitsWithFour) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies, 40);
  const auto before = test::everythingIn(folder.path());
  RunOptions options;
  options.watch = [](const std::string& err) {
    return err.find("\"stage\"") != std::string::npos ? SIGINT : 0;
  };
  const Finished finished = cli({"explain", (folder / "b").string(), "--out", (folder / "o").string(),
                                 "--threads", "1", "--progress", "json"},
                                options);
  EXPECT_EQ(finished.status, 4) << finished.err;
  std::istringstream lines(finished.err);
  for (std::string line; std::getline(lines, line);) EXPECT_TRUE(json::accept(line)) << line;
  if (fs::exists(folder / "o" / "explain.json"))
    EXPECT_EQ(json::parse(test::readText(folder / "o" / "explain.json")).at("cancelled"), true);
  else
    EXPECT_EQ(test::everythingIn(folder.path()), before) << "nothing was finished, so nothing is kept";
}

}  // namespace
}  // namespace patina
