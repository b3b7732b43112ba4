// patina-cli plan, expect and basis from outside: what they print, their exit status, what they leave behind.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <nlohmann/json.hpp>

#include "engine/brdf/analytic_brdf.h"
#include "engine/twoshot/basis.h"
#include "tests/base/temp_folder.h"
#include "tests/cli/run_program.h"
#include "tests/test_data.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::Finished;
using test::RunOptions;
using test::TempFolder;
using testing::HasSubstr;

Finished cli(std::vector<std::string> arguments, const RunOptions& options = {}) {
  arguments.insert(arguments.begin(), PATINA_CLI_PATH);
  return test::runProgram(arguments, options);
}

/// A basis of six analytic materials, made once: what the verbs do doesn't depend on which basis it is.
class PlanCli : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<TempFolder>();
    std::vector<BrdfPtr> brdfs;
    for (const double alpha : {0.05, 0.12, 0.3})
      for (const double diffuse : {0.05, 0.5}) {
        AnalyticBrdfParameters parameters;
        parameters.alphaX = parameters.alphaY = alpha;
        parameters.diffuse = Eigen::Array3d(diffuse, 0.7 * diffuse, 0.2);
        const Result<BrdfPtr> brdf = makeAnalyticBrdf("ggx", parameters);
        ASSERT_TRUE(brdf.ok());
        brdfs.push_back(*brdf);
      }
    BasisBuildOptions options;
    options.components = 8;
    options.name = "six";
    const auto built = buildBasis(brdfs, *folder_ / "six.basis", options, {});
    ASSERT_TRUE(built.ok()) << built.error().sentence();
  }
  static void TearDownTestSuite() { folder_.reset(); }
  static std::string basis() { return (*folder_ / "six.basis").string(); }
  static std::vector<std::string> quick(const fs::path& out) {
    return {"plan", "--basis",      basis(), "--out",    out.string(), "--restarts",
            "1",    "--candidates", "10",    "--points", "20"};
  }
  static Finished planned(const fs::path& out, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = quick(out);
    arguments.insert(arguments.end(), more.begin(), more.end());
    return cli(arguments);
  }

  static std::unique_ptr<TempFolder> folder_;
};
std::unique_ptr<TempFolder> PlanCli::folder_;

TEST_F(PlanCli, HelpHasUnitsAndDefaults) {
  const Finished all = cli({"--help"});
  for (const char* verb : {"plan", "expect", "basis"}) EXPECT_THAT(all.out, HasSubstr(verb));
  const Finished plan = cli({"plan", "--help"});
  EXPECT_EQ(plan.status, 0);
  for (const char* text :
       {"--shots", "default: 2", "--fov", "degrees", "default: 25", "--setup", "fixed-camera", "--robust",
        "--region", "--given", "--seed", "--progress", "--threads"})
    EXPECT_THAT(plan.out, HasSubstr(text));
  EXPECT_EQ(cli({"expect", "--help"}).status, 0);
  EXPECT_THAT(cli({"basis", "build", "--help"}).out, HasSubstr("--with-built-in"));
  EXPECT_THAT(cli({"basis", "info", "--help"}).out, HasSubstr("built-in"));
}

TEST_F(PlanCli, LeavesAPlanAndItsDrawing) {
  const TempFolder folder;
  const fs::path out = folder / "deep" / "plan.json";
  const Finished first = planned(out, {"--seed", "7"});
  EXPECT_EQ(first.status, 0) << first.err;
  for (const char* text : {"theta_h", "camera", "worst tenth", "One more photograph", "plan.svg"})
    EXPECT_THAT(first.out, HasSubstr(text));
  EXPECT_EQ(test::everythingIn(folder.path()),
            (std::vector<std::string>{"deep", "deep/plan.json", "deep/plan.svg"}));
  const json plan = json::parse(test::readText(out));
  EXPECT_EQ(plan["shots"].size(), 2u);
  EXPECT_EQ(plan["seed"], 7);
  EXPECT_EQ(plan["basis"], "six");
  EXPECT_GT(plan["expected"]["training"], 0);
  EXPECT_THAT(test::readText(folder / "deep" / "plan.svg"), HasSubstr("</svg>"));

  const Finished again = planned(folder / "again.json", {"--seed", "7", "--threads", "1", "--json"});
  json second = json::parse(again.out);
  EXPECT_EQ(second, json::parse(test::readText(folder / "again.json")));
  second["seconds"] = plan["seconds"];
  EXPECT_EQ(second, plan) << "the same seed, the same plan";

  // expect works it out anew, from the directions.
  const Finished expected = cli({"expect", out.string(), "--basis", basis(), "--json"});
  EXPECT_EQ(expected.status, 0) << expected.err;
  EXPECT_NEAR(json::parse(expected.out)["expected"]["unseen"].get<double>(),
              plan["expected"]["unseen"].get<double>(), 1e-9);
  const Finished stiff = cli({"expect", out.string(), "--basis", basis(), "--json", "--eta", "4000"});
  EXPECT_GT(json::parse(stiff.out)["expected"]["training"], plan["expected"]["training"]);
}

TEST_F(PlanCli, TakesGivenPhotographsInThreeForms) {
  const TempFolder folder;
  EXPECT_EQ(planned(folder / "a.json", {"--shots", "1", "--given", "6,38,90"}).status, 0);
  const json a = json::parse(test::readText(folder / "a.json"));
  ASSERT_EQ(a["shots"].size(), 2u);
  EXPECT_NEAR(a["shots"][0]["half_angle"]["theta_d_deg"].get<double>(), 38, 1e-9);
  EXPECT_EQ(a["shots"][0]["given"], true);
  EXPECT_EQ(planned(folder / "b.json", {"--shots", "1", "--given", "40, 10, 30, 170"}).status, 0);
  const json b = json::parse(test::readText(folder / "b.json"));
  EXPECT_NEAR(b["shots"][0]["camera"]["angle_deg"].get<double>(), 40, 1e-9);
  EXPECT_NEAR(b["shots"][0]["light"]["azimuth_deg"].get<double>(), 170, 1e-9);
  EXPECT_EQ(planned(folder / "c.json", {"--shots", "1", "--given", (folder / "a.json").string()}).status, 0);
  EXPECT_EQ(json::parse(test::readText(folder / "c.json"))["shots"].size(), 3u);
}

TEST_F(PlanCli, WrongUseExitsWithTwo) {
  const TempFolder folder;
  const std::string out = (folder / "p.json").string();
  const struct {
    const char* words;
    std::vector<std::string> arguments;
  } wrong[] = {
      {"--out", {"plan", "--shots", "2"}},
      {"shots must lie in", {"plan", "--out", out, "--shots", "0"}},
      {"field of view", {"plan", "--out", out, "--fov", "200"}},
      {"--setup", {"plan", "--out", out, "--setup", "loose"}},
      {"3 or 4 angles", {"plan", "--out", out, "--given", "1,2"}},
      {"above the sample", {"plan", "--out", out, "--given", "80,80,0"}},
      {".json", {"plan", "--out", (folder / "p.svg").string()}},
      {"eta", {"expect", folder.path().string(), "--eta", "-1"}},
      {"subcommand", {"basis"}},
      {"--out", {"basis", "build", "x"}},
      {"--components", {"basis", "build", "x", "--out", out, "--components", "-2"}},
  };
  for (const auto& [words, arguments] : wrong) {
    const Finished finished = cli(arguments);
    EXPECT_EQ(finished.status, 2) << words << ": " << finished.err;
    EXPECT_THAT(finished.err, HasSubstr(words));
  }
  EXPECT_TRUE(test::everythingIn(folder.path()).empty());
}

TEST_F(PlanCli, BadInputExitsWithThreeAndLeavesNothing) {
  const TempFolder folder;
  const std::string out = (folder / "p.json").string();
  test::writeText(folder / "broken.json", "{\"format\": \"patina-plan\"");
  test::writeText(folder / "broken.basis", "not a basis");
  fs::create_directories(folder / "empty");
  const std::vector<std::string> before = test::everythingIn(folder.path());
  const struct {
    const char* words;
    std::vector<std::string> arguments;
  } bad[] = {
      {"nowhere", {"plan", "--out", out, "--basis", "/nowhere/x.basis"}},
      {"broken.basis", {"plan", "--out", out, "--basis", (folder / "broken.basis").string()}},
      {"folder stands", {"plan", "--out", (folder / "empty").string(), "--basis", basis()}},
      {"broken.json", {"plan", "--out", out, "--given", (folder / "broken.json").string()}},
      {"nothing there", {"expect", "/nowhere/plan.json"}},
      {"broken.json", {"expect", (folder / "broken.json").string(), "--basis", basis()}},
      {"capture.json", {"expect", (folder / "empty").string(), "--basis", basis()}},
      {"no measured BRDF", {"basis", "build", (folder / "empty").string(), "--out", out}},
      {"nowhere", {"basis", "build", "/nowhere", "--out", out}},
      {"broken.basis", {"basis", "info", (folder / "broken.basis").string()}},
  };
  for (const auto& [words, arguments] : bad) {
    const Finished finished = cli(arguments);
    EXPECT_EQ(finished.status, 3) << words << ": " << finished.err;
    EXPECT_THAT(finished.err, HasSubstr(words));
  }
  EXPECT_EQ(test::everythingIn(folder.path()), before);
}

TEST_F(PlanCli, StoppedIsCancelled) {
  const TempFolder folder;
  RunOptions options;
  options.watch = [](const std::string& err) {
    return err.find("\"search\"") != std::string::npos ? SIGINT : 0;
  };
  const Finished finished = cli({"plan", "--basis", basis(), "--out", (folder / "p.json").string(), "--shots",
                                 "20", "--restarts", "500", "--progress", "json"},
                                options);
  EXPECT_EQ(finished.status, 4) << finished.err;
  // Either nothing was found yet, or what was found says that it was cancelled.
  if (fs::exists(folder / "p.json")) {
    EXPECT_EQ(json::parse(test::readText(folder / "p.json"))["cancelled"], true);
  }
}

TEST_F(PlanCli, BasisInfoTellsWhatIsInAFile) {
  const Finished text = cli({"basis", "info", basis()});
  EXPECT_EQ(text.status, 0) << text.err;
  for (const char* words :
       {"'six'", "6 materials", "8 components of 18 columns", "verified", "Explained variance"})
    EXPECT_THAT(text.out, HasSubstr(words));
  const Finished asJson = cli({"basis", "info", basis(), "--json"});
  const json info = json::parse(asJson.out);
  EXPECT_EQ(info["components"], 8);
  EXPECT_EQ(info["materials"].size(), 6u);
  EXPECT_NEAR(info["explained_variance"].back().get<double>(), 1, 1e-12);
  EXPECT_EQ(info["bytes"], fs::file_size(basis()));
}

TEST_F(PlanCli, ABasisIsBuiltFromFilesAndPlansWithIt) {
  PATINA_NEEDS_SHARED("measured/rgl");
  std::vector<std::string> files;
  for (const auto& entry : fs::directory_iterator(test::sharedData() / "measured" / "rgl"))
    if (entry.path().extension() == ".bsdf") files.push_back(entry.path().string());
  std::ranges::sort(files);
  ASSERT_GE(files.size(), 3u);
  const TempFolder folder;
  const std::string out = (folder / "mine.basis").string();
  const Finished built =
      cli({"basis", "build", files[0], files[1], files[2], "--out", out, "--components", "5"});
  EXPECT_EQ(built.status, 0) << built.err;
  EXPECT_THAT(built.out, HasSubstr("3 materials, 5 components of 9 columns"));
  EXPECT_THAT(built.out, HasSubstr("'mine'"));
  const Finished plan = cli({"plan", "--basis", out, "--out", (folder / "p.json").string(), "--restarts", "1",
                             "--candidates", "5", "--points", "20", "--fov", "0"});
  EXPECT_EQ(plan.status, 0) << plan.err;
}

TEST_F(PlanCli, ExpectReadsABundlesOwnDirections) {
  PATINA_NEEDS_SHARED("two-shot/clean_pink_jasper/capture.json");
  const fs::path bundle = test::sharedData() / "two-shot" / "clean_pink_jasper";
  const Finished finished = cli({"expect", bundle.string(), "--basis", basis(), "--json"});
  EXPECT_EQ(finished.status, 0) << finished.err;
  const json plan = json::parse(finished.out);
  EXPECT_EQ(plan["shots"].size(), 2u);
  // The first camera of the bundle: R's third row is minus the direction to it.
  EXPECT_NEAR(plan["shots"][0]["camera"]["direction"][2].get<double>(), 0.78369, 1e-4);
  EXPECT_NEAR(plan["options"]["fov_deg"].get<double>(), 25, 0.1);
  const Finished named = cli({"expect", (bundle / "capture.json").string(), "--basis", basis()});
  EXPECT_EQ(named.status, 0) << named.err;
}

}  // namespace
}  // namespace patina
