#include "devices/simulated/photo_effects.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "devices/simulated/sheet_form.h"
#include "devices/simulated/simulated_rig.h"
#include "engine/image/exr.h"

namespace patina {
namespace {

namespace fs = std::filesystem;

class Folder {
 public:
  Folder() {
    std::string name = (fs::temp_directory_path() / "patina-photo-effects-XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  fs::path operator/(const std::string& name) const { return path_ / name; }

 private:
  fs::path path_;
};

constexpr int kPhotos = 100;
constexpr double kBlack = 0.01, kFull = 2.0;

SimulatedEffects read(const char* text) {
  return simulatedEffectsFromJson(text, "test").value();
}

/// A picture with something in it.
Image picture() {
  Image image(21, 17, 3);
  for (int y = 0; y < 17; ++y)
    for (int x = 0; x < 21; ++x)
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = 0.2f + 0.03f * ((x * 7 + y * 5 + c * 3) % 11);
  return image;
}

Image taken(const char* text, int index, Image albedo = {}) {
  Image image = picture();
  const PhotoEffects effects(read(text), kPhotos, 1, kBlack, kFull, std::move(albedo), 3);
  effects.beforeSensor(image, index);
  return image;
}

double mean(const Image& image) {
  double sum = 0;
  for (const float sample : image.samples()) sum += sample;
  return sum / static_cast<double>(image.samples().size());
}

TEST(PhotoEffects, NoneAddsTheBlackLevelAndNothingElse) {
  Image expected = picture();
  for (float& sample : expected.samples()) sample += static_cast<float>(kBlack);
  EXPECT_TRUE(std::ranges::equal(taken("{}", 7).samples(), expected.samples()));
}

TEST(PhotoEffects, DriftAndFlickerScaleTheScreensLightAndNotTheBlackLevel) {
  const PhotoEffects warm(read(R"({"screen-drift": {"warmUp": 0.2, "warmUpPhotos": 30}})"), kPhotos, 1,
                          kBlack, kFull, {}, 3);
  EXPECT_NEAR(warm.screenFactor(0), 0.8, 1e-12);
  EXPECT_NEAR(warm.screenFactor(30), 1 - 0.2 * std::exp(-1.0), 1e-12);
  const PhotoEffects linear(read(R"({"screen-drift": {"linear": 0.1}})"), kPhotos, 1, kBlack, kFull, {}, 3);
  EXPECT_NEAR(linear.screenFactor(kPhotos - 1) / linear.screenFactor(0), 1.1, 1e-12);
  const Image first = taken(R"({"screen-drift": {"warmUp": 0.2}})", 0);
  const Image before = picture();
  for (std::size_t i = 0; i < first.samples().size(); ++i)
    EXPECT_NEAR(first.samples()[i], 0.8 * before.samples()[i] + kBlack, 1e-6);
  // 4000 draws: the standard deviation within 5 % (more than four of its own), no trend.
  const PhotoEffects flicker(read(R"({"flicker": {"sd": 0.02}})"), 4000, 1, kBlack, kFull, {}, 3);
  double sum = 0, squares = 0, neighbours = 0;
  for (int i = 0; i < 4000; ++i) {
    const double d = flicker.screenFactor(i) - 1;
    sum += d, squares += d * d;
    if (i) neighbours += d * (flicker.screenFactor(i - 1) - 1);
  }
  EXPECT_NEAR(std::sqrt(squares / 4000), 0.02, 0.001);
  EXPECT_NEAR(sum / 4000, 0, 5 * 0.02 / std::sqrt(4000.0));
  EXPECT_NEAR(neighbours / squares, 0, 5 / std::sqrt(4000.0));
}

TEST(PhotoEffects, FlickerDependsOnTheSeedAlone) {
  const auto factor = [](std::uint64_t seed) {
    return PhotoEffects(read(R"({"flicker": {"sd": 0.02}})"), kPhotos, 1, kBlack, kFull, {}, seed)
        .screenFactor(5);
  };
  EXPECT_EQ(factor(1), factor(1));
  EXPECT_NE(factor(1), factor(2));
}

TEST(PhotoEffects, WrongExposureIsOfTheLaterPhotographs) {
  const PhotoEffects effects(read(R"({"exposure-mismatch": {"error": 0.05, "share": 0.4}})"), kPhotos, 1,
                             kBlack, kFull, {}, 3);
  EXPECT_EQ(effects.screenFactor(59), 1);
  EXPECT_FALSE(effects.otherExposure(59));
  EXPECT_NEAR(effects.screenFactor(60), 1.05, 1e-12);
  EXPECT_TRUE(effects.otherExposure(60));
}

TEST(PhotoEffects, AmbientLightGrowsByPhotographAndFallsWhereItShould) {
  const char* veil = R"({"ambient-drift": {"perPhoto": 1e-3}})";
  const Image before = picture(), after = taken(veil, 50);
  for (std::size_t i = 0; i < after.samples().size(); ++i)
    EXPECT_NEAR(after.samples()[i] - before.samples()[i], kBlack + 50 * 1e-3 * kFull, 1e-6);
  Image albedo(21, 17, 3, 0.0f);
  albedo.at(4, 5, 1) = 0.7f;
  const Image lit = taken(R"({"ambient-drift": {"perPhoto": 1e-3, "onSheet": 1}})", 50, albedo);
  EXPECT_NEAR(lit.at(4, 5, 1) - before.at(4, 5, 1), kBlack + 0.7 * 50 * 1e-3 * kFull, 1e-6);
  EXPECT_NEAR(lit.at(4, 5, 0) - before.at(4, 5, 0), kBlack, 1e-6);
}

TEST(PhotoEffects, BlackLevelIsWrongInAllButTheBlackPhotograph) {
  const char* text = R"({"black-level": {"offset": 0.01}})";
  EXPECT_NEAR(taken(text, 0).at(3, 3) - taken("{}", 0).at(3, 3), 0.01 * kFull, 1e-6);
  EXPECT_EQ(taken(text, 1).at(3, 3), taken("{}", 1).at(3, 3));
}

TEST(PhotoEffects, CrosstalkKeepsTheSumOfTheChannels) {
  const Image before = taken("{}", 3), after = taken(R"({"channel-crosstalk": {"amount": 0.1}})", 3);
  EXPECT_NEAR(after.at(6, 6, 0), 0.8 * before.at(6, 6, 0) + 0.1 * (before.at(6, 6, 1) + before.at(6, 6, 2)),
              1e-6);
  EXPECT_NEAR(mean(after), mean(before), 1e-6);
}

TEST(PhotoEffects, StrayLightIsAVeilOfThePicturesMean) {
  const Image before = taken("{}", 3), after = taken(R"({"stray-light": {"share": 0.05}})", 3);
  const double veil = after.at(0, 0, 1) - before.at(0, 0, 1);
  EXPECT_NEAR(after.at(20, 9, 1) - before.at(20, 9, 1), veil, 1e-6);
  EXPECT_NEAR(mean(after) - mean(before), 0.05 * (mean(before) - kBlack), 1e-6);
}

TEST(PhotoEffects, VignettingTakesFromTheCornersOnly) {
  const Image before = picture(), after = taken(R"({"vignetting": {"corners": 0.3}})", 3);
  EXPECT_NEAR(after.at(10, 8) - kBlack, before.at(10, 8), 1e-6);
  EXPECT_NEAR(after.at(0, 0) - kBlack, 0.7 * before.at(0, 0), 1e-6);
}

/// Energy, centre and second moment of what became of a bright dot, over a picture large enough to hold it.
struct Spot {
  double energy = 0, meanX = 0, varianceX = 0, peak = 0;
};
Spot spotOf(const Image& image) {
  Spot spot;
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x) {
      spot.energy += image.at(x, y);
      spot.meanX += x * image.at(x, y);
      spot.peak = std::max<double>(spot.peak, image.at(x, y));
    }
  spot.meanX /= spot.energy;
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x)
      spot.varianceX += (x - spot.meanX) * (x - spot.meanX) * image.at(x, y) / spot.energy;
  return spot;
}

TEST(PhotoEffects, DefocusSpreadsADotToAGaussian) {
  Image dot(81, 81, 3);
  dot.at(40, 40, 0) = 1;
  for (const double sigma : {1.0, 3.5}) {
    const Spot spot = spotOf(blurred(dot, sigma));
    EXPECT_NEAR(spot.energy, 1, 1e-5) << sigma;
    EXPECT_NEAR(spot.meanX, 40, 1e-4) << sigma;
    EXPECT_NEAR(spot.varianceX, sigma * sigma + 1.0 / 12, 0.02 * sigma * sigma + 1e-3)
        << "with the pixel's own extent";
  }
  // A small one: what a Gaussian leaves within its own pixel.
  const double kept = std::erf(0.5 / (0.4 * std::sqrt(2.0)));
  EXPECT_NEAR(blurred(dot, 0.4).at(40, 40, 0), kept * kept, 1e-4);
  EXPECT_TRUE(std::ranges::equal(blurred(picture(), 0).samples(), picture().samples()));
}

TEST(PhotoEffects, GlareMovesItsShareAndNoMore) {
  Image dot(101, 101, 3);
  dot.at(50, 50, 0) = 1;
  const PhotoEffects effects(read(R"({"glare": {"share": 0.1, "radiusPx": 6}})"), kPhotos, 1, 0, kFull, {},
                             3);
  effects.beforeSensor(dot, 5);
  const Spot spot = spotOf(dot);
  EXPECT_NEAR(spot.energy, 1, 1e-5);
  EXPECT_NEAR(spot.peak, 0.9 + 0.1 / (2 * 3.14159 * 36), 1e-4);
  EXPECT_NEAR(spot.varianceX, 0.1 * 36, 0.05);
}

TEST(PhotoEffects, TheSensorsCurveKeepsBlackAndFullScale) {
  const auto through = [](const char* text, float value) {
    Image one(1, 1, 3, value);
    PhotoEffects(read(text), kPhotos, 1, kBlack, kFull, {}, 3).afterSensor(one);
    return one.at(0, 0);
  };
  EXPECT_EQ(through("{}", 0.731f), 0.731f);
  EXPECT_NEAR(through(R"({"camera-response": {"gamma": 0.9}})", 0.5f), kFull * std::pow(0.25, 0.9), 1e-6);
  EXPECT_NEAR(through(R"({"camera-response": {"compression": 0.5}})", 1.0f), kFull * 1.5 * 0.5 / 1.25, 1e-6);
  for (const char* text :
       {R"({"camera-response": {"gamma": 0.9}})", R"({"camera-response": {"compression": 0.5}})"}) {
    EXPECT_EQ(through(text, 0), 0);
    EXPECT_NEAR(through(text, kFull), kFull, 1e-6);
    EXPECT_LT(through(text, -1e-3f), 0) << "noise keeps its sign";
  }
}

// ---- where the sheet is ----

TEST(SheetForm, FlatWhereNothingBendsIt) {
  const SheetForm form({}, SimulatedSheet{});
  const Camera camera = SimulatedRig::desk(32, 120, 120).camera;
  EXPECT_TRUE(form.flat());
  EXPECT_EQ(form.seenAt(camera, {7, 9})->z(), 0);
  EXPECT_EQ(*form.seenAt(camera, {7, 9}), *camera.samplePlaneFromPixel({7, 9}));
}

TEST(SheetForm, ThePointSeenLiesOnTheSurfaceAndOnItsRay) {
  const Camera camera = SimulatedRig::desk(32, 120, 120).camera;
  for (const char* text :
       {R"({"sample-height": {"bendMm": 5, "bendAngleDeg": 30}})", R"({"sample-height": {"wavesMm": 1}})",
        R"({"sample-tilt": {"aboutXDeg": 4, "aboutYDeg": -3, "liftMm": 2}})"}) {
    const SheetForm form(read(text), SimulatedSheet{});
    EXPECT_FALSE(form.flat());
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(3, 4), Eigen::Vector2d(28, 15)}) {
      const auto point = form.seenAt(camera, pixel);
      ASSERT_TRUE(point);
      EXPECT_NEAR(point->z(), form.heightMm(point->x(), point->y()), 1e-6) << text;
      EXPECT_NEAR((*camera.pixelFromWorld(*point) - pixel).norm(), 0, 1e-6) << text;
      // The normal is across the surface: finite differences of the height.
      const double h = 1e-3;
      const Eigen::Vector3d along(h, 0, form.heightMm(point->x() + h, point->y()) - point->z());
      const Eigen::Vector3d normal = form.turned(Eigen::Vector3d::UnitZ(), point->x(), point->y());
      EXPECT_NEAR(normal.dot(along.normalized()), 0, 1e-4) << text;
      EXPECT_NEAR(normal.norm(), 1, 1e-12);
    }
  }
}

TEST(SheetForm, TiltTurnsTheNormalByItsAngle) {
  const SheetForm form(read(R"({"sample-tilt": {"aboutXDeg": 4}})"), SimulatedSheet{});
  const Eigen::Vector3d normal = form.turned(Eigen::Vector3d::UnitZ(), 10, 20);
  EXPECT_NEAR(std::atan2(-normal.y(), normal.z()) * 180 / 3.14159265, 4, 1e-5) << "right-handed about x";
  EXPECT_NEAR(normal.x(), 0, 1e-12);
}

// ---- whole captures ----

SimulatedSheet halves() {
  SimulatedSheet sheet;
  sheet.materials = {{Eigen::Array3d(0.8, 0.5, 0.2), Eigen::Array3d::Zero(), 0.1, 1.2},
                     {Eigen::Array3d(0.05, 0.05, 0.05), Eigen::Array3d::Zero(), 0.1, 1.2}};
  sheet.pattern = SheetPattern::Checker;
  sheet.periodMm = 200;
  sheet.slopeRms = sheet.albedoVariation = sheet.sigmaVariation = 0;
  return sheet;
}

SimulatedCaptureOptions quick() {
  SimulatedCaptureOptions options;
  options.fitted = {{1, 0}, {0, 4}};
  options.heldOut.clear();
  options.samplesPerPixelSide = 1;
  return options;
}

TEST(Subsurface, ChangesNothingWhereAlbedoAndLightAreEvenAndBleedsOverBorders) {
  const SimulatedRig rig = SimulatedRig::desk(24, 120, 120);
  SimulatedSheet even = halves();
  even.pattern = SheetPattern::Uniform;
  SimulatedCaptureOptions options = quick();
  const auto relative = [&](const SimulatedSheet& sheet, double radiusMm, int x, int y) {
    options.effects.subsurface.radiusMm = 0;
    const auto without = exposeSheet(rig, sheet, options, {});
    options.effects.subsurface.radiusMm = radiusMm;
    const auto with = exposeSheet(rig, sheet, options, {});
    EXPECT_TRUE(without.ok() && with.ok());
    return static_cast<double>(with->pixel(0, x, y)[0]) / without->pixel(0, x, y)[0];
  };
  EXPECT_NEAR(relative(even, 6, 12, 12), 1, 0.01) << "the window's light is smooth over millimetres";
  const SheetSampler sampler(halves());
  double nearBorder = 0;  // a dark pixel with a bright neighbour
  for (int y = 4; y < 20; ++y)
    for (int x = 4; x < 19; ++x) {
      const auto a = rig.camera.samplePlaneFromPixel({x, y}), b = rig.camera.samplePlaneFromPixel({x + 1, y});
      if (sampler.materialAt(a->x(), a->y()) == 1 && sampler.materialAt(b->x(), b->y()) == 0 &&
          nearBorder == 0)
        nearBorder = relative(halves(), 6, x, y);
    }
  EXPECT_GT(nearBorder, 1.2) << "light from the bright side comes out on the dark one";
}

TEST(SimulateCapture, EveryEffectChangesThePhotographsAndIsWrittenToTheTruthOnly) {
  const Folder folder;
  const SimulatedRig rig = SimulatedRig::desk(12, 120, 120);
  SimulatedSheet sheet = simulatedScene("cardstock");
  SimulatedCaptureOptions options = quick();
  options.writeTruth = true;
  JobContext job;
  job.seed = 4;
  ASSERT_TRUE(simulateCapture(folder / "none", rig, sheet, options, job).ok());
  const auto photo = [&](const std::string& bundle, const char* name) {
    return readExr(folder / bundle / name, {"R", "G", "B"}).value();
  };
  std::string last;
  for (const SimulatedEffectField& field : simulatedEffectFields()) {
    if (!field.strength) continue;
    options.effects = {};
    double& value = field.of(options.effects);
    // A tenth of the way to the larger end; saturation cuts from full scale downwards.
    const double end = std::abs(field.most - field.none) > 0 ? field.most : field.least;
    value = field.none + 0.1 * (end - field.none);
    if (field.id == "saturation") value = 0.5;
    const std::string name = std::string(field.id) + "." + std::string(field.name);
    const auto report = simulateCapture(folder / "with", rig, sheet, options, job);
    ASSERT_TRUE(report.ok()) << name << ": " << report.error().sentence();
    bool differs = false;
    for (const char* file : {"photo_000.exr", "photo_004.exr", "photo_009.exr"})
      differs = differs || !std::ranges::equal(photo("none", file).samples(), photo("with", file).samples());
    EXPECT_TRUE(differs) << name;
    const auto none = readFourierCapture(folder / "none"), with = readFourierCapture(folder / "with");
    ASSERT_TRUE(none.ok() && with.ok());
    EXPECT_EQ(with->screen.worldFromScreen, none->screen.worldFromScreen) << name;
    EXPECT_EQ(with->screen.originMm, none->screen.originMm) << name;
    EXPECT_EQ(with->screen.emission->sigma, none->screen.emission->sigma) << name;
    std::ifstream file(folder / "with/truth/truth.json");
    const nlohmann::json truth = nlohmann::json::parse(file);
    ASSERT_TRUE(truth["effects"].contains(std::string(field.id))) << name;
    EXPECT_EQ(truth["effects"].size(), 1u) << name;
    EXPECT_EQ(truth["effects"][std::string(field.id)][std::string(field.name)], value) << name;
  }
}

TEST(SimulateCapture, ClipsEarlierThanItsFullScale) {
  const Folder folder;
  const SimulatedRig rig = SimulatedRig::desk(8, 120, 120);
  const SimulatedSheet sheet = simulatedScene("laminate");
  SimulatedCaptureOptions options = quick();
  options.effects.saturation.level = 0.5;
  const auto report = simulateCapture(folder / "capture", rig, sheet, options, {});
  ASSERT_TRUE(report.ok());
  EXPECT_GT(report->clippedSamples, 0u);
  const auto capture = readFourierCapture(folder / "capture");
  double most = 0;
  const Image window = readPhoto(*capture, capture->photos[0]).value();
  for (const float sample : window.samples()) most = std::max<double>(most, sample);
  EXPECT_NEAR(most, 0.5 * report->fullScale, 1e-3 * report->fullScale);
  EXPECT_EQ(capture->saturation, 0) << "nothing is declared";
}

}  // namespace
}  // namespace patina
