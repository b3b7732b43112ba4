#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "devices/simulated/two_shot_rig.h"
#include "engine/brdf/brdf_file.h"
#include "engine/brdf/neural_brdf.h"
#include "tests/test_data.h"

namespace patina::test {

/// A simulated two-shot capture drawn at random: material, directions, noise, and one effect or none.
struct TwoShotDraw {
  TwoShotScene scene;
  std::string effect;  ///< id; empty: none
  int leftOut = -1;    ///< index of the material in the built-in basis, to be left out of it; -1: not of it
  std::string material;
};

/// `effect` empty: a clean one. Measured materials of the shared data are used for every third draw where
/// they are there.
inline TwoShotDraw drawTwoShot(unsigned seed, const std::string& effect, double scale = 1) {
  std::mt19937_64 random(seed * 7919u + 17u);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * (static_cast<double>(random() >> 11) * 0x1p-53);
  };
  TwoShotDraw draw;
  draw.effect = effect;
  BrdfPtr material;
  const auto folder = sharedData() / "measured" / "rgl";
  std::error_code ignored;
  if (seed % 3 == 0 && std::filesystem::exists(folder, ignored)) {
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    const auto read = readBrdf(files[random() % files.size()]);
    if (read) material = *read;
  }
  if (!material) {
    draw.leftOut = static_cast<int>(random() % builtInNeuralBrdfs().size());
    material = builtInNeuralBrdfs()[static_cast<std::size_t>(draw.leftOut)];
  }
  draw.material = material->origin().name;
  constexpr double kDegree = std::numbers::pi / 180;
  const auto pose = [&](double h, double d, double p, bool holdout) {
    const auto jitter = [&](double deg) { return deg + uniform(-2, 2); };
    TwoShotPose made;
    made.directions =
        shotFromHalfDiff({std::abs(jitter(h)) * kDegree, jitter(d) * kDegree, jitter(p) * kDegree});
    // Each at its own azimuth, as a person would turn the sample.
    const double turn = uniform(0, 2 * std::numbers::pi);
    const Eigen::Matrix3d about = Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    made.directions.toLight = about * made.directions.toLight;
    made.directions.toCamera = about * made.directions.toCamera;
    made.holdout = holdout;
    return made;
  };
  TwoShotScene& scene = draw.scene;
  scene.name = "drawn";
  scene.pixels = 100;
  scene.samplesPerPixelSide = 2;
  scene.poses = {pose(6, 15, 37.5, false), pose(16, 65, 89, false), pose(42, 25, 60, false),
                 pose(4, 45, 90, true),    pose(25, 30, 20, true),  pose(35, 45, 50, true)};
  if (effect == "retroreflection") scene.poses.push_back(pose(30, 3, 60, false));
  scene.noise.shot = std::exp(uniform(std::log(5e-6), std::log(1e-4)));
  scene.noise.read = std::exp(uniform(std::log(5e-5), std::log(4e-4)));
  scene.effects.surroundings = seed % 2 == 0 ? 0.002 : 0;
  if (!effect.empty()) drawEffect(effect, scale, random, scene.poses.size(), scene.effects, material);
  scene.brdfs = {material};
  return draw;
}

}  // namespace patina::test
