#include "engine/brdf/rgl_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <numbers>
#include <random>

#include "engine/brdf/brdf_file.h"
#include "tests/brdf/brdf_samples.h"
#include "tests/test_data.h"

namespace patina {
namespace {

using test::smallRgl;
using test::TensorBuilder;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;
constexpr float kPiF = std::numbers::pi_v<float>;

Eigen::Vector3d direction(double thetaRad, double phiRad) {
  return {std::sin(thetaRad) * std::cos(phiRad), std::sin(thetaRad) * std::sin(phiRad), std::cos(thetaRad)};
}

BrdfPtr read(const TensorBuilder& file) {
  Result<BrdfPtr> brdf = readRglBytes(file.build(), "folder/gold_rgb.bsdf");
  EXPECT_TRUE(brdf) << (brdf ? "" : brdf.error().sentence());
  return brdf ? *brdf : nullptr;
}

TensorBuilder isotropicFile() {
  return smallRgl({0.0f}, [](int, int theta, int channel) { return 0.1f * (theta + 1) + channel; });
}

TEST(RglFile, GivesTheFilesNumberDividedByTheViewsCosine) {
  const BrdfPtr brdf = read(isotropicFile());
  ASSERT_TRUE(brdf);
  EXPECT_TRUE(brdf->isotropic());
  EXPECT_EQ(brdf->origin().name, "gold");
  EXPECT_EQ(brdf->origin().format, "rgl");
  EXPECT_THAT(brdf->origin().note, HasSubstr("made by hand"));
  EXPECT_THAT(brdf->origin().note, HasSubstr("not exactly reciprocal"));
  // ndf / (4 sigma) is 1; halfway between the slices at 0 and 0.8 the mean of 0.1 and 0.2.
  const Eigen::Array3d value = brdf->evaluate(direction(0.4, 1.0), direction(1.0, -2.0));
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(value[c], (0.15 + c) / std::cos(1.0), 1e-6);
  EXPECT_TRUE(brdf->evaluate(direction(1.6, 0), direction(0.1, 0)).isNaN().all());
  EXPECT_TRUE(brdf->evaluate(direction(0.1, 0), direction(kPi / 2, 0)).isNaN().all()) << "nothing to divide";
}

TEST(RglFile, WithoutJacobianTheNumberStandsForItself) {
  TensorBuilder file = isotropicFile();
  file.field("jacobian").bytes[0] = '\0';
  for (float& x : *reinterpret_cast<std::array<float, 6>*>(file.field("ndf").bytes.data())) x = 8;
  const BrdfPtr brdf = read(file);
  ASSERT_TRUE(brdf);
  EXPECT_NEAR(brdf->evaluate(direction(0, 0), direction(0.5, 0))[0], 0.1 / std::cos(0.5), 1e-6);
}

TEST(RglFile, NegativeFitsAreClampedToZero) {
  const BrdfPtr brdf = read(smallRgl({0.0f}, [](int, int, int channel) { return channel - 1.0f; }));
  ASSERT_TRUE(brdf);
  const Eigen::Array3d value = brdf->evaluate(direction(0.4, 0), direction(0.4, 1));
  EXPECT_EQ(value[0], 0);
  EXPECT_GT(value[2], 0);
}

TEST(RglFile, AnisotropicFilesDependOnTheAzimuth) {
  const BrdfPtr brdf =
      read(smallRgl({-kPiF, 0.0f, kPiF}, [](int phi, int, int) { return phi == 1 ? 2.0f : 1.0f; }));
  ASSERT_TRUE(brdf);
  EXPECT_FALSE(brdf->isotropic());
  const double cosine = std::cos(0.3);
  EXPECT_NEAR(brdf->evaluate(direction(0.4, 0), direction(0.3, 2))[0] * cosine, 2, 1e-5);
  EXPECT_NEAR(brdf->evaluate(direction(0.4, kPi / 2), direction(0.3, 2))[0] * cosine, 1.5, 1e-5);
  EXPECT_NEAR(brdf->evaluate(direction(0.4, -kPi + 1e-9), direction(0.3, 2))[0] * cosine, 1, 1e-5);
}

TEST(RglFile, HalfAndQuarterTurnsAreUnfolded) {
  // Half: phi and phi + pi are alike. Stored is [-pi, 0].
  const BrdfPtr half =
      read(smallRgl({-kPiF, -kPiF / 2, 0.0f}, [](int phi, int, int) { return 1.0f + (phi == 1); }));
  ASSERT_TRUE(half);
  for (const double phi : {-2.5, -1.0, -0.2}) {
    const Eigen::Array3d stored = half->evaluate(direction(0.6, phi), direction(0.3, phi + 0.7));
    const Eigen::Array3d turned = half->evaluate(direction(0.6, phi + kPi), direction(0.3, phi + kPi + 0.7));
    EXPECT_TRUE(stored.isApprox(turned, 1e-6)) << phi;
  }
  // Quarter: mirror images are alike too. Stored is [-pi, -pi / 2].
  const BrdfPtr quarter =
      read(smallRgl({-kPiF, -0.75f * kPiF, -kPiF / 2}, [](int phi, int, int) { return 1.0f + (phi == 1); }));
  ASSERT_TRUE(quarter);
  for (const double phi : {-3.0, -2.5, -1.7}) {
    const double stored = quarter->evaluate(direction(0.6, phi), direction(0.3, 0))[0];
    for (const double image : {-phi, kPi - phi, phi + kPi}) {
      EXPECT_NEAR(quarter->evaluate(direction(0.6, image), direction(0.3, 0))[0], stored, 1e-5)
          << phi << " " << image;
    }
  }
  EXPECT_GT(quarter->evaluate(direction(0.6, kPi / 4), direction(0.3, 0))[0], 1.9 / std::cos(0.3))
      << "the middle of the quarter, mirrored";
}

TEST(RglFile, RefusesDamageWithTheReason) {
  const auto sentence = [](const std::string& bytes) {
    const Result<BrdfPtr> brdf = readRglBytes(bytes, "x.bsdf");
    EXPECT_FALSE(brdf);
    if (brdf) return std::string();
    EXPECT_FALSE(brdf.error().tryThis.empty());
    return brdf.error().sentence();
  };
  const std::string whole = isotropicFile().build();
  EXPECT_THAT(sentence("tensor"), HasSubstr("tensor_file"));
  EXPECT_THAT(sentence(whole.substr(0, 30)), HasSubstr("cut off"));
  EXPECT_THAT(sentence(whole.substr(0, whole.size() - 1)), HasSubstr("the file ends"));
  for (std::size_t length = 0; length < whole.size(); length += 7) sentence(whole.substr(0, length));

  std::string version = whole;
  version[12] = 2;
  EXPECT_THAT(sentence(version), HasSubstr("version 2.0"));

  const auto changed = [&](const std::function<void(TensorBuilder&)>& change) {
    TensorBuilder file = isotropicFile();
    change(file);
    return sentence(file.build());
  };
  EXPECT_THAT(changed([](TensorBuilder& f) { f.remove("ndf"); }), HasSubstr("'ndf' is missing"));
  EXPECT_THAT(changed([](TensorBuilder& f) {
                f.field("ndf").shape = {std::uint64_t{1} << 62, 4};
              }),
              HasSubstr("don't fit"));
  EXPECT_THAT(changed([](TensorBuilder& f) {
                f.field("ndf").shape = {~std::uint64_t{0}, ~std::uint64_t{0}};
              }),
              HasSubstr("don't fit"));
  EXPECT_THAT(changed([](TensorBuilder& f) {
                f.field("rgb").shape[1] = 2;
                f.field("rgb").bytes.resize(96);
              }),
              HasSubstr("incident direction"));
  EXPECT_THAT(changed([](TensorBuilder& f) { f.field("ndf").type = 77; }), HasSubstr("unknown type"));
  EXPECT_THAT(changed([](TensorBuilder& f) { f.field("ndf").type = 5; }), HasSubstr("another type"));
  EXPECT_THAT(changed([](TensorBuilder& f) { f.fields.push_back(f.field("ndf")); }), HasSubstr("twice"));
  const auto poison = [&](const std::string& name, float value) {
    return changed([&](TensorBuilder& f) { std::memcpy(f.field(name).bytes.data() + 4, &value, 4); });
  };
  EXPECT_THAT(poison("rgb", std::nanf("")), HasSubstr("value 1 of 'rgb' is not a finite number"));
  EXPECT_THAT(poison("sigma", -1), HasSubstr("'sigma'"));
  EXPECT_THAT(poison("theta_i", 5), HasSubstr("'theta_i'"));

  TensorBuilder spectral = isotropicFile();
  spectral.field("rgb").name = "spectra";
  const Result<BrdfPtr> brdf = readRglBytes(spectral.build(), "x.bsdf");
  ASSERT_FALSE(brdf);
  EXPECT_EQ(brdf.error().code, ErrorCode::Unsupported);
  EXPECT_THAT(brdf.error().sentence(), HasSubstr("_rgb.bsdf"));
}

TEST(RglFile, PublishedFilesAreFiniteNearlyReciprocalAndOfPlausibleAlbedo) {
  PATINA_NEEDS_SHARED("measured/rgl");
  const auto files = listBrdfFiles(test::sharedData() / "measured/rgl");
  ASSERT_TRUE(files);
  ASSERT_GE(files->size(), 18u);
  for (const std::filesystem::path& file : *files) {
    const Result<BrdfPtr> brdf = readBrdf(file);
    ASSERT_TRUE(brdf) << brdf.error().sentence();
    std::mt19937 random(2);
    std::uniform_real_distribution<double> square(0, 1), phi(-kPi, kPi);
    std::vector<double> reciprocity;
    double albedo = 0;
    constexpr int kSamples = 4000;
    const Eigen::Vector3d fixed = direction(0.6, 0.2);
    for (int i = 0; i < kSamples; ++i) {
      const Eigen::Vector3d a = direction(std::asin(std::sqrt(square(random))) * 0.9, phi(random));
      const Eigen::Vector3d b = direction(std::asin(std::sqrt(square(random))) * 0.9, phi(random));
      const Eigen::Array3d there = (*brdf)->evaluate(a, b), back = (*brdf)->evaluate(b, a);
      ASSERT_TRUE(there.allFinite() && (there >= 0).all()) << file;
      if (there[1] > 1e-4 && back[1] > 1e-4) reciprocity.push_back(std::abs(std::log(there[1] / back[1])));
      // Directions distributed like the cosine: the mean times pi is the albedo.
      const Eigen::Vector3d view = direction(std::asin(std::sqrt(square(random))), phi(random));
      const Eigen::Array3d value = (*brdf)->evaluate(fixed, view);
      if (value.allFinite()) albedo += value.mean() * kPi / kSamples;
    }
    std::nth_element(reciprocity.begin(), reciprocity.begin() + reciprocity.size() / 2, reciprocity.end());
    // The spread of the published data; a confusion of light and view with the cosine would give 0.7 and
    // more.
    EXPECT_LT(reciprocity[reciprocity.size() / 2], 0.45) << file;
    EXPECT_GT(albedo, 0.005) << file;
    EXPECT_LT(albedo, 1.1) << file;
  }
}

}  // namespace
}  // namespace patina
