#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <sstream>

#include "engine/fourier/maps.h"
#include "tests/capture/small_bundle.h"
#include "tests/cli/run_program.h"

// patina-cli from outside: what it prints, its exit status, and what it leaves behind.
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

std::vector<json> jsonLines(const std::string& text) {
  std::vector<json> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(json::parse(line));
  return lines;
}

TEST(Cli, HelpNamesWhatThereIsWithUnitsAndDefaults) {
  const Finished help = cli({"--help"});
  EXPECT_EQ(help.status, 0);
  EXPECT_THAT(help.out, HasSubstr("fit"));
  EXPECT_THAT(help.out, testing::Not(HasSubstr("export "))) << "not listed as if it worked";
  EXPECT_THAT(help.out, HasSubstr("3 bad input"));
  const Finished fit = cli({"fit", "--help"});
  EXPECT_EQ(fit.status, 0);
  for (const char* text : {"BUNDLE", "--out", "--size", "texels", "default: 0", "--effects", "--lobe",
                           "--weights", "--max-iterations", "default: 80", "--no-pooling", "--progress",
                           "--threads", "--stats", "--texel", "--dump-dir"}) {
    EXPECT_THAT(fit.out, HasSubstr(text));
  }
  EXPECT_EQ(cli({"--version"}).out.rfind("patina-cli ", 0), 0u);
}

TEST(Cli, WrongUseExitsWithTwoAndASentence) {
  const std::map<std::string, std::vector<std::string>> wrong = {
      {"verb is needed", {}},
      {"'fti' is not a verb of patina-cli. Try: fit", {"fti", "x"}},
      {"'xyzzy' is not a verb", {"xyzzy"}},
      {"BUNDLE", {"fit"}},
      {"--out", {"fit", "b"}},
      {"--sizee", {"fit", "b", "--out", "o", "--sizee", "3"}},
      {"--size", {"fit", "b", "--out", "o", "--size", "big"}},
      {"--threads", {"fit", "b", "--out", "o", "--threads", "-1"}},
      {"--progress", {"fit", "b", "--out", "o", "--progress", "xml"}},
      {"--lobe", {"fit", "b", "--out", "o", "--lobe", "round"}},
      {"--texel", {"fit", "b", "--out", "o", "--texel", "3"}},
      {"Did you mean glare?", {"fit", "b", "--out", "o", "--effects", "glaer,defocus"}},
      {"--effects", {"fit", "b", "--out", "o", "--effects", ","}},
  };
  for (const auto& [words, arguments] : wrong) {
    const Finished finished = cli(arguments);
    EXPECT_EQ(finished.status, 2) << words << ": " << finished.err;
    EXPECT_THAT(finished.err, HasSubstr(words));
    EXPECT_EQ(finished.out, "") << words;
  }
}

TEST(Cli, ImpossibleOptionsAreAllNamed) {
  const Finished finished =
      cli({"fit", "b", "--out", "o", "--size", "-4", "--max-iterations", "0", "--tolerance", "nan"});
  EXPECT_EQ(finished.status, 2) << finished.err;
  EXPECT_THAT(finished.err, HasSubstr("; ")) << "not only the first problem";
}

TEST(Cli, VerbsOfOtherVersionsSaySo) {
  for (const char* verb : {"render", "export"}) {
    for (const std::vector<std::string>& arguments :
         {std::vector<std::string>{verb}, {verb, "--help"}, {verb, "a", "--out", "b", "--strange", "1"}}) {
      const Finished finished = cli(arguments);
      EXPECT_EQ(finished.status, 2) << verb;
      EXPECT_THAT(finished.err, HasSubstr("is not in this version")) << verb;
    }
  }
}

TEST(CliFit, LeavesWhatTheContractSays) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  const Finished finished = cli({"fit", (folder / "b").string(), "--out", (folder / "new" / "out").string(),
                                 "--size", "8", "--stats", "--texel", "3,4", "--threads", "1"});
  ASSERT_EQ(finished.status, 0) << finished.err;
  const Result<SvbrdfMaps> maps = readMaps(folder / "new" / "out" / "maps");
  ASSERT_TRUE(maps.ok()) << maps.error().sentence();
  EXPECT_EQ(std::max(maps->width, maps->height), 8);
  const json fit = json::parse(test::readText(folder / "new" / "out" / "fit.json"));
  for (const char* key :
       {"kind", "seconds", "texels", "iterations", "options", "fit_rms", "holdout_rms", "noise_floor"}) {
    EXPECT_TRUE(fit.contains(key)) << key;
  }
  EXPECT_THAT(finished.out, HasSubstr("Peak memory, MiB"));
  EXPECT_THAT(finished.out, HasSubstr("Texel 3,4"));
  EXPECT_THAT(finished.out, HasSubstr("residual/noise"));
  EXPECT_EQ(test::everythingIn(folder / "new").size(), 15u)
      << "out, maps, seven maps, five of standard deviations, fit.json and nothing hidden";
}

TEST(CliFit, ProgressIsOneJsonObjectALine) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  json bundle = test::readBundleJson(folder / "b");
  bundle["operator"] = "me";  // its note must not get between the objects
  test::writeBundleJson(folder / "b", bundle);
  const Finished finished = cli({"fit", (folder / "b").string(), "--out", (folder / "o").string(),
                                 "--progress", "json", "--size", "8"});
  ASSERT_EQ(finished.status, 0) << finished.err;
  std::map<std::string, std::int64_t> last;
  for (const json& line : jsonLines(finished.err)) {
    EXPECT_EQ(line.size(), 4u);
    const std::string stage = line.at("stage");
    const std::int64_t done = line.at("done"), total = line.at("total");
    EXPECT_TRUE(line.at("unit").is_string());
    EXPECT_LE(done, total);
    if (last.contains(stage)) {
      EXPECT_GT(done, last[stage]) << stage << " went backwards";
    }
    last[stage] = done;
  }
  EXPECT_TRUE(last.contains("read"));
  EXPECT_TRUE(last.contains("solve"));
  EXPECT_THAT(finished.out, HasSubstr("'operator'"));
}

TEST(CliFit, AFailureIsAnObjectTooWhereProgramsRead) {
  TempFolder folder;
  const Finished finished =
      cli({"fit", (folder / "none").string(), "--out", (folder / "o").string(), "--progress", "json"});
  EXPECT_EQ(finished.status, 3);
  const std::vector<json> lines = jsonLines(finished.err);
  ASSERT_EQ(lines.size(), 1u) << finished.err;
  const json& error = lines[0].at("error");
  EXPECT_THAT(error.at("what").get<std::string>(), HasSubstr("no such bundle"));
  EXPECT_THAT(error.at("where").get<std::string>(), HasSubstr("none"));
  EXPECT_NE(error.at("try").get<std::string>(), "");
}

TEST(CliFit, NotesIgnoredKeys) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  json bundle = test::readBundleJson(folder / "b");
  bundle["camera"]["lens"] = "50 mm";
  test::writeBundleJson(folder / "b", bundle);
  const Finished finished =
      cli({"fit", (folder / "b").string(), "--out", (folder / "o").string(), "--size", "4"});
  EXPECT_EQ(finished.status, 0) << finished.err;
  EXPECT_THAT(finished.err, HasSubstr("Note: The key 'camera.lens'"));
}

TEST(CliFit, DumpsTheStages) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  const Finished finished = cli({"fit", (folder / "b").string(), "--out", (folder / "o").string(), "--size",
                                 "6", "--dump-dir", (folder / "d").string()});
  ASSERT_EQ(finished.status, 0) << finished.err;
  const Result<Image> light = readExr(folder / "d" / "window_minus_black.exr", {"R"});
  ASSERT_TRUE(light.ok());
  EXPECT_NEAR(light->at(0, 0), 0.040f, 1e-6f);
  const auto layers = exrChannels(folder / "d" / "spectrum_measured.exr");
  ASSERT_TRUE(layers.ok());
  EXPECT_EQ(layers->size(), kFrequencies + 1u);
  EXPECT_TRUE(fs::exists(folder / "d" / "diffuse.png"));
}

TEST(CliFit, DumpsSomeSpectraOfLargeMaps) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  const Finished finished = cli({"fit", (folder / "b").string(), "--out", (folder / "o").string(), "--size",
                                 "130", "--dump-dir", (folder / "d").string()});
  ASSERT_EQ(finished.status, 0) << finished.err;
  const auto residual = readExr(folder / "d" / "residual_dc.exr", {"G"});
  ASSERT_TRUE(residual.ok());
  EXPECT_EQ(residual->width(), 65);
  EXPECT_THAT(finished.err, HasSubstr("one texel in 2"));
}

TEST(CliFit, TexelOffTheMapsIsWrongUseButKeepsTheFit) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  const Finished finished = cli(
      {"fit", (folder / "b").string(), "--out", (folder / "o").string(), "--size", "6", "--texel", "6,0"});
  EXPECT_EQ(finished.status, 2);
  EXPECT_THAT(finished.err, HasSubstr("6 x 6"));
  EXPECT_TRUE(fs::exists(folder / "o" / "fit.json"));
}

TEST(CliFit, NeverWritesIntoTheBundle) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  const auto before = test::everythingIn(folder / "b");
  const Finished finished = cli({"fit", (folder / "b").string(), "--out", (folder / "b" / ".").string()});
  EXPECT_EQ(finished.status, 2) << finished.err;
  EXPECT_EQ(test::everythingIn(folder / "b"), before);
  const Finished deeper =
      cli({"fit", (folder / "b").string(), "--out", (folder / "b" / "new" / "fit").string()});
  EXPECT_EQ(deeper.status, 2) << deeper.err;
  EXPECT_THAT(deeper.err, HasSubstr((folder / "b-fit").string())) << "what it suggests would be taken";
  EXPECT_EQ(test::everythingIn(folder / "b"), before);
}

// Every kind of bad input: status 3, a sentence with what, where and what to try, and nothing left behind.
struct BadInput {
  std::string name;
  std::function<void(const fs::path& bundle)> breakIt;
  std::string words, where;
  int frequencies = kFrequencies;
};

void PrintTo(const BadInput& bad, std::ostream* out) {
  *out << bad.name;
}

void changeJson(const fs::path& bundle, const std::function<void(json&)>& change) {
  json description = test::readBundleJson(bundle);
  change(description);
  test::writeBundleJson(bundle, description);
}

void writePhoto(const fs::path& bundle, const Image& image) {
  if (!writeExr(bundle / "photo_1_2.exr", image, {"R", "G", "B"})) throw std::runtime_error("no photograph");
}

const BadInput kBadInputs[] = {
    {"MissingBundle", [](const fs::path& b) { fs::remove_all(b); }, "no such bundle", "bundle"},
    {"MissingDescription", [](const fs::path& b) { fs::remove(b / "capture.json"); }, "holds no capture.json",
     "bundle"},
    {"MissingPhoto", [](const fs::path& b) { fs::remove(b / "photo_1_2.exr"); }, "'photo_1_2.exr'",
     "photos[8].file"},
    {"WrongSize", [](const fs::path& b) { writePhoto(b, Image(13, 12, 3)); }, "13 x 12", "photo_1_2.exr"},
    {"Truncated",
     [](const fs::path& b) {
       const std::string bytes = test::readText(b / "photo_1_2.exr");
       test::writeText(b / "photo_1_2.exr", bytes.substr(0, bytes.size() / 2));
     },
     "truncated", "photo_1_2.exr"},
    {"NotANumber",
     [](const fs::path& b) {
       Image image(12, 12, 3);
       image.at(4, 5, 0) = NAN;
       writePhoto(b, image);
     },
     "NaN at pixel (4, 5)", "photo_1_2.exr"},
    {"MissingKey", [](const fs::path& b) { changeJson(b, [](json& j) { j["screen"].erase("width_mm"); }); },
     "missing", "screen.width_mm"},
    {"IllTypedKey",
     [](const fs::path& b) { changeJson(b, [](json& j) { j["photos"][7]["phase"] = "two"; }); },
     "a number is needed", "photos[7].phase"},
    {"OtherVersion", [](const fs::path& b) { changeJson(b, [](json& j) { j["version"] = 3; }); }, "version 3",
     "version"},
    {"KindUnknown", [](const fs::path& b) { changeJson(b, [](json& j) { j["kind"] = "hologram"; }); },
     "hologram", "kind"},
    {"LeavesItsFolder",
     [](const fs::path& b) {
       fs::copy(b / "photo_1_2.exr", b.parent_path() / "secret.exr");
       changeJson(b, [](json& j) { j["photos"][8]["file"] = "../secret.exr"; });
     },
     "leads out of the bundle", "photos[8].file"},
    {"ScreenFacesAway",
     [](const fs::path& b) {
       changeJson(b, [](json& j) {
         for (json& row : j["screen"]["R"]) {
           for (int column : {0, 2}) row[column] = -row[column].get<double>();  // turned about its y
         }
       });
     },
     "faces away from the sample", "screen.R"},
    {"NotJson", [](const fs::path& b) { test::writeText(b / "capture.json", "{\n nonsense"); },
     "not valid JSON", "line 2"},
    {"CantDetermineTheModel", [](const fs::path&) {}, "determine the model", "bundle", 1},
};

class BadInputTest : public testing::TestWithParam<BadInput> {};

TEST_P(BadInputTest, ExitsWithThreeAndLeavesNothing) {
  TempFolder folder;
  test::writeSmallBundle(folder / "bundle", GetParam().frequencies);
  GetParam().breakIt(folder / "bundle");
  const auto before = test::everythingIn(folder.path());
  const Finished finished =
      cli({"fit", (folder / "bundle").string(), "--out", (folder / "a" / "out").string(), "--size", "8"});
  EXPECT_EQ(finished.status, 3) << finished.err;
  EXPECT_THAT(finished.err, HasSubstr("Error: "));
  EXPECT_THAT(finished.err, HasSubstr(GetParam().words));
  EXPECT_THAT(finished.err, HasSubstr(GetParam().where));
  EXPECT_THAT(finished.err, HasSubstr("Try: "));
  EXPECT_EQ(test::everythingIn(folder.path()), before) << "nothing half-written";
}

INSTANTIATE_TEST_SUITE_P(Every, BadInputTest, testing::ValuesIn(kBadInputs),
                         [](const auto& info) { return info.param.name; });

TEST(CliFit, NoSpaceLeavesTheEarlierResultWhole) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  const std::vector<std::string> command = {
      "fit", (folder / "b").string(), "--out", (folder / "o").string(), "--size", "32"};
  ASSERT_EQ(cli(command).status, 0);
  const std::string earlier = test::readText(folder / "o" / "fit.json");
  const auto before = test::everythingIn(folder.path());
  RunOptions tight;
  tight.fileSizeLimit = 512;  // no map fits into this
  const Finished finished = cli(command, tight);
  EXPECT_EQ(finished.status, 3) << finished.err;
  EXPECT_THAT(finished.err, HasSubstr("Try: "));
  EXPECT_EQ(test::everythingIn(folder.path()), before);
  EXPECT_EQ(test::readText(folder / "o" / "fit.json"), earlier);
}

TEST(CliFit, SaysBeforeTheWorkThatItCannotWrite) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b", kFrequencies);
  test::writeText(folder / "file", "mine");
  for (const std::string& out :
       {(folder / "file").string(), (folder / "file" / "out").string(), std::string("/proc/x/out")}) {
    const Finished finished = cli({"fit", (folder / "b").string(), "--out", out});
    EXPECT_EQ(finished.status, 3) << out << ": " << finished.err;
    EXPECT_THAT(finished.err, testing::Not(HasSubstr("Fitting"))) << "before minutes of work, not after";
  }
  EXPECT_EQ(test::readText(folder / "file"), "mine");
}

TEST(CliFit, FullStdoutIsNotDone) {
  TempFolder folder;
  const Finished finished =
      test::runProgram({"/bin/sh", "-c", std::string(PATINA_CLI_PATH) + " --help >/dev/full"});
  EXPECT_EQ(finished.status, 3);
  EXPECT_THAT(finished.err, HasSubstr("stdout"));
}

struct Interruption {
  std::string name;
  int signal;
  std::string stage;  ///< the signal comes when this stage has begun
  bool kept;          ///< something was fitted by then
};

void PrintTo(const Interruption& interruption, std::ostream* out) {
  *out << interruption.name;
}

class CliSignal : public testing::TestWithParam<Interruption> {};

TEST_P(CliSignal, CancelsKeepsAndMarks) {
  TempFolder folder;
  constexpr int kSide = 40;  // pixels: seconds of work, so that the signal finds it still busy
  test::writeSmallBundle(folder / "b", kFrequencies, kSide);
  const auto before = test::everythingIn(folder.path());
  RunOptions options;
  options.watch = [](const std::string& err) {
    return err.find("\"" + GetParam().stage + "\"") != std::string::npos ? GetParam().signal : 0;
  };
  const Finished finished =
      cli({"fit", (folder / "b").string(), "--out", (folder / "o").string(), "--threads", "1",
           "--max-iterations", "1000", "--tolerance", "1e-12", "--progress", "json", "--texel", "4000,0"},
          options);
  EXPECT_EQ(finished.status, 4) << finished.err;
  EXPECT_THAT(jsonLines(finished.err).back().at("error").at("what").get<std::string>(),
              testing::ContainsRegex("[Cc]ancelled|stopped"))
      << "one object a line to the very end";
  if (GetParam().kept) {
    const Result<SvbrdfMaps> maps = readMaps(folder / "o" / "maps");
    ASSERT_TRUE(maps.ok()) << maps.error().sentence();
    const auto status = maps->status.samples();
    EXPECT_GT(std::count(status.begin(), status.end(), static_cast<float>(TexelStatus::Cancelled)), 0);
    EXPECT_THAT(json::parse(test::readText(folder / "o" / "fit.json")).dump(),
                HasSubstr("\"cancelled\":true"));
    EXPECT_THAT(finished.out, HasSubstr("Relative error: not computed")) << "an error of 0 % would be a lie";
  } else {
    EXPECT_EQ(test::everythingIn(folder.path()), before) << "nothing was finished, so nothing is kept";
  }
  for (const std::string& name : test::everythingIn(folder.path())) {
    EXPECT_THAT(name, testing::Not(HasSubstr(".partial-")));
  }
}

INSTANTIATE_TEST_SUITE_P(Signals, CliSignal,
                         testing::Values(Interruption{"InterruptWhileFitting", SIGINT, "solve", true},
                                         Interruption{"TerminateWhileFitting", SIGTERM, "solve", true},
                                         Interruption{"InterruptWhileReading", SIGINT, "read", false}),
                         [](const auto& info) { return info.param.name; });

}  // namespace
}  // namespace patina
