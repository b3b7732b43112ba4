#include "engine/render/measured_sphere.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <numeric>
#include <thread>

#include "engine/image/png.h"
#include "engine/render/blue_noise.h"
#include "engine/render/quick_atan.h"
#include "engine/render/tone_map.h"
#include "tests/render/measured_material.h"

namespace patina {
namespace {

using test::glossy;
using test::lambert;

constexpr double kPi = std::numbers::pi;

MeasuredSphere rendered(const SphereMaterial& material, const MeasuredSphereLighting& lighting, int size,
                        int samples, std::uint64_t seed = 0, int threads = 0) {
  MeasuredSphereOptions options;
  options.size = size;
  options.samples = samples;
  JobContext job;
  job.seed = seed;
  job.threads = threads;
  auto picture = measuredSphere(material, lighting, options, job);
  EXPECT_TRUE(picture.ok()) << (picture.ok() ? "" : picture.error().sentence());
  return *picture;
}

MeasuredSphereLighting in(const char* environment) {
  MeasuredSphereLighting lighting;
  lighting.environment = builtInEnvironment(environment);
  return lighting;
}

/// The sphere's normal at a pixel's centre, and how far from the middle it is, in radii.
Eigen::Vector3d normalAt(int size, double px, double py, double* radius = nullptr) {
  const double x = (px + 0.5 - 0.5 * size) / (kMeasuredSphereRadius * size),
               y = (0.5 * size - py - 0.5) / (kMeasuredSphereRadius * size);
  if (radius) *radius = std::hypot(x, y);
  return {x, y, std::sqrt(std::max(0.0, 1 - x * x - y * y))};
}

/// The radiance that a pixel's centre should have, by adding up every texel of the environment, with the
/// table's own interpolation: nothing in common with the code under test but the table and the picture.
Eigen::Array3d addedUp(const TabulatedBrdf& brdf, const Environment& environment,
                       const Eigen::Vector3d& normal) {
  const Image& picture = environment.picture();
  const Eigen::Vector3d tangent = normal.unitOrthogonal(), bitangent = normal.cross(tangent);
  const auto local = [&](const Eigen::Vector3d& d) {
    return Eigen::Vector3d(d.dot(tangent), d.dot(bitangent), d.dot(normal));
  };
  Eigen::Array3d sum = Eigen::Array3d::Zero();
  for (int y = 0; y < picture.height(); ++y) {
    const double fromUp = (y + 0.5) / picture.height() * kPi;
    const double solidAngle =
        2 * kPi / picture.width() *
        (std::cos(y * kPi / picture.height()) - std::cos((y + 1) * kPi / picture.height()));
    for (int x = 0; x < picture.width(); ++x) {
      const double turn = ((x + 0.5) / picture.width() - 0.5) * 2 * kPi;
      const Eigen::Vector3d toLight =
          local({std::sin(fromUp) * std::sin(turn), std::cos(fromUp), -std::sin(fromUp) * std::cos(turn)});
      if (toLight.z() <= 0) continue;
      const Eigen::Array3d value = brdf.evaluate(toLight, local(Eigen::Vector3d::UnitZ()));
      if (!value.allFinite()) continue;
      for (int c = 0; c < 3; ++c) sum[c] += value[c] * picture.at(x, y, c) * toLight.z() * solidAngle;
    }
  }
  return sum;
}

TEST(MeasuredSphere, LambertInEvenWhiteIsItsAlbedo) {
  const auto sphere = rendered(SphereMaterial(*lambert(0.8, 0.4, 0.1)), in("white"), 48, 1024);
  std::array<double, 3> mean{};
  int pixels = 0;
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 48; ++x) {
      double radius = 0;
      normalAt(48, x, y, &radius);
      if (radius > 0.97) continue;
      ++pixels;
      for (int c = 0; c < 3; ++c) {
        const double albedo = std::array{0.8, 0.4, 0.1}[static_cast<std::size_t>(c)];
        // 1024 evenly spread samples leave about half a per cent.
        EXPECT_NEAR(sphere.radiance.at(x, y, c), albedo, 0.02 * albedo) << x << ' ' << y;
        mean[static_cast<std::size_t>(c)] += sphere.radiance.at(x, y, c) / albedo;
      }
    }
  ASSERT_GT(pixels, 1000);
  for (const double sum : mean) EXPECT_NEAR(sum / pixels, 1, 0.002);
}

/// An environment of a quarter of the resolution, so that adding up takes its time only.
EnvironmentPtr coarser(const char* id) {
  const Image& fine = builtInEnvironment(id)->picture();
  Image coarse(fine.width() / 4, fine.height() / 4, 3);
  for (int y = 0; y < fine.height(); ++y)
    for (int x = 0; x < fine.width(); ++x)
      for (int c = 0; c < 3; ++c) coarse.at(x / 4, y / 4, c) += fine.at(x, y, c) / 16;
  return std::make_shared<Environment>("coarse", "coarse", coarse);
}

TEST(MeasuredSphere, AgreesWithAddingUpEveryTexel) {
  constexpr int kSize = 64;
  // A pixel's mean against the mean of four places in it; the sharper the lobe, the more they may differ.
  constexpr double kTolerance = 0.025;
  for (const char* id : {"window", "studio"}) {
    MeasuredSphereLighting lighting;
    lighting.environment = coarser(id);
    for (const double exponent : {3.0, 100.0}) {
      const auto brdf = glossy({0.25, 0.12, 0.05}, 0.4, exponent);
      const auto sphere = rendered(SphereMaterial(*brdf), lighting, kSize, 1024);
      for (const auto& [px, py] :
           {std::pair(32, 31), std::pair(20, 27), std::pair(40, 46), std::pair(50, 20)}) {
        Eigen::Array3d expected = Eigen::Array3d::Zero();
        for (const double dx : {-0.25, 0.25})
          for (const double dy : {-0.25, 0.25})
            expected += addedUp(*brdf, *lighting.environment, normalAt(kSize, px + dx, py + dy)) / 4;
        for (int c = 0; c < 3; ++c)
          EXPECT_NEAR(sphere.radiance.at(px, py, c), expected[c], kTolerance * expected[c])
              << id << ' ' << exponent << " at " << px << ' ' << py;
      }
    }
  }
}

TEST(MeasuredSphere, SendsBackLessThanArrives) {
  for (const double exponent : {5.0, 100.0, 5000.0}) {
    const auto sphere =
        rendered(SphereMaterial(*glossy({0.5, 0.3, 0}, 0.45, exponent)), in("white"), 64, 256);
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x) {
        double radius = 0;
        normalAt(64, x, y, &radius);
        if (radius < 0.8) {
          EXPECT_LT(sphere.radiance.at(x, y, 0), 1.03) << exponent;
        }
      }
    // The narrow lobe is normalised in the middle: base and lobe add up there.
    if (exponent > 1000) {
      EXPECT_NEAR(sphere.radiance.at(32, 32, 1), 0.3 + 0.45, 0.02);
    }
  }
}

TEST(MeasuredSphere, MirrorsAndMattMaterialsAreEquallySmooth) {
  // What two independent pictures differ by, against what they show. 64 samples.
  for (const auto& brdf :
       {lambert(0.5, 0.5, 0.5), glossy({0.1, 0.1, 0.1}, 0.6, 60), glossy({0, 0, 0}, 0.8, 50000)}) {
    const SphereMaterial material(*brdf);
    for (const char* id : {"studio", "clear", "strips"}) {
      const auto one = rendered(material, in(id), 64, 64, 1), two = rendered(material, in(id), 64, 64, 2);
      double difference = 0, light = 0;
      for (int y = 8; y < 56; ++y)
        for (int x = 8; x < 56; ++x) {
          double radius = 0;
          normalAt(64, x, y, &radius);
          if (radius > 0.9) continue;
          // As seen: a highlight's grain is hidden where the display is white.
          const double a = std::min(2.0f, one.radiance.at(x, y, 1)),
                       b = std::min(2.0f, two.radiance.at(x, y, 1));
          difference += (a - b) * (a - b);
          light += (a + b) * (a + b) / 4;
        }
      EXPECT_LT(std::sqrt(difference / light), 0.12) << id;
    }
  }
}

TEST(MeasuredSphere, ADistantLightIsExact) {
  MeasuredSphereLighting lighting;
  lighting.toLight = {-1, 1, 1.5};
  lighting.lightIrradiance = Eigen::Array3f(1, 0.5f, 0.25f) * static_cast<float>(kPi);
  const auto sphere = rendered(SphereMaterial(*lambert(0.6, 0.6, 0.6)), lighting, 101, 4);
  const Eigen::Vector3d toLight = Eigen::Vector3d(-1, 1, 1.5).normalized();
  for (int y = 10; y < 91; y += 4)
    for (int x = 10; x < 91; x += 4) {
      double radius = 0;
      const double cosine = normalAt(101, x, y, &radius).dot(toLight);
      if (radius > 0.9 || std::abs(cosine) < 0.03) continue;
      constexpr std::array kTint{1.0, 0.5, 0.25};
      for (std::size_t c = 0; c < 3; ++c)
        EXPECT_NEAR(sphere.radiance.at(x, y, static_cast<int>(c)), 0.6 * std::max(0.0, cosine) * kTint[c],
                    2e-3);
    }
}

TEST(MeasuredSphere, IsTheSameForAnyNumberOfThreadsAndAnotherForAnotherSeed) {
  const SphereMaterial material(*glossy({0.2, 0.2, 0.2}, 0.3, 200));
  const auto one = rendered(material, in("window"), 64, 16, 5, 1),
             many = rendered(material, in("window"), 64, 16, 5, 4);
  EXPECT_TRUE(std::ranges::equal(one.radiance.samples(), many.radiance.samples()));
  const auto other = rendered(material, in("window"), 64, 16, 6);
  EXPECT_FALSE(std::ranges::equal(one.radiance.samples(), other.radiance.samples()));
}

TEST(MeasuredSphere, TurnsWithItsEnvironment) {
  // Turned by half a turn about the vertical, what was behind is in front.
  MeasuredSphereLighting lighting = in("window");
  const SphereMaterial material(*lambert(0.7, 0.7, 0.7));
  lighting.environmentFromView =
      Eigen::AngleAxisf(static_cast<float>(kPi), Eigen::Vector3f::UnitY()).toRotationMatrix();
  const auto turned = rendered(material, lighting, 32, 2048);
  const auto straight = rendered(material, in("window"), 32, 2048);
  // The window stands at the left: it lights the left of the sphere, and the right of the turned one.
  EXPECT_GT(straight.radiance.at(6, 16, 0), 1.5 * straight.radiance.at(25, 16, 0));
  EXPECT_GT(turned.radiance.at(25, 16, 0), 1.5 * turned.radiance.at(6, 16, 0));
}

TEST(MeasuredSphere, PartsAddUpToTheWhole) {
  const SphereMaterial material(*glossy({0.2, 0.1, 0.1}, 0.3, 50), nullptr);
  MeasuredSphereOptions options;
  options.size = 48;
  options.samples = 64;
  const auto lighting = in("studio");
  MeasuredSphere sum = *measuredSphere(material, lighting, options);
  const MeasuredSphere first = sum;
  for (int part = 1; part < 16; ++part) {
    options.firstSample = 64 * part;
    accumulate(sum, *measuredSphere(material, lighting, options), part);
  }
  const auto whole = rendered(material, lighting, 48, 4096);
  double before = 0, after = 0;
  for (std::size_t i = 0; i < sum.radiance.samples().size(); ++i) {
    const double exact = whole.radiance.samples()[i];
    before += std::pow(first.radiance.samples()[i] - exact, 2);
    after += std::pow(sum.radiance.samples()[i] - exact, 2);
  }
  EXPECT_LT(after, before / 16) << "sixteen parts are no better than independent ones would be";
}

TEST(MeasuredSphere, TheRimIsSmooth) {
  const auto sphere = rendered(SphereMaterial(*lambert(0.5, 0.5, 0.5)), in("white"), 128, 4);
  double area = 0;
  int between = 0;
  for (const float covered : sphere.coverage.samples()) {
    area += covered;
    between += covered > 0.02f && covered < 0.98f;
  }
  const double radius = kMeasuredSphereRadius * 128;
  EXPECT_NEAR(area, kPi * radius * radius, 0.002 * area);
  EXPECT_GT(between, 200);
  const Image over = sphere.over(0.25f);
  EXPECT_EQ(over.at(0, 0), 0.25f);
}

TEST(MeasuredSphere, CertaintyIsThatOfTheDirectionsThatLightIt) {
  // Known within 30 degrees of thetaH, unknown (the prior holds) beyond.
  std::vector<float> sd(MerlGrid::kCells);
  for (std::size_t cell = 0; cell < sd.size(); ++cell)
    sd[cell] = MerlGrid::centre(cell).thetaHRad < 30 * kPi / 180 ? 0.1f : -1.0f;
  const SphereMaterial material(*lambert(0.5, 0.5, 0.5), &sd, 0.9);
  MeasuredSphereLighting lighting;
  lighting.toLight = {0, 0, 1};
  lighting.lightIrradiance.setConstant(1);
  const auto sphere = rendered(material, lighting, 101, 4);
  // Light and eye coincide: thetaH is the normal's angle.
  EXPECT_NEAR(sphere.certainty.at(50, 50), 0.1, 1e-4);
  const int at20 = 50 + static_cast<int>(std::lround(101 * kMeasuredSphereRadius * std::sin(20 * kPi / 180)));
  const int at45 = 50 + static_cast<int>(std::lround(101 * kMeasuredSphereRadius * std::sin(45 * kPi / 180)));
  EXPECT_NEAR(sphere.certainty.at(at20, 50), 0.1, 1e-4);
  EXPECT_NEAR(sphere.certainty.at(at45, 50), 0.9, 1e-4);

  lighting.toLight = {1, 0, 0};
  const auto halfLit = rendered(material, lighting, 101, 4);
  EXPECT_EQ(halfLit.certainty.at(20, 50), -1) << "no light, no certainty";
  EXPECT_GT(halfLit.certainty.at(80, 50), 0);

  // In a room the two meet: between them.
  const auto room = rendered(material, in("studio"), 64, 256);
  EXPECT_GT(room.certainty.at(32, 32), 0.11);
  EXPECT_LT(room.certainty.at(32, 32), 0.89);
  EXPECT_TRUE(rendered(SphereMaterial(*lambert(1, 1, 1)), lighting, 8, 4).certainty.empty());
}

TEST(MeasuredSphere, CellsBeyondTheHorizonLeaveNoHoles) {
  const auto sphere = rendered(SphereMaterial(*lambert(0.5, 0.5, 0.5)), in("white"), 96, 64);
  for (int y = 0; y < 96; ++y)
    for (int x = 0; x < 96; ++x)
      if (sphere.coverage.at(x, y) > 0.5f) {
        EXPECT_GT(sphere.radiance.at(x, y, 0), 0.35f) << x << ' ' << y;
      }
}

TEST(MeasuredSphere, StopsWhenAsked) {
  const SphereMaterial material(*lambert(0.5, 0.5, 0.5));
  std::stop_source source;
  JobContext job;
  job.stop = source.get_token();
  MeasuredSphereOptions options;
  options.size = 1024;
  options.samples = 4096;
  std::chrono::steady_clock::time_point asked;
  std::jthread friendOfTheUser([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    asked = std::chrono::steady_clock::now();
    source.request_stop();
  });
  const auto outcome = measuredSphere(material, in("studio"), options, job);
  const auto late = std::chrono::steady_clock::now() - asked;
  ASSERT_FALSE(outcome.ok());
  EXPECT_EQ(outcome.error().code, ErrorCode::Cancelled);
  EXPECT_LT(late, std::chrono::milliseconds(600)) << "not even on a busy machine";
}

TEST(MeasuredSphere, RefusesWhatMakesNoPicture) {
  const SphereMaterial material(*lambert(0.5, 0.5, 0.5));
  MeasuredSphereOptions options;
  options.size = 0;
  EXPECT_FALSE(measuredSphere(material, {}, options).ok());
  options.size = 8;
  options.samples = 1;
  EXPECT_FALSE(measuredSphere(material, {}, options).ok());
  const std::vector<float> wrong(5);
  EXPECT_THROW(SphereMaterial(*lambert(1, 1, 1), &wrong, 1), std::invalid_argument);
}

TEST(ExposureForWhite, ShowsAWhiteMattSphereJustWhite) {
  const SphereMaterial white(*lambert(1, 1, 1));
  for (const char* id : {"studio", "overcast", "clear", "window"}) {
    MeasuredSphereLighting lighting = in(id);
    lighting.lightIrradiance.setConstant(0.7f);
    const auto sphere = rendered(white, lighting, 64, 512);
    float brightest = 0;
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x) {
        double radius = 0;
        normalAt(64, x, y, &radius);
        if (radius < 0.9) brightest = std::max(brightest, sphere.radiance.at(x, y, 1));
      }
    EXPECT_NEAR(brightest * exposureForWhite(lighting), 1, 0.12) << id;  // nine harmonics, and grain
  }
  EXPECT_EQ(exposureForWhite({}), 1);
}

TEST(SpherePicture, NamesTheNearestEnvironment) {
  SpherePictureOptions options;
  options.environment = "studoi";
  const auto outcome = spherePicture(*lambert(0.5, 0.5, 0.5), options);
  ASSERT_FALSE(outcome.ok());
  EXPECT_NE(outcome.error().sentence().find("studio"), std::string::npos);
}

TEST(SpherePicture, LooksAsItDidWhenItWasLookedAt) {
  SpherePictureOptions options;
  options.size = 128;
  options.samples = 512;
  const auto got = spherePicture(*glossy({0.42, 0.09, 0.04}, 0.12, 400), options);
  ASSERT_TRUE(got.ok());
  const std::filesystem::path stored =
      std::filesystem::path(PATINA_SOURCE_DIR) / "tests/render/golden/measured_sphere.png";
  const auto expected = readPng(stored);
  const auto keep = [&](const char* name, const Image& picture) {
    const auto file = std::filesystem::temp_directory_path() / name;
    EXPECT_TRUE(writePng(file, picture).ok());
    return file.string();
  };
  if (!expected) FAIL() << expected.error().sentence() << "; got " << keep("measured_sphere_got.png", *got);
  ASSERT_EQ(expected->width(), got->width());
  Image difference(128, 128, 3);
  double sum = 0;
  for (std::size_t i = 0; i < got->samples().size(); ++i) {
    const float off = got->samples()[i] - expected->samples()[i];
    difference.samples()[i] = std::min(1.0f, 10 * std::abs(off));
    sum += off * off;
  }
  // Eight bits round by 0.001, the samples' grain is below 0.004.
  if (const double rms = std::sqrt(sum / static_cast<double>(got->samples().size())); rms > 0.008)
    FAIL() << "differs by " << rms << ": " << keep("measured_sphere_got.png", *got) << ", "
           << keep("measured_sphere_difference.png", difference);
}

TEST(SphereSheet, HoldsThreeRoomsALightAndTheCertainty) {
  SpherePictureOptions options;
  options.size = 64;
  options.samples = 16;
  const auto brdf = lambert(0.5, 0.5, 0.5);
  const auto plain = sphereSheet(*brdf, nullptr, 0, options);
  const std::vector<float> sd(MerlGrid::kCells, 0.2f);
  const auto withCertainty = sphereSheet(*brdf, &sd, 0.8, options);
  ASSERT_TRUE(plain.ok() && withCertainty.ok());
  EXPECT_GT(plain->width(), 4 * 64);
  EXPECT_GT(withCertainty->width(), plain->width() + 60);
}

TEST(CertaintyColour, RunsFromBlueToOrange) {
  const auto known = certaintyColour(0), unknown = certaintyColour(1);
  EXPECT_GT(known[2], known[0] + 0.4f);
  EXPECT_GT(unknown[0], unknown[2] + 0.4f);
  EXPECT_EQ(certaintyColour(7), unknown);
  EXPECT_EQ(certaintyColour(std::nanf("")), unknown);
}

TEST(QuickAtan2, IsCloseEverywhere) {
  EXPECT_EQ(quickAtan2(0, 0), 0);
  for (int i = 0; i < 3600; ++i) {
    const double angle = (i - 1799.5) * kPi / 1800;
    EXPECT_NEAR(quickAtan2(static_cast<float>(std::sin(angle)), static_cast<float>(std::cos(angle))), angle,
                1e-6);
  }
  for (const float tiny : {1e-3f, 1e-6f, 1e-12f}) EXPECT_NEAR(quickAtan2(tiny, 1) / tiny, 1, 1e-6);
}

TEST(BlueNoise, IsEvenAndItsNeighboursDiffer) {
  double sum = 0, alike = 0, variance = 0;
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x) {
      const double value = blueNoise(x, y, 0) - 0.5;
      sum += value;
      variance += value * value;
      alike += value * (blueNoise(x + 1, y, 0) - 0.5);
    }
  EXPECT_NEAR(sum, 0, 1e-2);
  EXPECT_NEAR(variance / 4096, 1.0 / 12, 1e-3);
  EXPECT_LT(alike / variance, -0.05);  // 0 for white noise
  EXPECT_NE(blueNoise(0, 0, 0), blueNoise(0, 0, 1));
}

}  // namespace
}  // namespace patina
