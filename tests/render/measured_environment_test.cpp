#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <numbers>

#include "engine/image/exr.h"
#include "engine/render/environment.h"
#include "tests/base/temp_folder.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;

double luminance(const Eigen::Array3f& value) {
  return 0.2126 * value[0] + 0.7152 * value[1] + 0.0722 * value[2];
}

Eigen::Vector3f ofAngles(double fromUp, double turn) {
  return Eigen::Vector3d(std::sin(fromUp) * std::sin(turn), std::cos(fromUp),
                         -std::sin(fromUp) * std::cos(turn))
      .cast<float>();
}

TEST(Environment, EveryOneThatShipsHasItsNameAndOneUnit) {
  ASSERT_GE(builtInEnvironments().size(), 5u);
  for (const EnvironmentEntry& entry : builtInEnvironments()) {
    const EnvironmentPtr environment = builtInEnvironment(entry.id);
    ASSERT_NE(environment, nullptr) << entry.id;
    EXPECT_EQ(environment->name(), entry.name);
    EXPECT_FALSE(entry.note.empty());
    EXPECT_EQ(environment, builtInEnvironment(entry.id)) << "made twice";
    // Irradiance on a plane that faces up, by the midpoint rule over the picture's own texels.
    double up = 0;
    constexpr int kRings = 256, kTurns = 1024;
    for (int i = 0; i < kRings; ++i)
      for (int j = 0; j < kTurns; ++j) {
        const double fromUp = (i + 0.5) / kRings * kPi / 2;
        up += luminance(environment->radiance(ofAngles(fromUp, (j + 0.5) / kTurns * 2 * kPi))) *
              std::cos(fromUp) * std::sin(fromUp) * (kPi / 2 / kRings) * (2 * kPi / kTurns);
      }
    EXPECT_NEAR(up, kPi, 0.01 * kPi) << entry.id;
    for (const float value : environment->picture().samples())
      ASSERT_TRUE(std::isfinite(value) && value >= 0);
  }
  EXPECT_EQ(builtInEnvironment("no such place"), nullptr);
}

TEST(Environment, ItsDensityIsWhatItSamplesWith) {
  for (const char* id : {"studio", "clear", "white"}) {
    const EnvironmentPtr environment = builtInEnvironment(id);
    double all = 0, light = 0;
    for (const Environment::Sample& sample : environment->samples()) {
      EXPECT_NEAR(sample.direction.norm(), 1, 1e-5);
      EXPECT_GT(sample.density, 0);
      all += 1 / sample.density;
      light += luminance(sample.radiance) / sample.density;
    }
    all /= Environment::kSamples;
    light /= Environment::kSamples;
    EXPECT_NEAR(all, 4 * kPi, 0.1 * 4 * kPi) << id << ": few samples go to where it is dark";
    double expected = 0;
    const Image& picture = environment->picture();
    double total = 0;
    for (int y = 0; y < picture.height(); ++y) {
      const double ring = std::cos(y * kPi / picture.height()) - std::cos((y + 1) * kPi / picture.height());
      for (int x = 0; x < picture.width(); ++x) {
        const auto pixel = picture.pixel(x, y);
        expected += luminance({pixel[0], pixel[1], pixel[2]}) * ring * 2 * kPi / picture.width();
        // And the density is one over the sphere.
        total += environment
                     ->look(ofAngles((y + 0.5) / picture.height() * kPi,
                                     ((x + 0.5) / picture.width() - 0.5) * 2 * kPi))
                     .density *
                 ring * 2 * kPi / picture.width();
      }
    }
    EXPECT_NEAR(light, expected, 0.01 * expected) << id;
    EXPECT_NEAR(total, 1, 0.002) << id;
  }
}

TEST(Environment, KeepsLeftAndUpWhereTheyAre) {
  Image picture(64, 32, 3, 0.01f);
  picture.at(16, 15, 0) =
      50;  // a quarter of a turn to the left of what lies behind, a little above the horizon
  const Environment environment("test", "test", picture);
  const auto left = environment.radiance(Eigen::Vector3f(-1, 0.03f, 0.02f).normalized());
  EXPECT_GT(left[0], 100 * left[1]);
  const auto right = environment.radiance(Eigen::Vector3f(1, 0.03f, 0));
  EXPECT_NEAR(right[0], right[1], 1e-6);
}

TEST(Environment, ALargePictureIsAveragedWithoutLosingLight) {
  Image large(3000, 1500, 3, 0.0f);
  for (int y = 300; y < 340; ++y)
    for (int x = 1000; x < 1040; ++x) large.at(x, y, 1) = 200;
  const Environment environment("test", "test", large);
  EXPECT_EQ(environment.picture().width(), Environment::kWidth);
  double up = 0;
  for (int y = 0; y < environment.picture().height() / 2; ++y)
    for (int x = 0; x < environment.picture().width(); ++x) {
      const double fromUp = (y + 0.5) / environment.picture().height() * kPi;
      up += 0.7152 * environment.picture().at(x, y, 1) * std::sin(fromUp) * std::cos(fromUp) *
            (2 * kPi / Environment::kWidth) * (kPi / Environment::kHeight);
    }
  EXPECT_NEAR(up, kPi, 0.01);
  EXPECT_GT(environment.scale(), 0);
}

TEST(Environment, WithoutLightFromAboveTheMeanIsOne) {
  Image picture(64, 32, 3, 0.0f);
  for (int y = 20; y < 32; ++y)
    for (int x = 0; x < 64; ++x)
      for (int c = 0; c < 3; ++c) picture.at(x, y, c) = 3;
  const Environment environment("test", "test", picture);
  EXPECT_TRUE(std::isfinite(environment.scale()));
  EXPECT_LT(environment.radiance({0, -1, 0})[0], 10);
}

TEST(LoadEnvironment, ReadsAPersonsPicture) {
  const test::TempFolder folder;
  Image picture(64, 32, 3, 0.5f);
  picture.at(3, 3, 2) = -0.01f;  // as resampling leaves it
  const auto file = folder.path() / "my room.exr";
  ASSERT_TRUE(writeExr(file, picture, {"R", "G", "B"}).ok());
  const auto read = loadEnvironment(file);
  ASSERT_TRUE(read.ok()) << read.error().sentence();
  EXPECT_EQ((*read)->name(), "my room");
  EXPECT_EQ((*read)->id(), "file");
  EXPECT_NEAR((*read)->radiance({0, 0, 1})[0], 1, 0.02);
}

TEST(LoadEnvironment, SaysWhatIsWrong) {
  const test::TempFolder folder;
  const auto written = [&](const Image& picture) {
    const auto file = folder.path() / "bad.exr";
    EXPECT_TRUE(writeExr(file, picture, {"R", "G", "B"}).ok());
    return loadEnvironment(file);
  };
  const auto absent = loadEnvironment(folder.path() / "none.exr");
  ASSERT_FALSE(absent.ok());
  EXPECT_EQ(absent.error().code, ErrorCode::NotFound);
  const auto square = written(Image(32, 32, 3, 1.0f));
  ASSERT_FALSE(square.ok());
  EXPECT_NE(square.error().sentence().find("32 x 32"), std::string::npos);
  EXPECT_FALSE(written(Image(64, 32, 3, 0.0f)).ok());
  Image broken(64, 32, 3, 1.0f);
  broken.at(4, 5, 1) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(written(broken).ok());
  EXPECT_THROW(Environment("test", "test", broken), std::invalid_argument);
}

}  // namespace
}  // namespace patina
