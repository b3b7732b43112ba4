#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "engine/effect/effect_info.h"
#include "engine/flash/joint.h"
#include "engine/flash/materials.h"
#include "engine/flash/noise.h"
#include "engine/flash/rig.h"
#include "engine/surface/svbrdf.h"

namespace patina {
namespace {

FlashCapture captureAt(const Eigen::Vector3d& camera, const Eigen::Vector3d& light) {
  FlashCapture capture;
  capture.widthMm = capture.heightMm = 60;
  FlashPhoto photo;
  photo.cameraPositionMm = camera, photo.lightPositionMm = light;
  photo.lightIntensity = {1.5e5, 1.4e5, 1.3e5};
  capture.photos = {photo};
  return capture;
}

TEST(FlashModel, IsTheSurfacesOwnLobeUnderAPointLight) {
  const FlashCapture capture = captureAt({10, 5, 150}, {40, -20, 140});
  FlashRig rig;
  rig.logGain = {0.0};
  FlashLobe lobe;
  lobe.logSigma = std::log(0.12), lobe.logKurtosis = std::log(1.4);
  FlashTexel texel;
  texel.x << 0.06, -0.04, std::log(0.3), std::log(0.2), std::log(0.1), std::log(0.04), std::log(0.05),
      std::log(0.06);
  SvbrdfParameters material;
  material.diffuse = texel.diffuse().cast<float>(), material.specular = texel.specular().cast<float>();
  material.normal = texel.normal().cast<float>();
  material.sigma = 0.12f, material.kurtosis = 1.4f;
  for (const Eigen::Vector2d& at :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(25, -28), Eigen::Vector2d(-30, 12)}) {
    const FlashRay ray = flashRay(capture.photos[0], at);
    const Eigen::Array3d got = flashLight(capture, rig, 0, ray, lobe, texel);
    const Eigen::Array3f brdf =
        svbrdfBrdfTimesCos(ray.toLight.cast<float>(), ray.toView.cast<float>(), material);
    const double distance = (capture.photos[0].lightPositionMm - Eigen::Vector3d(at.x(), at.y(), 0)).norm();
    for (int c = 0; c < 3; ++c) {
      const double expected = brdf[c] * capture.photos[0].lightIntensity[c] / (distance * distance);
      EXPECT_NEAR(got[c], expected, 2e-4 * expected) << "single precision on the other side";
    }
  }
}

TEST(FlashModel, DerivativesOfATexelAreDifferences) {
  const FlashCapture capture = captureAt({10, 5, 150}, {12, 8, 150});
  FlashModel model;
  model.rig.logGain = {0.1};
  model.rig.photoAim = {Eigen::Vector2d(0.1, -0.2)};
  model.rig.beamFallOff = 1.2, model.rig.ambient.setConstant(0.4);
  model.rig.toneLogSlope = {0.1, 0.0, -0.1, 0.2, 0.4};
  model.tone = ToneCurve(model.rig.toneLogSlope);
  model.materials.resize(1);
  model.materials[0].lobe.stretch = {0.2, -0.1};
  model.materials[0].lobe.thirdShare = 0.2;
  FlashObservation seen;
  seen.ray = flashRay(capture.photos[0], {20, -10});
  seen.irradiance = capture.photos[0].lightIntensity.array() * seen.ray.inverseSquare;
  TexelVector x;
  x << 0.05, 0.02, -1.5, -1.2, -2.0, -3.0, -2.8, -3.2;
  const SeenPrediction p = predictSeen(model, 0, seen, x, true);
  for (int i = 0; i < FlashTexel::kParameters; ++i) {
    constexpr double kStep = 1e-5;
    TexelVector up = x, down = x;
    up[i] += kStep, down[i] -= kStep;
    const Eigen::Array3d difference =
        (predictSeen(model, 0, seen, up, false).value - predictSeen(model, 0, seen, down, false).value) /
        (2 * kStep);
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(p.byTexel(c, i), difference[c], 2e-3 * std::abs(difference[c]) + 1e-6) << i << " " << c;
  }
}

TEST(ToneCurve, IsMonotoneAndItsOwnInverse) {
  const ToneCurve straight;
  EXPECT_EQ(straight.value(0.37), 0.37);
  const ToneCurve curve({-0.5, 0.3, -0.2, 0.4, 0.9});
  double last = 0;
  for (double v = 1e-4; v < 1.2; v *= 1.05) {
    const double light = curve.light(v);
    EXPECT_GT(light, last);
    EXPECT_NEAR(curve.value(light), v, 1e-4 * v) << "interpolation in the tables";
    last = light;
  }
  EXPECT_NEAR(curve.light(0.2), 0.2, 1e-4) << "the anchor";
  EXPECT_NEAR(curve.slopeAt(0.3), (curve.value(0.301) - curve.value(0.299)) / 0.002, 1e-3);
}

TEST(ToneCurve, AConstantSlopeIsAGamma) {
  const double h = -std::log(0.8);
  const ToneCurve curve({h, h, h, h, h});
  for (const double light : {0.01, 0.1, 0.5, 0.9})
    EXPECT_NEAR(curve.value(light), 0.2 * std::pow(light / 0.2, 0.8), 2e-3 * curve.value(light));
}

TEST(FlashEffects, AreInTheCatalogueForThisKind) {
  for (const FlashEffect effect : allFlashEffects()) {
    const EffectInfo* info = findEffect(flashEffectId(effect));
    ASSERT_NE(info, nullptr) << flashEffectId(effect);
    EXPECT_TRUE(info->kinds & kFlashKind) << flashEffectId(effect);
  }
}

TEST(Misfit, AClippedPixelIsAtLeast) {
  EXPECT_EQ(misfitOf(1.4, 1.0, 0.01, true).cost, 0);
  EXPECT_EQ(misfitOf(1.4, 1.0, 0.01, true).perValue, 0);
  EXPECT_GT(misfitOf(0.9, 1.0, 0.01, true).cost, 1);
  EXPECT_GT(misfitOf(1.4, 1.0, 0.01, false).cost, 1);
}

TEST(ChiSquareTail, AgreesWithTables) {
  EXPECT_NEAR(chiSquareTail(3.841, 1), 0.05, 1e-4);
  EXPECT_NEAR(chiSquareTail(11.070, 5), 0.05, 1e-4);
  EXPECT_NEAR(chiSquareTail(36.191, 19), 0.01, 1e-4);
  EXPECT_NEAR(sigmasOf(0.0027), 3, 1e-3);
  EXPECT_EQ(chiSquareTail(0, 3), 1);
}

TEST(FlashNoise, IsFoundUnderAShading) {
  // A smooth ramp with noise of known size, made here.
  constexpr double kRead = 2e-3, kShot = 4e-5;
  FlashPixels photo;
  photo.linear = Image(256, 256, 3);
  std::uint64_t state = 1;
  const auto uniform = [&] {
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return (static_cast<double>(state >> 11) + 0.5) / 9007199254740992.0;
  };
  for (int y = 0; y < 256; ++y) {
    for (int x = 0; x < 256; ++x) {
      for (int c = 0; c < 3; ++c) {
        const double v = 0.02 + 0.9 * (x + 256.0 * 0.2 * y / 256) / 320;
        const double gauss = std::sqrt(-2 * std::log(uniform())) * std::cos(2 * std::numbers::pi * uniform());
        photo.linear.at(x, y, c) = static_cast<float>(v + std::sqrt(kRead * kRead + kShot * v) * gauss);
      }
    }
  }
  const FlashNoise noise = measureFlashNoise(std::span(&photo, 1), {0, 0, 0});
  for (const double v : {0.1, 0.3, 0.8}) {
    const double expected = kRead * kRead + kShot * v;
    EXPECT_NEAR(std::sqrt(noise.variance(v, 1) / expected), 1, 0.25)
        << "a quantile of blocks is no more exact";
  }
}

TEST(FlashMaterials, AreAsManyAsThereAreColours) {
  std::vector<Eigen::Array3d> colours;
  for (int i = 0; i < 300; ++i) {
    const double texture = 0.03 * std::sin(12.9898 * i);
    const Eigen::Array3d base = i % 3 == 0   ? Eigen::Array3d(0.3, 0.1, 0.05)
                                : i % 3 == 1 ? Eigen::Array3d(0.05, 0.1, 0.3)
                                             : Eigen::Array3d(0.2, 0.2, 0.2);
    colours.push_back(base.log() + texture);
  }
  const FlashPalette three = findMaterials(colours, 0);
  EXPECT_EQ(three.logColour.size(), 3u);
  EXPECT_NE(three.nearest(colours[0]), three.nearest(colours[1]));
  EXPECT_EQ(three.nearest(colours[0]), three.nearest(colours[3]));
  EXPECT_EQ(findMaterials(colours, 1).logColour.size(), 1u);
  std::vector<Eigen::Array3d> one(100, Eigen::Array3d(0.2, 0.3, 0.1).log());
  EXPECT_EQ(findMaterials(one, 0).logColour.size(), 1u);
}

}  // namespace
}  // namespace patina
