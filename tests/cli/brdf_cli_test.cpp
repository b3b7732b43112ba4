#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "engine/brdf/tabulated_brdf.h"
#include "tests/base/temp_folder.h"
#include "tests/brdf/brdf_samples.h"
#include "tests/cli/run_program.h"

// patina-cli brdf from outside.
namespace patina {
namespace {

using nlohmann::json;
using test::Finished;
using test::TempFolder;
using testing::HasSubstr;
using testing::Not;

Finished brdf(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), {PATINA_CLI_PATH, "brdf"});
  return test::runProgram(arguments);
}

TEST(BrdfCli, InfoTellsWhatALambertianSurfaceIs) {
  const Finished text = brdf({"info", "analytic:lambert?diffuse=0.5,0.25,0.125"});
  EXPECT_EQ(text.status, 0) << text.err;
  EXPECT_THAT(text.out, HasSubstr("isotropic"));
  EXPECT_THAT(text.out, Not(HasSubstr("warning")));

  const Finished finished = brdf({"info", "--json", "analytic:lambert?diffuse=0.5,0.25,0.125"});
  ASSERT_EQ(finished.status, 0) << finished.err;
  const json info = json::parse(finished.out).at(0);
  for (const json& albedo : info["albedo"]) {  // known in closed form; the quadrature errs by less than 1 %
    EXPECT_NEAR(albedo["rgb"][0].get<double>(), 0.5, 0.005);
    EXPECT_NEAR(albedo["rgb"][2].get<double>(), 0.125, 0.00125);
    EXPECT_NEAR(albedo["known_share"].get<double>(), 1, 1e-9);
  }
  EXPECT_EQ(info["isotropic"], true);
  EXPECT_NEAR(info["reciprocity_log_rms"].get<double>(), 0, 1e-6);
  EXPECT_NEAR(info["known_share"].get<double>(), 1, 1e-9);
  EXPECT_NEAR(info["largest_per_sr"][0].get<double>(), 0.5 / M_PI, 1e-6);
}

TEST(BrdfCli, InfoSeesWhatIsWrongOrSpecial) {
  const TempFolder folder;
  // Brighter one way than the other: not reciprocal; 4 in all directions: more light than arrives.
  test::writeText(folder / "bad_rgb.bsdf", test::smallRgl({0.0f}, [](int, int theta, int) {
                                             return theta == 0 ? 4.0f : 1.0f;
                                           }).build());
  const Finished bad = brdf({"info", (folder / "bad_rgb.bsdf").string()});
  EXPECT_EQ(bad.status, 0) << bad.err;
  EXPECT_THAT(bad.out, HasSubstr("warning"));
  const json reversed = json::parse(brdf({"info", "--json", (folder / "bad_rgb.bsdf").string()}).out).at(0);
  EXPECT_GT(reversed["reciprocity_log_rms"].get<double>(), 0.2);

  const Finished brushed = brdf({"info", "analytic:ward?alphaX=0.1&alphaY=0.5"});
  EXPECT_THAT(brushed.out, HasSubstr("anisotropic"));
}

TEST(BrdfCli, ConvertWritesAMerlTableThatComparesEqual) {
  const TempFolder folder;
  const std::string out = (folder / "ggx.binary").string();
  const std::string source = "analytic:ggx?alpha=0.3&specular=0.9&diffuse=0.3,0.2,0.1";
  const Finished converted = brdf({"convert", source, "--to", "merl", "--out", out});
  ASSERT_EQ(converted.status, 0) << converted.err;
  EXPECT_THAT(converted.out, HasSubstr(out));
  ASSERT_TRUE(readMerl(out));

  const Finished compared = brdf({"compare", "--json", source, out});
  ASSERT_EQ(compared.status, 0) << compared.err;
  const json result = json::parse(compared.out).at(0);
  // Interpolation between phi_d cells is all that differs: the comparison's directions are off the grid
  // there.
  EXPECT_LT(result["all"]["log_rms"].get<double>(), 0.01);
  EXPECT_GT(result["compared_share"].get<double>(), 0.999);

  // A table is passed on as it was read.
  const std::string again = (folder / "again.binary").string();
  ASSERT_EQ(brdf({"convert", out, "--out", again}).status, 0);
  EXPECT_TRUE(test::readText(out) == test::readText(again));
}

TEST(BrdfCli, ConvertSaysThatAnisotropyIsLost) {
  const TempFolder folder;
  const Finished converted = brdf({"convert", "analytic:ward?alphaX=0.1&alphaY=0.5", "--azimuths", "4",
                                   "--out", (folder / "w.binary").string()});
  EXPECT_EQ(converted.status, 0) << converted.err;
  EXPECT_THAT(converted.out, HasSubstr("averaged over 4 azimuths"));
}

TEST(BrdfCli, CompareFindsAKnownDifference) {
  // Albedos 0.4 and 0.2: ln((0.2 w / pi + 0.001) / (0.4 w / pi + 0.001)), between -0.67 (w 1) and -0.65.
  const Finished finished = brdf({"compare", "--json", "analytic:lambert?diffuse=0.4",
                                  "analytic:lambert?diffuse=0.2", "analytic:lambert?diffuse=0.4"});
  ASSERT_EQ(finished.status, 0) << finished.err;
  const json result = json::parse(finished.out);
  ASSERT_EQ(result.size(), 2u);
  for (const char* region : {"highlight", "diffuse", "grazing"}) {
    EXPECT_NEAR(result[0]["regions"][region]["log_bias"].get<double>(), -0.68, 0.03) << region;
    EXPECT_NEAR(result[0]["regions"][region]["log_rms"].get<double>(), 0.68, 0.03) << region;
  }
  EXPECT_NEAR(result[0]["largest"]["log"].get<double>(),
              std::log((0.4 / M_PI + 0.001) / (0.2 / M_PI + 0.001)), 1e-3);
  EXPECT_EQ(result[1]["all"]["log_rms"].get<double>(), 0);
  const Finished text = brdf({"compare", "analytic:lambert?diffuse=0.4", "analytic:lambert?diffuse=0.2"});
  for (const char* word : {"highlight", "diffuse", "grazing", "red", "largest", "ln"}) {
    EXPECT_THAT(text.out, HasSubstr(word));
  }
}

TEST(BrdfCli, BadInputAndWrongUseAreTold) {
  const TempFolder folder;
  test::writeText(folder / "cut.binary", std::string("\x5a\0\0\0\x5a\0\0\0\xb4\0\0\0", 12) + "short");
  const std::string out = (folder / "out.binary").string();
  struct Case {
    int status;
    const char* words;
    std::vector<std::string> arguments;
  };
  const Case cases[] = {
      {3, "cut off", {"info", (folder / "cut.binary").string()}},
      {3, "cut off", {"convert", (folder / "cut.binary").string(), "--out", out}},
      {3, "no such file", {"info", (folder / "none.binary").string()}},
      {3, "built-in:chrome", {"info", "built-in:crome"}},
      {3, "Try: ggx", {"info", "analytic:gxg"}},
      {3,
       "folder to write into",
       {"convert", "analytic:lambert", "--out", (folder / "no/x.binary").string()}},
      {2, "two BRDFs", {"compare", "analytic:lambert"}},
      {2, "--out", {"convert", "analytic:lambert"}},
      {2, "--to", {"convert", "analytic:lambert", "--to", "png", "--out", out}},
      {2, "--azimuths", {"convert", "analytic:lambert", "--azimuths", "0", "--out", out}},
      {2,
       "the file that is read",
       {"convert", (folder / "cut.binary").string(), "--out", (folder / "cut.binary").string()}},
      {2, "subcommand", {}},
      {2, "FILE", {"info"}},
  };
  for (const Case& c : cases) {
    const Finished finished = brdf(c.arguments);
    EXPECT_EQ(finished.status, c.status) << c.words << ": " << finished.err;
    EXPECT_THAT(finished.err, HasSubstr(c.words));
  }
  EXPECT_THAT(test::everythingIn(folder.path()), testing::ElementsAre("cut.binary"))
      << "nothing half-written";
}

TEST(BrdfCli, OneBadFileDoesNotHideTheOthers) {
  const Finished finished = brdf({"info", "nothing-here.binary", "analytic:lambert", "--stats"});
  EXPECT_EQ(finished.status, 3);
  EXPECT_THAT(finished.out, HasSubstr("'lambert'"));
  EXPECT_THAT(finished.out, HasSubstr("MiB"));
}

}  // namespace
}  // namespace patina
