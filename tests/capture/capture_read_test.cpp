#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <functional>

#include "engine/capture/capture.h"
#include "tests/capture/small_bundle.h"
#include "tests/test_data.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::TempFolder;
using testing::HasSubstr;

class CollectingLog : public LogSink {
 public:
  void log(Level level, std::string_view sentence) override {
    (level == Level::Warning ? warnings : notes).emplace_back(sentence);
  }
  std::vector<std::string> notes, warnings;
};

TEST(ReadFourierCapture, BringsBackWhatWasWritten) {
  TempFolder folder;
  FourierCapture written = test::writeSmallBundle(folder / "b");
  written.known = KnownLambertian{{0.9, 0.8, 0.7}};
  written.radianceScale = 1.0 / 3.0;
  written.camera.distortion << 0.1, -0.01, 1e-4, -1e-4, 1e-3;
  written.photos[3].holdout = true;
  ASSERT_TRUE(writeFourierCapture(written).ok());
  const Result<FourierCapture> read = readFourierCapture(folder / "b");
  ASSERT_TRUE(read.ok()) << read.error().sentence();
  EXPECT_EQ(fourierCaptureJson(*read), fourierCaptureJson(written)) << "to the last digit";
  EXPECT_EQ(read->photos.size(), 10u);
  EXPECT_EQ(read->photos[2].frequency, Eigen::Vector2i(1, 1));
  EXPECT_EQ(read->photos[5].phase, 3);
  EXPECT_TRUE(read->photos[3].holdout);
  EXPECT_EQ(read->camera.cameraFromWorld, written.camera.cameraFromWorld);
  EXPECT_EQ(read->radianceScale, 1.0 / 3.0);
  EXPECT_EQ(read->known->albedo, Eigen::Vector3d(0.9, 0.8, 0.7));
  EXPECT_EQ(read->sampleName, "test sheet");
  EXPECT_EQ(read->screen.windowSigma, written.screen.windowSigma);
  ASSERT_TRUE(read->screen.emission);
  EXPECT_EQ(read->screen.emission->sigma, Eigen::Vector2d(1.6, 1.3));
  EXPECT_TRUE(read->ignoredKeys.empty());
}

TEST(ReadFourierCapture, TakesTheFileItselfToo) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b");
  const Result<FourierCapture> read = readFourierCapture(folder / "b" / "capture.json");
  ASSERT_TRUE(read.ok()) << read.error().sentence();
  EXPECT_EQ(read->folder, folder / "b");
}

TEST(ReadFourierCapture, IgnoresUnknownKeysAndSaysSo) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b");
  json bundle = test::readBundleJson(folder / "b");
  bundle["operator"] = "me";
  bundle["camera"]["serial"] = {{"deep", {1, 2, 3}}};
  bundle["screen"]["window"]["x"] = nullptr;
  for (json& photo : bundle["photos"]) photo["iso"] = 100;
  test::writeBundleJson(folder / "b", bundle);
  CollectingLog log;
  JobContext job;
  job.logSink = &log;
  const Result<FourierCapture> read = readFourierCapture(folder / "b", job);
  ASSERT_TRUE(read.ok()) << read.error().sentence();
  EXPECT_THAT(read->ignoredKeys,
              testing::UnorderedElementsAre("operator", "camera.serial", "screen.window.x", "photos[].iso"));
  EXPECT_EQ(log.notes.size(), 4u);
  EXPECT_THAT(log.notes, testing::Contains(HasSubstr("'camera.serial'")));
}

TEST(ReadFourierCapture, KnowsWhoMadeIt) {
  TempFolder folder;
  FourierCapture written = test::writeSmallBundle(folder / "b");
  written.madeBy = "some program";
  ASSERT_TRUE(writeFourierCapture(written).ok());
  const Result<FourierCapture> read = readFourierCapture(folder / "b");
  ASSERT_TRUE(read.ok()) << read.error().sentence();
  EXPECT_EQ(read->madeBy, "some program");
  EXPECT_TRUE(read->ignoredKeys.empty());
  json bundle = test::readBundleJson(folder / "b");
  bundle["made_by"] = {{"name", "a stranger's own use of the key"}};
  test::writeBundleJson(folder / "b", bundle);
  const Result<FourierCapture> strange = readFourierCapture(folder / "b");
  ASSERT_TRUE(strange.ok()) << strange.error().sentence();
  EXPECT_EQ(strange->madeBy, "");
  EXPECT_THAT(strange->ignoredKeys, testing::ElementsAre("made_by"));
}

TEST(ReadFourierCapture, WarnsOfAFileUsedTwice) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b");
  json bundle = test::readBundleJson(folder / "b");
  bundle["photos"][4]["file"] = bundle["photos"][3]["file"];
  test::writeBundleJson(folder / "b", bundle);
  CollectingLog log;
  JobContext job;
  job.logSink = &log;
  EXPECT_TRUE(readFourierCapture(folder / "b", job).ok());
  EXPECT_THAT(log.warnings, testing::ElementsAre(HasSubstr("photos[4]")));
}

TEST(ReadFourierCapture, StopsWhenCancelled) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b");
  std::stop_source source;
  source.request_stop();
  JobContext job;
  job.stop = source.get_token();
  EXPECT_EQ(readFourierCapture(folder / "b", job).error().code, ErrorCode::Cancelled);
}

TEST(ReadFourierCapture, NamesWhatIsNotThere) {
  TempFolder folder;
  const Error nothing = readFourierCapture(folder / "none").error();
  EXPECT_EQ(nothing.code, ErrorCode::NotFound);
  EXPECT_EQ(nothing.where, (folder / "none").string());
  test::writeSmallBundle(folder / "b");
  const Error outside = readFourierCapture(folder.path()).error();
  EXPECT_EQ(outside.code, ErrorCode::NotFound);
  EXPECT_THAT(outside.tryThis, HasSubstr((folder / "b").string())) << "the bundle is one level down";
  EXPECT_EQ(readFourierCapture(folder / "b" / "window.exr").error().code, ErrorCode::NotFound);
}

// Every way in which a description can be wrong: what is done to it, the code, and the key and words of the
// sentence.
struct Broken {
  std::string name;
  std::function<void(json&)> breakIt;
  ErrorCode code;
  std::string key;    // in `where`
  std::string words;  // in `what` or `tryThis`
};

void PrintTo(const Broken& broken, std::ostream* out) {
  *out << broken.name;
}

const double kHuge = 1e300;

const Broken kBroken[] = {
    {"NotAnObject", [](json& b) { b = json::array({1}); }, ErrorCode::Malformed, "capture.json", "an object"},
    {"NoFormat", [](json& b) { b.erase("format"); }, ErrorCode::Malformed, "format", "missing"},
    {"OtherFormat", [](json& b) { b["format"] = "zip"; }, ErrorCode::Malformed, "format",
     "not a capture bundle"},
    {"NoVersion", [](json& b) { b.erase("version"); }, ErrorCode::Malformed, "version", "missing"},
    {"OtherVersion", [](json& b) { b["version"] = 2; }, ErrorCode::Unsupported, "version", "version 2"},
    {"HalfVersion", [](json& b) { b["version"] = 1.5; }, ErrorCode::Malformed, "version", "whole number"},
    {"TextVersion", [](json& b) { b["version"] = "1"; }, ErrorCode::Malformed, "version",
     "a number is needed"},
    {"TwoShot", [](json& b) { b["kind"] = "two-shot"; }, ErrorCode::Unsupported, "kind", "two-shot capture"},
    {"Flash", [](json& b) { b["kind"] = "flash"; }, ErrorCode::Unsupported, "kind", "not of kind 'fourier'"},
    {"StrangeKind", [](json& b) { b["kind"] = "x-ray"; }, ErrorCode::Unsupported, "kind", "'x-ray'"},
    {"NoSample", [](json& b) { b.erase("sample"); }, ErrorCode::Malformed, "sample", "missing"},
    {"SampleAsList",
     [](json& b) {
       b["sample"] = {1, 2};
     },
     ErrorCode::Malformed, "sample", "an object"},
    {"NoSampleWidth", [](json& b) { b["sample"].erase("width_mm"); }, ErrorCode::Malformed, "sample.width_mm",
     "missing"},
    {"ZeroSampleWidth", [](json& b) { b["sample"]["width_mm"] = 0; }, ErrorCode::Invalid, "sample.width_mm",
     "0"},
    {"NegativeHeight", [](json& b) { b["sample"]["height_mm"] = -5; }, ErrorCode::Invalid, "sample.height_mm",
     "-5"},
    {"HugeHeight", [](json& b) { b["sample"]["height_mm"] = kHuge; }, ErrorCode::Invalid, "sample.height_mm",
     "1e+300"},
    {"MisspeltKey",
     [](json& b) {
       b["sample"]["widht_mm"] = b["sample"]["width_mm"];
       b["sample"].erase("width_mm");
     },
     ErrorCode::Malformed, "sample.width_mm", "'sample.widht_mm'"},
    {"NameAsNumber", [](json& b) { b["sample"]["name"] = 7; }, ErrorCode::Malformed, "sample.name", "text"},
    {"KnownType",
     [](json& b) {
       b["sample"]["known"] = {{"type", "mirror"}};
     },
     ErrorCode::Unsupported, "sample.known.type", "'mirror'"},
    {"KnownAlbedo",
     [](json& b) {
       b["sample"]["known"] = {{"type", "lambertian"}, {"albedo", {1, 2, 0}}};
     },
     ErrorCode::Invalid, "sample.known.albedo[1]", "2"},
    {"NoCamera", [](json& b) { b.erase("camera"); }, ErrorCode::Malformed, "camera", "missing"},
    {"HalfPixel", [](json& b) { b["camera"]["width"] = 12.5; }, ErrorCode::Malformed, "camera.width",
     "whole"},
    {"NoPixels", [](json& b) { b["camera"]["height"] = 0; }, ErrorCode::Invalid, "camera.height", "0"},
    {"TooManyPixels", [](json& b) { b["camera"]["width"] = b["camera"]["height"] = 100000; },
     ErrorCode::Invalid, "camera.width", "2^28"},
    {"WidthOverflow", [](json& b) { b["camera"]["width"] = 18446744073709551615ull; }, ErrorCode::Invalid,
     "camera.width", "outside"},
    {"SmallK",
     [](json& b) {
       b["camera"]["K"] = {{1, 0}, {0, 1}};
     },
     ErrorCode::Malformed, "camera.K", "3"},
    {"FlatK", [](json& b) { b["camera"]["K"] = {1, 0, 0, 0, 1, 0, 0, 0, 1}; }, ErrorCode::Malformed,
     "camera.K", "9"},
    {"RowK", [](json& b) { b["camera"]["K"][1] = "x"; }, ErrorCode::Malformed, "camera.K[1]", "row"},
    {"TextInK", [](json& b) { b["camera"]["K"][1][2] = "x"; }, ErrorCode::Malformed, "camera.K[1][2]",
     "text"},
    {"NegativeFocal", [](json& b) { b["camera"]["K"][0][0] = -45; }, ErrorCode::Invalid, "camera.K",
     "positive"},
    {"SkewedK", [](json& b) { b["camera"]["K"][0][1] = 3; }, ErrorCode::Unsupported, "camera.K[0][1]",
     "skew"},
    {"LowerK", [](json& b) { b["camera"]["K"][2][0] = 3; }, ErrorCode::Invalid, "camera.K", "fx"},
    {"FourDistortion",
     [](json& b) {
       b["camera"]["distortion"] = {0, 0, 0, 0};
     },
     ErrorCode::Malformed, "camera.distortion", "4"},
    {"TextDistortion", [](json& b) { b["camera"]["distortion"][4] = "0"; }, ErrorCode::Malformed,
     "camera.distortion[4]", "text"},
    {"ScaledR", [](json& b) { b["camera"]["R"][0][0] = 1.01; }, ErrorCode::Invalid, "camera.R",
     "not a rotation"},
    {"MirrorR", [](json& b) { b["camera"]["R"][0][0] = -1; }, ErrorCode::Invalid, "camera.R", "reflection"},
    {"NullR", [](json& b) { b["camera"]["R"] = nullptr; }, ErrorCode::Malformed, "camera.R", "null"},
    {"ZeroR",
     [](json& b) {
       b["screen"]["R"] = {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}};
     },
     ErrorCode::Invalid, "screen.R", "not a rotation"},
    {"ShortT",
     [](json& b) {
       b["camera"]["t"] = {1, 2};
     },
     ErrorCode::Malformed, "camera.t", "2"},
    {"CameraBehind",
     [](json& b) {
       b["camera"]["t"] = {0, 0, -450};
     },
     ErrorCode::Invalid, "camera.t", "in front"},
    {"CameraLooksAway",
     [](json& b) {
       b["camera"]["R"] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
       b["camera"]["t"] = {0, 0, -450};
     },
     ErrorCode::Invalid, "camera.t", "behind it"},
    {"ScreenFacesAway",
     [](json& b) {
       for (json& row : b["screen"]["R"]) {
         for (int column : {0, 2}) row[column] = -row[column].get<double>();  // turned about its own y
       }
     },
     ErrorCode::Invalid, "screen.R", "faces away from the sample"},
    {"ScreenCutsTheSample",
     [](json& b) {
       b["screen"]["t"] = {0, 20, 20};
     },
     ErrorCode::Invalid, "screen.R", "a corner of it"},
    {"ScreenBehindTheSample",
     [](json& b) {
       const double s = std::sqrt(0.5);
       b["screen"]["R"] = {{1, 0, 0}, {0, s, -s}, {0, s, s}};  // below the table, facing up at the sample
       b["screen"]["t"] = {0, 200, -200};
     },
     ErrorCode::Invalid, "screen.t", "behind the sample"},
    {"NoScreen", [](json& b) { b.erase("screen"); }, ErrorCode::Malformed, "screen", "missing"},
    {"NoScreenPixels", [](json& b) { b["screen"].erase("width_px"); }, ErrorCode::Malformed,
     "screen.width_px", "missing"},
    {"NoWindow", [](json& b) { b["screen"].erase("window"); }, ErrorCode::Malformed, "screen.window",
     "missing"},
    {"BoxWindow", [](json& b) { b["screen"]["window"]["type"] = "box"; }, ErrorCode::Unsupported,
     "screen.window.type", "'box'"},
    {"ZeroSigma", [](json& b) { b["screen"]["window"]["sigma"][1] = 0; }, ErrorCode::Invalid,
     "screen.window.sigma[1]", "0"},
    {"NoGain", [](json& b) { b["screen"]["emission"].erase("gain"); }, ErrorCode::Malformed,
     "screen.emission.gain", "missing"},
    {"EmissionAsNumber", [](json& b) { b["screen"]["emission"] = 3; }, ErrorCode::Malformed,
     "screen.emission", "a number"},
    {"ZeroScale", [](json& b) { b["radiance_scale"] = 0; }, ErrorCode::Invalid, "radiance_scale", "0"},
    {"TextScale", [](json& b) { b["radiance_scale"] = "2"; }, ErrorCode::Malformed, "radiance_scale", "text"},
    {"NoPhotos", [](json& b) { b.erase("photos"); }, ErrorCode::Malformed, "photos", "missing"},
    {"EmptyPhotos", [](json& b) { b["photos"] = json::array(); }, ErrorCode::Malformed, "photos", "0"},
    {"PhotosAsObject", [](json& b) { b["photos"] = json::object(); }, ErrorCode::Malformed, "photos",
     "a list"},
    {"PhotoAsText", [](json& b) { b["photos"][3] = "a.exr"; }, ErrorCode::Malformed, "photos[3]", "text"},
    {"NoFile", [](json& b) { b["photos"][3].erase("file"); }, ErrorCode::Malformed, "photos[3].file",
     "missing"},
    {"EmptyFile", [](json& b) { b["photos"][3]["file"] = ""; }, ErrorCode::Malformed, "photos[3].file",
     "empty"},
    {"NulInFile", [](json& b) { b["photos"][3]["file"] = std::string("window.exr\0x", 12); },
     ErrorCode::Malformed, "photos[3].file", "\\x00"},
    {"LongFile", [](json& b) { b["photos"][3]["file"] = std::string(100000, 'a'); }, ErrorCode::Malformed,
     "photos[3].file", "name of a file"},
    {"AbsentFile", [](json& b) { b["photos"][3]["file"] = "gone.exr"; }, ErrorCode::NotFound,
     "photos[3].file", "'gone.exr'"},
    {"AbsoluteFile", [](json& b) { b["photos"][3]["file"] = "/etc/passwd"; }, ErrorCode::Refused,
     "photos[3].file", "leads out"},
    {"ParentFile", [](json& b) { b["photos"][3]["file"] = "../other/x.exr"; }, ErrorCode::Refused,
     "photos[3].file", "leads out"},
    {"HiddenParent", [](json& b) { b["photos"][3]["file"] = "a/../../x.exr"; }, ErrorCode::Refused,
     "photos[3].file", "leads out"},
    {"FolderAsFile", [](json& b) { b["photos"][3]["file"] = "."; }, ErrorCode::Refused, "photos[3].file",
     "not a plain file"},
    {"NoRole", [](json& b) { b["photos"][3].erase("role"); }, ErrorCode::Malformed, "photos[3].role",
     "missing"},
    {"MisspeltRole", [](json& b) { b["photos"][3]["role"] = "patern"; }, ErrorCode::Malformed,
     "photos[3].role", "'pattern'"},
    {"NoExposure", [](json& b) { b["photos"][3].erase("exposure_s"); }, ErrorCode::Malformed,
     "photos[3].exposure_s", "missing"},
    {"NegativeExposure", [](json& b) { b["photos"][3]["exposure_s"] = -1; }, ErrorCode::Invalid,
     "photos[3].exposure_s", "-1"},
    {"NoFrequency", [](json& b) { b["photos"][3].erase("frequency"); }, ErrorCode::Malformed,
     "photos[3].frequency", "missing"},
    {"HalfFrequency",
     [](json& b) {
       b["photos"][3]["frequency"] = {1, 0.5};
     },
     ErrorCode::Invalid, "photos[3].frequency[1]", "whole"},
    {"HugeFrequency",
     [](json& b) {
       b["photos"][3]["frequency"] = {1, 1e9};
     },
     ErrorCode::Invalid, "photos[3].frequency[1]", "1000000000"},
    {"NoPhase", [](json& b) { b["photos"][3].erase("phase"); }, ErrorCode::Malformed, "photos[3].phase",
     "missing"},
    {"FifthPhase", [](json& b) { b["photos"][3]["phase"] = 4; }, ErrorCode::Invalid, "photos[3].phase", "4"},
    {"BoolPhase", [](json& b) { b["photos"][3]["phase"] = true; }, ErrorCode::Malformed, "photos[3].phase",
     "true or false"},
    {"TwiceTheSame", [](json& b) { b["photos"][4]["phase"] = b["photos"][3]["phase"]; }, ErrorCode::Invalid,
     "photos[4].phase", "photos[3]"},
    {"StrangeSplit", [](json& b) { b["photos"][3]["split"] = "hold-out"; }, ErrorCode::Malformed,
     "photos[3].split", "'hold-out'"},
    {"StrangeEncoding", [](json& b) { b["photos"][3]["encoding"] = "rec709"; }, ErrorCode::Malformed,
     "photos[3].encoding", "'rec709'"},
    {"GammaWord", [](json& b) { b["photos"][3]["encoding"] = "gamma:two"; }, ErrorCode::Malformed,
     "photos[3].encoding", "gamma"},
    {"GammaTail", [](json& b) { b["photos"][3]["encoding"] = "gamma:2.2x"; }, ErrorCode::Malformed,
     "photos[3].encoding", "gamma"},
    {"GammaInfinite", [](json& b) { b["photos"][3]["encoding"] = "gamma:inf"; }, ErrorCode::Malformed,
     "photos[3].encoding", "gamma"},
    {"ResponseOutside", [](json& b) { b["photos"][3]["encoding"] = "response:../r.json"; },
     ErrorCode::Refused, "photos[3].encoding", "leads out"},
    {"ResponseGone", [](json& b) { b["photos"][3]["encoding"] = "response:r.json"; }, ErrorCode::NotFound,
     "photos[3].encoding", "'r.json'"},
    {"PngWithoutEncoding", [](json& b) { b["photos"][3]["file"] = "x.PNG"; }, ErrorCode::Malformed,
     "photos[3].encoding", "PNG"},
    {"NoWindowPhoto", [](json& b) { b["photos"][0]["role"] = "geometry"; }, ErrorCode::Invalid, "photos",
     "'window'"},
    {"NoBlackPhoto", [](json& b) { b["photos"][1]["role"] = "geometry"; }, ErrorCode::Invalid, "photos",
     "'black'"},
    {"BlackHeldOut", [](json& b) { b["photos"][1]["split"] = "holdout"; }, ErrorCode::Invalid, "photos",
     "'black'"},
};

class BrokenBundle : public testing::TestWithParam<Broken> {};

TEST_P(BrokenBundle, GetsASentence) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b");
  json bundle = test::readBundleJson(folder / "b");
  GetParam().breakIt(bundle);
  test::writeBundleJson(folder / "b", bundle);
  const Result<FourierCapture> read = readFourierCapture(folder / "b");
  ASSERT_FALSE(read.ok());
  const Error& error = read.error();
  EXPECT_EQ(error.code, GetParam().code) << error.sentence();
  EXPECT_THAT(error.where, HasSubstr((folder / "b" / "capture.json").string()));
  EXPECT_TRUE(error.where.ends_with(GetParam().key)) << error.where;
  EXPECT_THAT(error.what + " | " + error.tryThis, HasSubstr(GetParam().words));
  EXPECT_FALSE(error.tryThis.empty()) << error.sentence();
  EXPECT_LT(error.sentence().size(), 1000u);
}

INSTANTIATE_TEST_SUITE_P(Every, BrokenBundle, testing::ValuesIn(kBroken),
                         [](const auto& info) { return info.param.name; });

TEST(ReadFourierCapture, RefusesLinksThatLeaveTheFolder) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b");
  fs::rename(folder / "b" / "window.exr", folder / "outside.exr");
  fs::create_symlink("../outside.exr", folder / "b" / "window.exr");
  const Error error = readFourierCapture(folder / "b").error();
  EXPECT_EQ(error.code, ErrorCode::Refused);
  EXPECT_TRUE(error.where.ends_with("photos[0].file")) << error.where;

  // A neighbour whose name begins like the bundle's is outside, too.
  fs::create_directory(folder / "bb");
  fs::rename(folder / "outside.exr", folder / "bb" / "window.exr");
  fs::remove(folder / "b" / "window.exr");
  fs::create_symlink("../bb", folder / "b" / "link");
  json bundle = test::readBundleJson(folder / "b");
  bundle["photos"][0]["file"] = "link/window.exr";
  test::writeBundleJson(folder / "b", bundle);
  EXPECT_EQ(readFourierCapture(folder / "b").error().code, ErrorCode::Refused);
}

TEST(ReadFourierCapture, FollowsLinksThatStayInside) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b");
  fs::rename(folder / "b" / "window.exr", folder / "b" / "w.exr");
  fs::create_symlink("w.exr", folder / "b" / "window.exr");
  fs::create_directory_symlink("b", folder / "alias");
  EXPECT_TRUE(readFourierCapture(folder / "alias").ok()) << "a bundle reached through a link";
}

TEST(ReadFourierCapture, RefusesAPipeForAPhotograph) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b");
  fs::remove(folder / "b" / "window.exr");
  ASSERT_EQ(::mkfifo((folder / "b" / "window.exr").c_str(), 0600), 0);
  EXPECT_EQ(readFourierCapture(folder / "b").error().code, ErrorCode::Refused);
}

TEST(ReadFourierCapture, AcceptsRotationsOfFourDecimalsAndStraightensThem) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b");
  json bundle = test::readBundleJson(folder / "b");
  bundle["camera"]["R"] = {{1, 0, 0}, {0, -0.7071, -0.7071}, {0, 0.7071, -0.7071}};
  test::writeBundleJson(folder / "b", bundle);
  const Result<FourierCapture> read = readFourierCapture(folder / "b");
  ASSERT_TRUE(read.ok()) << read.error().sentence();
  const Eigen::Matrix3d r = read->camera.cameraFromWorld;
  EXPECT_LT((r * r.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_NEAR(r(1, 1), -std::sqrt(0.5), 1e-12);
}

TEST(ReadFourierCapture, SurvivesTextThatIsNotJson) {
  const auto codeOf = [](const std::string& text) {
    const Result<FourierCapture> read = parseFourierCapture(text, "b", "capture.json");
    EXPECT_FALSE(read.ok());
    if (read.ok()) return ErrorCode::Cancelled;
    EXPECT_FALSE(read.error().tryThis.empty());
    return read.error().code;
  };
  EXPECT_EQ(codeOf(""), ErrorCode::Malformed);
  EXPECT_EQ(codeOf("{"), ErrorCode::Malformed);
  EXPECT_EQ(codeOf(std::string(1 << 20, '\0')), ErrorCode::Malformed);
  EXPECT_EQ(codeOf(std::string(5 << 20, '[')), ErrorCode::Malformed) << "five million levels deep";
  std::string objects;
  for (int i = 0; i < 100000; ++i) objects += "{\"a\":";
  EXPECT_EQ(codeOf(objects), ErrorCode::Malformed);
  EXPECT_EQ(codeOf("{\"format\": \"\xFF\xFE\"}"), ErrorCode::Malformed) << "not UTF-8";
  EXPECT_EQ(codeOf("{\"format\": NaN}"), ErrorCode::Malformed);
  EXPECT_EQ(codeOf("{\"format\": \"patina-capture\", \"version\": 1e999}"), ErrorCode::Malformed);
  EXPECT_EQ(codeOf("{\"format\": \"patina-capture\", \"version\": 1} x"), ErrorCode::Malformed)
      << "something behind it";
}

TEST(ReadFourierCapture, NamesLineAndColumnOfBrokenJson) {
  const Error error =
      parseFourierCapture("{\n  \"format\": \"patina-capture\",\n  nonsense\n}", "b", "capture.json").error();
  EXPECT_THAT(error.where, HasSubstr("line 3, column 4"));
}

TEST(ReadFourierCapture, RefusesAKeyGivenTwice) {
  const Error error = parseFourierCapture("{\"version\": 1, \"version\": 2}", "b", "capture.json").error();
  EXPECT_EQ(error.code, ErrorCode::Malformed);
  EXPECT_THAT(error.what, HasSubstr("'version' is given twice"));
}

TEST(ReadFourierCapture, TakesWholeNumbersWrittenAsDecimals) {
  TempFolder folder;
  test::writeSmallBundle(folder / "b");
  json bundle = test::readBundleJson(folder / "b");
  bundle["photos"][3]["frequency"] = {1.0, 1.0};
  bundle["version"] = 1.0;
  test::writeBundleJson(folder / "b", bundle);
  EXPECT_TRUE(readFourierCapture(folder / "b").ok());
}

TEST(WriteFourierCapture, SaysWhenItCannot) {
  TempFolder folder;
  test::writeText(folder / "file", "x");
  const Status written = writeFourierCapture(test::smallCapture(folder / "file" / "b", 1));
  ASSERT_FALSE(written.ok());
  EXPECT_EQ(written.error().code, ErrorCode::WriteFailed);
  EXPECT_EQ(test::everythingIn(folder.path()), std::vector<std::string>{"file"});
}

TEST(ReadFourierCapture, ReadsEveryBundleOfTheTestData) {
  PATINA_NEEDS_SHARED("fourier");
  int count = 0;
  for (const auto& entry : fs::directory_iterator(test::sharedData() / "fourier")) {
    if (!fs::exists(entry.path() / "capture.json")) continue;
    const Result<FourierCapture> read = readFourierCapture(entry.path());
    ASSERT_TRUE(read.ok()) << read.error().sentence();
    EXPECT_EQ(read->photos.size(), 166u);
    EXPECT_TRUE(read->ignoredKeys.empty()) << read->ignoredKeys.front();
    ++count;
  }
  EXPECT_GE(count, 14);
}

}  // namespace
}  // namespace patina
