#include "engine/brdf/alta_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <numbers>

#include "engine/brdf/brdf_file.h"
#include "tests/test_data.h"

namespace patina {
namespace {

using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;

Eigen::Vector3d direction(double thetaRad, double phiRad) {
  return {std::sin(thetaRad) * std::cos(phiRad), std::sin(thetaRad) * std::sin(phiRad), std::cos(thetaRad)};
}

std::string header(const std::string& in, const std::string& out, const std::string& dim) {
  return "#SAMPLE \"By hand\"\n#DIM " + dim + "\n#PARAM_IN " + in + "\n#PARAM_OUT " + out + "\n";
}
const std::string kLights = header("ISOTROPIC_TL_TV_PROJ_DPHI", "INV_STERADIAN", "3 1");

/// A table over lattices of `step` degrees for lights at the given angles, within 80 degrees of the normal.
std::string lightsTable(const std::vector<double>& lightsDeg, const std::string& head, double stepDeg,
                        const std::function<double(double thetaL, const Eigen::Vector3d& view)>& value) {
  std::string text = head;
  char line[128];
  for (const double light : lightsDeg) {
    for (double x = -80; x <= 80; x += stepDeg) {
      for (double y = -80; y <= 80; y += stepDeg) {
        const double theta = std::hypot(x, y);
        if (theta > 80) continue;
        std::snprintf(line, sizeof line, "%.9f %.9f %.9f %.9g\n", light * kDegree, x * kDegree, y * kDegree,
                      value(light * kDegree, direction(theta * kDegree, std::atan2(y, x))));
        text += line;
      }
    }
  }
  return text;
}

BrdfPtr read(const std::string& text) {
  Result<BrdfPtr> brdf = readAltaBytes(text, "folder/tape.dat");
  EXPECT_TRUE(brdf) << (brdf ? "" : brdf.error().sentence());
  return brdf ? *brdf : nullptr;
}

/// A narrow lobe around the light, 5 degrees wide, and another around the mirror's direction.
double twoPeaks(double thetaL, const Eigen::Vector3d& view) {
  const auto lobe = [&](const Eigen::Vector3d& to) {
    const double angle = std::acos(std::min(view.dot(to), 1.0));
    return std::exp(-angle * angle / (2 * 25 * kDegree * kDegree));
  };
  return 0.1 + 8 * lobe(direction(thetaL, 0)) + 3 * lobe(direction(thetaL, kPi));
}

TEST(AltaFile, GivesThePointsOfTheTable) {
  const BrdfPtr brdf = read(lightsTable({20, 50}, kLights, 4, [](double thetaL, const Eigen::Vector3d& view) {
    return 1 + thetaL + view.x() + 0.5 * view.y();
  }));
  ASSERT_TRUE(brdf);
  EXPECT_EQ(brdf->origin().name, "By hand");
  EXPECT_EQ(brdf->origin().format, "alta");
  EXPECT_THAT(brdf->origin().note, HasSubstr("one channel"));
  // The light's azimuth is anything; +x of the table is its side.
  for (const double azimuth : {0.0, 1.3, -2.9}) {
    const Eigen::Vector3d view = direction(std::hypot(12, 8) * kDegree, azimuth + std::atan2(8, 12));
    const Eigen::Vector3d inTable = direction(std::hypot(12, 8) * kDegree, std::atan2(8, 12));
    const Eigen::Array3d value = brdf->evaluate(direction(20 * kDegree, azimuth), view);
    EXPECT_NEAR(value[0], 1 + 20 * kDegree + inTable.x() + 0.5 * inTable.y(), 1e-6) << azimuth;
    EXPECT_EQ(value[0], value[2]) << "grey";
  }
}

TEST(AltaFile, PeaksStayAtTheirPlaceBetweenMeasuredLights) {
  // Blending two lights as they are would show each peak twice at half its height.
  const BrdfPtr brdf = read(lightsTable({15, 30, 60}, kLights, 1, twoPeaks));
  ASSERT_TRUE(brdf);
  for (const double thetaL : {15.0, 20.0, 22.5, 40.0, 45.0, 55.0, 60.0}) {
    const Eigen::Vector3d light = direction(thetaL * kDegree, 0.7);
    EXPECT_NEAR(brdf->evaluate(light, light)[0], 8.1, 0.15) << "retro at " << thetaL;
    EXPECT_NEAR(brdf->evaluate(light, direction(thetaL * kDegree, 0.7 + kPi))[0], 3.1, 0.1)
        << "mirror at " << thetaL;
    // Beside the peak its flank, not a second peak.
    for (const double aside : {-4.0, 4.0}) {
      const Eigen::Vector3d view = direction((thetaL + aside) * kDegree, 0.7);
      const double truth = twoPeaks(thetaL * kDegree, direction((thetaL + aside) * kDegree, 0));
      EXPECT_NEAR(brdf->evaluate(light, view)[0], truth, 0.35) << thetaL << " " << aside;
    }
  }
}

TEST(AltaFile, IsSilentBeyondWhatWasMeasured) {
  const BrdfPtr brdf =
      read(lightsTable({15, 30}, kLights, 4, [](double, const Eigen::Vector3d&) { return 1.0; }));
  ASSERT_TRUE(brdf);
  const auto known = [&](double lightDeg, double viewDeg) {
    return brdf->evaluate(direction(lightDeg * kDegree, 0), direction(viewDeg * kDegree, 2)).allFinite();
  };
  EXPECT_TRUE(known(20, 50));
  EXPECT_TRUE(known(50, 20)) << "by reciprocity";
  EXPECT_TRUE(known(14.8, 40)) << "half a degree of slack";
  EXPECT_FALSE(known(10, 50));
  EXPECT_FALSE(known(50, 60));
  EXPECT_FALSE(known(20, 87)) << "beyond the lattice";
  EXPECT_FALSE(known(95, 20));
}

TEST(AltaFile, MissingPointsAreMissing) {
  std::string text = lightsTable(
      {20}, kLights, 4, [](double, const Eigen::Vector3d& view) { return view.x() > 0.3 ? -1.0 : 1.0; });
  const BrdfPtr brdf = read(text);
  ASSERT_TRUE(brdf);
  EXPECT_TRUE(brdf->evaluate(direction(20 * kDegree, 0), direction(40 * kDegree, 0)).isNaN().all());
  EXPECT_NEAR(brdf->evaluate(direction(20 * kDegree, 0), direction(40 * kDegree, kPi))[0], 1, 1e-12);
}

TEST(AltaFile, TheOutgoingCosineIsDividedOut) {
  const BrdfPtr brdf =
      read(lightsTable({30}, header("ISOTROPIC_TL_TV_PROJ_DPHI", "INV_STERADIAN_COSINE_FACTOR", "3 1"), 2,
                       [](double, const Eigen::Vector3d& view) { return 0.7 * view.z(); }));
  ASSERT_TRUE(brdf);
  EXPECT_NEAR(brdf->evaluate(direction(30 * kDegree, 0), direction(70 * kDegree, 1))[0], 0.7, 1e-6);
  EXPECT_THAT(brdf->origin().note, HasSubstr("divided out"));
}

TEST(AltaFile, ReadsCosineTables) {
  const BrdfPtr brdf = read(header("COS_TH", "RGB_COLOR", "1 3") + "1.0 3 2 1\n0.5\t2 1 0.5\n0.8 4 4 4\n");
  ASSERT_TRUE(brdf);
  const auto at = [&](double cosH) {
    const Eigen::Vector3d d = direction(std::acos(cosH), 0.4);
    return brdf->evaluate(d, d);  // light and view together: the half-vector is there too
  };
  EXPECT_NEAR(at(0.8)[1], 4, 1e-9);
  EXPECT_NEAR(at(0.9)[0], 3.5, 1e-9);
  EXPECT_NEAR(at(0.4)[2], 0.5, 1e-9) << "half a row's distance beyond";
  EXPECT_TRUE(at(0.3).isNaN().all());
}

TEST(AltaFile, RefusesWithTheReason) {
  const auto error = [](const std::string& text) {
    const Result<BrdfPtr> brdf = readAltaBytes(text, "x.dat");
    EXPECT_FALSE(brdf) << text.substr(0, 200);
    if (brdf) return std::string();
    EXPECT_FALSE(brdf.error().tryThis.empty());
    return brdf.error().sentence();
  };
  const std::string cosine = header("COS_TH", "INV_STERADIAN", "1 1");
  EXPECT_THAT(error(""), HasSubstr("no rows"));
  EXPECT_THAT(error(cosine), HasSubstr("no rows"));
  EXPECT_THAT(error(cosine + "0.5 1\n0.6\n"), HasSubstr("line 6"));
  EXPECT_THAT(error(cosine + "0.5 1\n0.6 1 2\n"), HasSubstr("3 columns where 2"));
  EXPECT_THAT(error(cosine + "0.5 nan\n"), HasSubstr("'nan' is not a finite number"));
  EXPECT_THAT(error(cosine + "0.5 inf\n"), HasSubstr("not a finite number"));
  EXPECT_THAT(error(cosine + "0.5 1x\n"), HasSubstr("'1x'"));
  EXPECT_THAT(error(cosine + "1.5 1\n"), HasSubstr("out of range"));
  EXPECT_THAT(error(cosine + "0.5 1\n"), HasSubstr("fewer than two"));
  EXPECT_THAT(error(cosine + "0.5 1\n0.5 2\n"), HasSubstr("two rows"));
  EXPECT_THAT(error("0.5 1\n"), HasSubstr("#PARAM_IN"));
  EXPECT_THAT(error(header("RUSIN_TH_PH_TD_PD", "INV_STERADIAN", "4 1") + "0 0 0 0 1\n"),
              HasSubstr("RUSIN_TH_PH_TD_PD"));
  EXPECT_THAT(error(header("COS_TH", "XYZ_COLOR", "1 3") + "0.5 1 1 1\n"), HasSubstr("XYZ_COLOR"));
  EXPECT_THAT(error(header("COS_TH", "INV_STERADIAN", "1 9") + "0.5 1\n"), HasSubstr("9 values"));
  EXPECT_THAT(error(kLights + "0.3 60 0 1\n"), HasSubstr("radians"));
  std::string scattered = kLights;
  for (int i = 0; i < 50; ++i) {
    scattered += "0.3 " + std::to_string(0.01 * i) + " " + std::to_string(0.013 * ((i * 17) % 50)) + " 1\n";
  }
  EXPECT_THAT(error(scattered), HasSubstr("scattered"));
}

TEST(AltaFile, ReadsThePublishedRetroreflectors) {
  PATINA_NEEDS_SHARED("measured/retro");
  const auto files = listBrdfFiles(test::sharedData() / "measured/retro");
  ASSERT_TRUE(files);
  ASSERT_EQ(files->size(), 3u);
  for (const auto& file : *files) {
    const Result<BrdfPtr> brdf = readBrdf(file);
    ASSERT_TRUE(brdf) << brdf.error().sentence();
    if (file.extension() == ".alta") continue;
    // What a retroreflector is: brighter towards the light than 8 degrees beside it, at every angle.
    for (const double lightDeg : {15.0, 22.0, 30.0, 45.0, 60.0}) {
      const Eigen::Vector3d light = direction(lightDeg * kDegree, 1);
      const double towards = (*brdf)->evaluate(light, light)[0];
      const double beside = (*brdf)->evaluate(light, direction((lightDeg - 8) * kDegree, 1))[0];
      // The orange tape has lost its retroreflection at 60 degrees.
      if (lightDeg < 50 || file.filename() == "retro-3M-jaune-dense.dat") {
        EXPECT_GT(towards, 3 * beside) << file << " " << lightDeg;
      }
    }
  }
}

}  // namespace
}  // namespace patina
