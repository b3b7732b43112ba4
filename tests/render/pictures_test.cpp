#include <gtest/gtest.h>

#include <cmath>

#include "engine/render/brdf_sphere.h"
#include "engine/render/colour_map.h"
#include "engine/render/contact_sheet.h"
#include "engine/render/label.h"
#include "engine/render/relit_sheet.h"
#include "engine/render/tone_map.h"

namespace patina {
namespace {

SvbrdfMaps plainMaps(int width, int height) {
  SvbrdfMaps maps;
  maps.width = width;
  maps.height = height;
  maps.widthMm = 120;
  maps.heightMm = 120.0 * height / width;
  maps.diffuse = Image(width, height, 3, 0.4f);
  maps.specular = Image(width, height, 3, 0.05f);
  maps.normal = Image(width, height, 3, 0.0f);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) maps.normal.at(x, y, 2) = 1;
  maps.sigma = Image(width, height, 1, 0.08f);
  maps.kurtosis = Image(width, height, 1, 1.2f);
  maps.residual = Image(width, height, 1, 0.01f);
  maps.status = Image(width, height, 1, 1.0f);
  return maps;
}

float lightness(const std::array<float, 3>& colour) {  // CIE L*
  const float y = 0.2126f * linearFromSrgb(colour[0]) + 0.7152f * linearFromSrgb(colour[1]) +
                  0.0722f * linearFromSrgb(colour[2]);
  return y > 0.008856f ? 116 * std::cbrt(y) - 16 : 903.3f * y;
}

TEST(ToneMap, SrgbRoundTrips) {
  for (float v : {0.0f, 0.001f, 0.0031308f, 0.02f, 0.2f, 0.7f, 1.0f})
    EXPECT_NEAR(linearFromSrgb(srgbFromLinear(v)), v, 1e-5f);
  EXPECT_NEAR(srgbFromLinear(0.2140f), 0.5f, 1e-3f);  // the standard's middle grey
}

TEST(ToneMap, ShoulderRisesWithoutReachingWhite) {
  Image ramp(200, 1, 1);
  for (int x = 0; x < 200; ++x) ramp.at(x, 0) = 0.05f * static_cast<float>(x);
  const Image shown = toneMap(ramp);
  for (int x = 1; x < 200; ++x) EXPECT_GT(shown.at(x, 0), shown.at(x - 1, 0));
  EXPECT_LT(shown.at(199, 0), 1.0f);
  EXPECT_NEAR(shown.at(10, 0), srgbFromLinear(0.5f), 1e-5f);  // unchanged below the bend
  ramp.at(3, 0) = std::nanf("");
  EXPECT_EQ(toneMap(ramp).at(3, 0), 0);
}

TEST(ToneMap, AutoExposureFollowsTheLight) {
  Image image(10, 10, 3, 0.02f);
  EXPECT_NEAR(autoExposure(image, 0.9f, 0.8f), 40, 1e-3f);
  EXPECT_EQ(autoExposure(Image(4, 4, 3, 0.0f)), 1.0f);
}

TEST(ColourMap, LightnessRisesEvenly) {
  for (ColourMap map : {ColourMap::Viridis, ColourMap::Magma}) {
    const float low = lightness(mapColour(map, 0)), high = lightness(mapColour(map, 1));
    for (int i = 0; i < 20; ++i) {
      const float rise = lightness(mapColour(map, (i + 1) / 20.0f)) - lightness(mapColour(map, i / 20.0f));
      EXPECT_GT(rise, 0.5f * (high - low) / 20) << i;
      EXPECT_LT(rise, 1.6f * (high - low) / 20) << i;
    }
    EXPECT_EQ(mapColour(map, -3), mapColour(map, 0));
    EXPECT_EQ(mapColour(map, std::nanf("")), mapColour(map, 0));
  }
}

TEST(Label, StaysInsideThePicture) {
  Image picture(20, 10, 3);
  drawLabel(picture, 12, 5, "AB", 2, {1, 1, 1});  // runs over two edges
  drawLabel(picture, -7, -3, "AB", 2, {1, 1, 1});
  float inked = 0;
  for (float v : picture.samples()) inked += v;
  EXPECT_GT(inked, 0);
  EXPECT_EQ(labelWidth("AB", 2), 22);
}

TEST(ParametersFromMaps, InterpolatesBetweenTexelCentres) {
  SvbrdfMaps maps = plainMaps(4, 4);
  maps.sigma.at(1, 2) = 0.10f;
  maps.sigma.at(2, 2) = 0.20f;
  EXPECT_NEAR(parametersFromMaps(maps, 1.5f / 4, 2.5f / 4).sigma, 0.10f, 1e-6f);
  EXPECT_NEAR(parametersFromMaps(maps, 2.0f / 4, 2.5f / 4).sigma, 0.15f, 1e-6f);
  EXPECT_NEAR(parametersFromMaps(maps, 0.3f, 0.3f).normal.norm(), 1.0f, 1e-6f);
}

TEST(RelitSheet, LambertianRadianceIsRight) {
  SvbrdfMaps maps = plainMaps(8, 8);
  maps.specular = Image(8, 8, 3, 0.0f);
  PointLight light;
  light.positionMm = {0, 0, 300};
  light.intensity = Eigen::Array3f(9e4f, 0, 0);
  SheetView view;
  view.eyeMm = {0, 0, 500};
  view.width = view.height = 65;
  const Image picture = relitSheet(maps, light, view);
  EXPECT_NEAR(picture.at(32, 32, 0), 0.4f / 3.14159265f * 1.0f, 2e-4f);  // albedo / pi times 9e4 / 300^2
  EXPECT_EQ(picture.at(32, 32, 1), 0);
  EXPECT_EQ(picture.at(0, 0, 0), 0);  // beside the sheet
}

TEST(RelitSheet, RowZeroIsFarFromAViewerInFront) {
  SvbrdfMaps maps = plainMaps(8, 8);
  for (int x = 0; x < 8; ++x) maps.diffuse.at(x, 0, 1) = 1.0f;  // green at +y
  for (int y = 0; y < 8; ++y) maps.diffuse.at(0, y, 2) = 1.0f;  // blue at -x
  SheetView view;
  view.width = view.height = 64;
  const Image picture = relitSheet(maps, PointLight{}, view);
  int greenRow = 0, blueColumn = 0, greens = 0, blues = 0;
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x) {
      if (picture.at(x, y, 1) > 1.8f * picture.at(x, y, 0)) greenRow += y, ++greens;
      if (picture.at(x, y, 2) > 1.8f * picture.at(x, y, 0)) blueColumn += x, ++blues;
    }
  ASSERT_TRUE(greens > 0 && blues > 0);
  EXPECT_LT(greenRow / greens, 28);   // +y is up
  EXPECT_LT(blueColumn / blues, 24);  // -x is left
}

TEST(RelitSheet, UnmeasuredTexelsShowTheBackground) {
  SvbrdfMaps maps = plainMaps(8, 8);
  for (float& s : maps.status.samples()) s = 0;
  SheetView view;
  view.width = view.height = 32;
  view.background = 0.25f;
  const Image picture = relitSheet(maps, PointLight{}, view);
  for (float v : picture.samples()) ASSERT_EQ(v, 0.25f);
}

TEST(BrdfSphere, WhiteFurnaceLikeBalance) {
  // Diffuse only: the sphere's radiance lies between the room's darkest and brightest.
  SvbrdfParameters p;
  p.diffuse = Eigen::Array3f::Ones();
  SphereLighting lighting;
  lighting.lightIrradiance.setZero();
  const Image sphere = brdfSphere(p, 64, lighting);
  EXPECT_GT(sphere.at(32, 32, 0), 0.16f);
  EXPECT_LT(sphere.at(32, 32, 0), 6.5f);
  EXPECT_EQ(sphere.at(0, 0, 0), 0);
}

TEST(BrdfSphere, MirrorShowsTheRoom) {
  // A very narrow lobe: the radiance is specular F / F0 times the room in the mirror direction.
  SvbrdfParameters p;
  p.specular = Eigen::Array3f::Constant(0.06f);
  p.sigma = 0.002f;
  SphereLighting lighting;
  lighting.lightIrradiance.setZero();
  constexpr int kSize = 101;
  const Image sphere = brdfSphere(p, kSize, lighting, 64);
  const float radius = 0.46f * kSize;
  int compared = 0;
  for (const auto& [px, py] : {std::pair{50, 50}, {60, 70}, {30, 65}, {50, 20}}) {
    const float x = (px + 0.5f - 0.5f * kSize) / radius, y = (0.5f * kSize - py - 0.5f) / radius,
                z = std::sqrt(1 - x * x - y * y);
    const Eigen::Vector3f normal(x, y, z), mirrored = 2 * z * normal - Eigen::Vector3f::UnitZ();
    const float expected = 0.06f * svbrdfFresnelRatio(z) * studioRadiance(mirrored);
    const float nearby = 0.06f * svbrdfFresnelRatio(z) *
                         studioRadiance((mirrored + Eigen::Vector3f(0.02f, 0.02f, 0)).normalized());
    if (std::abs(nearby - expected) > 0.02f * expected) continue;  // on a soft box's edge
    EXPECT_NEAR(sphere.at(px, py, 0), expected, 0.03f * expected) << px << "," << py;
    ++compared;
  }
  EXPECT_GE(compared, 3);
}

TEST(ContactSheet, HoldsEveryPanelAndHatchesWhatWasNotMeasured) {
  SvbrdfMaps maps = plainMaps(12, 8);
  const Image plain = contactSheet(maps);
  EXPECT_EQ(plain.channels(), 3);
  EXPECT_GT(plain.width(), 4 * 300);
  for (float v : plain.samples()) ASSERT_TRUE(v >= 0 && v <= 1);
  for (int x = 0; x < 12; ++x) maps.status.at(x, 0) = static_cast<float>(TexelStatus::MirrorOffScreen);
  const Image hatched = contactSheet(maps);
  int changed = 0;
  for (std::size_t i = 0; i < plain.samples().size(); ++i)
    changed += plain.samples()[i] != hatched.samples()[i];
  EXPECT_GT(changed, 1000);
  EXPECT_TRUE(contactSheet(SvbrdfMaps{}).empty());
}

}  // namespace
}  // namespace patina
