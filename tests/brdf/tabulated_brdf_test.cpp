#include "engine/brdf/tabulated_brdf.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

#include "engine/brdf/analytic_brdf.h"
#include "tests/base/temp_folder.h"

namespace patina {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kMerlBytes = 12 + 3 * 1458000 * 8;

/// A MERL file as the database's page describes it, written here by hand.
std::string merlBytes(const std::function<double(int channel, std::size_t cell)>& raw) {
  std::string bytes(kMerlBytes, '\0');
  const std::uint32_t sizes[] = {90, 90, 180};
  std::memcpy(bytes.data(), sizes, sizeof sizes);
  for (int channel = 0; channel < 3; ++channel) {
    for (std::size_t cell = 0; cell < 1458000; ++cell) {
      const double value = raw(channel, cell);
      std::memcpy(bytes.data() + 12 + (channel * std::size_t{1458000} + cell) * 8, &value, 8);
    }
  }
  return bytes;
}

TabulatedBrdf::Planes planesOf(const std::function<double(std::size_t)>& value) {
  TabulatedBrdf::Planes planes;
  for (auto& plane : planes) {
    plane.resize(MerlGrid::kCells);
    for (std::size_t cell = 0; cell < MerlGrid::kCells; ++cell) plane[cell] = value(cell);
  }
  return planes;
}

TEST(MerlFile, ScalesAndOrderAreThoseOfTheDatabase) {
  const std::string bytes = merlBytes([](int channel, std::size_t cell) { return channel * 1e7 + cell; });
  const auto table = readMerlBytes(bytes, "gold.binary");
  ASSERT_TRUE(table) << table.error().sentence();
  const std::size_t cell = 3 * 90 * 180 + 7 * 180 + 11;  // thetaH 3, thetaD 7, phiD 11
  EXPECT_DOUBLE_EQ((*table)->planes()[0][cell], cell / 1500.0);
  EXPECT_DOUBLE_EQ((*table)->planes()[1][cell], (1e7 + cell) * 1.15 / 1500);
  EXPECT_DOUBLE_EQ((*table)->planes()[2][cell], (2e7 + cell) * 1.66 / 1500);
  const HalfDiffAngles centre{3.5 * 3.5 / 90 * kDegree, 7.5 * kDegree, 11.5 * kDegree};
  EXPECT_NEAR((*table)->evaluate(centre)[0], cell / 1500.0, 1e-6 * cell / 1500.0);
  EXPECT_EQ((*table)->origin().name, "gold");
  EXPECT_EQ((*table)->origin().format, "merl");
}

TEST(MerlFile, IsWrittenBackByteForByte) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> exponent(0, 4);
  const std::string bytes = merlBytes([&](int, std::size_t cell) {
    return cell % 5 == 0 ? -1.0 : cell % 7 == 0 ? -0.25 : cell % 11 == 0 ? 0.0 : std::exp(exponent(random));
  });
  const test::TempFolder folder;
  test::writeText(folder / "in.binary", bytes);
  const auto table = readMerl(folder / "in.binary");
  ASSERT_TRUE(table) << table.error().sentence();
  EXPECT_FALSE((*table)->valid(0)) << "negative cells stay what they are";
  EXPECT_EQ((*table)->planes()[0][0], -1.0 / 1500);
  ASSERT_TRUE(writeMerl(folder / "out.binary", **table));
  EXPECT_TRUE(test::readText(folder / "out.binary") == bytes) << "the file changed";
}

TEST(MerlFile, OneNegativeChannelMakesACellInvalid) {
  const auto table = readMerlBytes(
      merlBytes([](int channel, std::size_t cell) { return channel == 2 && cell == 5 ? -1 : 1; }), "x");
  ASSERT_TRUE(table);
  EXPECT_FALSE((*table)->valid(5));
  EXPECT_EQ((*table)->validCells(), MerlGrid::kCells - 1);
}

TEST(MerlFile, RefusesWhatIsNotWhole) {
  const auto sentence = [](const std::string& bytes) {
    const auto table = readMerlBytes(bytes, "x.binary");
    EXPECT_FALSE(table);
    if (table) return std::string();
    EXPECT_EQ(table.error().code, ErrorCode::Malformed);
    EXPECT_FALSE(table.error().tryThis.empty());
    return table.error().sentence();
  };
  std::string whole = merlBytes([](int, std::size_t) { return 0.5; });
  EXPECT_THAT(sentence(""), HasSubstr("three sizes"));
  EXPECT_THAT(sentence(whole.substr(0, 11)), HasSubstr("three sizes"));
  EXPECT_THAT(sentence(whole.substr(0, 5000)), HasSubstr("cut off"));
  EXPECT_THAT(sentence(whole.substr(0, whole.size() - 1)), HasSubstr("cut off"));
  EXPECT_THAT(sentence(whole + "x"), HasSubstr("too long"));

  std::string lying = whole;
  const std::uint32_t sizes[] = {90, 90, 360};
  std::memcpy(lying.data(), sizes, sizeof sizes);
  EXPECT_THAT(sentence(lying), HasSubstr("90 x 90 x 360"));

  for (const double bad :
       {kNan, std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()}) {
    std::string poisoned = whole;
    const std::size_t cell = (std::size_t{2} * 90 + 1) * 180 + 4;
    std::memcpy(poisoned.data() + 12 + (1458000 + cell) * 8, &bad, 8);
    EXPECT_THAT(sentence(poisoned), HasSubstr("green"));
    EXPECT_THAT(sentence(poisoned), HasSubstr("theta_h 2, theta_d 1, phi_d 4"));
  }
}

TEST(MerlFile, SaysWhyItCannotBeReadOrWritten) {
  const test::TempFolder folder;
  const auto missing = readMerl(folder / "none.binary");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::NotFound);
  const TabulatedBrdf table(planesOf([](std::size_t) { return 1.0; }), {});
  const Status written = writeMerl(folder / "nowhere/x.binary", table);
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().code, ErrorCode::WriteFailed);
}

TEST(MerlFile, WritesUnknownCellsAsNegative) {
  const test::TempFolder folder;
  const TabulatedBrdf table(planesOf([](std::size_t cell) { return cell == 9 ? kNan : 1.0; }), {});
  ASSERT_TRUE(writeMerl(folder / "x.binary", table));
  const auto back = readMerl(folder / "x.binary");
  ASSERT_TRUE(back) << back.error().sentence();
  EXPECT_FALSE((*back)->valid(9));
  EXPECT_EQ((*back)->validCells(), MerlGrid::kCells - 1);
}

TEST(TabulatedBrdf, InterpolatesLinearlyInGridCoordinates) {
  // A function that is linear in the coordinates of the grid is met exactly, inside of it.
  const auto linear = [](double h, double d, double p) { return 1 + 0.3 * h + 0.2 * d + 0.1 * p; };
  const TabulatedBrdf table(
      planesOf([&](std::size_t cell) { return linear(cell / (90 * 180), cell / 180 % 90, cell % 180); }), {});
  std::mt19937 random(1);
  std::uniform_real_distribution<double> h(0, 89), d(0, 89), p(0, 179);
  for (int i = 0; i < 1000; ++i) {
    const double ch = h(random), cd = d(random), cp = p(random);
    const HalfDiffAngles angles{(ch + 0.5) * (ch + 0.5) / 90 * kDegree, (cd + 0.5) * kDegree,
                                (cp + 0.5) * kDegree};
    EXPECT_NEAR(table.evaluate(angles)[1], linear(ch, cd, cp), 1e-9);
  }
}

TEST(TabulatedBrdf, PhiDHasPeriodPi) {
  const TabulatedBrdf table(planesOf([](std::size_t cell) { return 1.0 + cell % 180; }), {});
  const double h = 20 * kDegree, d = 30 * kDegree;
  for (const double phi : {0.2, 1.5, 3.0}) {
    EXPECT_NEAR(table.evaluate({h, d, phi})[0], table.evaluate({h, d, phi - kPi})[0], 1e-9) << phi;
  }
  // Across the seam the neighbours are the last cell and the first.
  EXPECT_NEAR(table.evaluate({h, d, 0.0})[0], (1.0 + 180.0) / 2, 1e-9);
  const DirectionPair pair = directionsFromHalfDiff({h, d, 0.7});
  EXPECT_NEAR(table.evaluate(pair.toLight, pair.toView)[0], table.evaluate(pair.toView, pair.toLight)[0],
              1e-9)
      << "reciprocal";
}

TEST(TabulatedBrdf, LeavesInvalidCellsOut) {
  const TabulatedBrdf table(planesOf([](std::size_t cell) { return cell / (90 * 180) < 10 ? -1.0 : 2.0; }),
                            {});
  const HalfDiffAngles among{4 * 4 / 90.0 * kDegree, 0.3, 0.4};
  EXPECT_TRUE(table.evaluate(among).isNaN().all()) << "no cell around is valid";
  const HalfDiffAngles edge{10.2 * 10.2 / 90 * kDegree, 0.3, 0.4};  // between rows 9 (invalid) and 10
  EXPECT_NEAR(table.evaluate(edge)[0], 2, 1e-12) << "weights sum to one over what is known";
  EXPECT_TRUE(table.evaluate(Eigen::Vector3d(0.6, 0, -0.8), Eigen::Vector3d::UnitZ()).isNaN().all());
  EXPECT_TRUE(table.evaluate({kNan, 0, 0}).isNaN().all());
}

TEST(TabulatedBrdf, RefusesPlanesOfAnotherSize) {
  TabulatedBrdf::Planes planes = planesOf([](std::size_t) { return 1.0; });
  planes[1].pop_back();
  EXPECT_THROW(TabulatedBrdf(planes, {}), std::invalid_argument);
}

TEST(Tabulate, HoldsTheBrdfAtCellCentresAndMarksTheRest) {
  const auto brdf = parseAnalyticBrdf("ggx?alpha=0.3&diffuse=0.1,0.2,0.3");
  ASSERT_TRUE(brdf);
  const auto table = tabulate(**brdf);
  ASSERT_TRUE(table);
  std::size_t above = 0;
  for (std::size_t cell = 0; cell < MerlGrid::kCells; cell += 37) {
    const DirectionPair pair = directionsFromHalfDiff(MerlGrid::centre(cell));
    const bool reachable = pair.toLight.z() >= 0 && pair.toView.z() >= 0;
    ASSERT_EQ((*table)->valid(cell), reachable) << cell;
    if (!reachable) {
      EXPECT_EQ((*table)->planes()[0][cell], -1);
      continue;
    }
    ++above;
    const Eigen::Array3d truth = (*brdf)->evaluate(pair.toLight, pair.toView);
    for (int channel = 0; channel < 3; ++channel) {
      EXPECT_NEAR((*table)->planes()[channel][cell], truth[channel], 1e-6 * truth[channel]);
    }
  }
  EXPECT_GT(above, 20000u);
}

TEST(Tabulate, AveragesAnAnisotropicSurfaceAndSaysSo) {
  const auto brdf = parseAnalyticBrdf("ward?alphaX=0.4&alphaY=0.1&diffuse=0");
  ASSERT_TRUE(brdf);
  ASSERT_FALSE((*brdf)->isotropic());
  const auto table = tabulate(**brdf, {}, 16);
  ASSERT_TRUE(table);
  EXPECT_THAT((*table)->origin().note, HasSubstr("averaged over 16 azimuths"));
  const std::size_t cell = MerlGrid::cell(30, 20, 40);
  double mean = 0;
  for (int a = 0; a < 720; ++a) {
    const DirectionPair pair = directionsFromHalfDiff(MerlGrid::centre(cell), a * 2 * kPi / 720);
    mean += (*brdf)->evaluate(pair.toLight, pair.toView)[0] / 720;
  }
  EXPECT_NEAR((*table)->planes()[0][cell], mean, 0.01 * mean);

  const auto isotropic = parseAnalyticBrdf("ward?alpha=0.2");
  const auto plain = tabulate(**isotropic);
  ASSERT_TRUE(plain);
  EXPECT_THAT((*plain)->origin().note, Not(HasSubstr("averaged")));
}

TEST(MadeReciprocal, AveragesTheTwoAnswersAndSaysHowFarApartTheyWere) {
  // Left of phiD 90 degrees twice as bright as right of it; one cell unknown.
  const std::size_t hole = MerlGrid::cell(5, 5, 20);
  const TabulatedBrdf table(
      planesOf([&](std::size_t cell) { return cell == hole      ? -1.0
                                              : cell % 180 < 90 ? 2.0
                                                                : 1.0; }), {});
  const auto reciprocal = madeReciprocal(table);
  EXPECT_EQ(reciprocal->planes()[0][MerlGrid::cell(1, 2, 3)], 1.5);
  EXPECT_EQ(reciprocal->planes()[0][MerlGrid::cell(1, 2, 176)], 1.5);
  EXPECT_EQ(reciprocal->planes()[2][hole], 1.0) << "the one that is known";
  EXPECT_THAT(reciprocal->origin().note, HasSubstr("0.693 ln"));
  const TabulatedBrdf even(planesOf([](std::size_t) { return 2.0; }), {});
  EXPECT_EQ(madeReciprocal(even)->origin().note, "");
}

TEST(Tabulate, StopsWhenAskedTo) {
  const auto brdf = parseAnalyticBrdf("lambert");
  std::stop_source source;
  source.request_stop();
  JobContext job;
  job.stop = source.get_token();
  const auto table = tabulate(**brdf, job);
  ASSERT_FALSE(table);
  EXPECT_EQ(table.error().code, ErrorCode::Cancelled);
}

}  // namespace
}  // namespace patina
