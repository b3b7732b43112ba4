#include "engine/twoshot/cluster.h"

#include <gtest/gtest.h>

#include <cmath>

#include "devices/simulated/two_shot_rig.h"
#include "engine/brdf/neural_brdf.h"
#include "tests/base/temp_folder.h"
#include "tests/test_data.h"

namespace patina {
namespace {

/// Pixels that may take another label than the truth: those on borders, which the simulator mixes.
constexpr double kMostWrong = 0.01;

MaterialMap clusterBundle(const std::filesystem::path& folder, int count, LoadedCapture* loaded = nullptr) {
  auto capture = readTwoShotCapture(folder);
  if (!capture) throw std::runtime_error(capture.error().sentence());
  auto shots = loadFittedShots(*capture, {});
  if (!shots) throw std::runtime_error(shots.error().sentence());
  MaterialMap map = clusterMaterials(*capture, shots->pictures, count, {});
  if (loaded) *loaded = std::move(*shots);
  return map;
}

TEST(Clusters, SharedHomogeneousSamplesAreOne) {
  PATINA_NEEDS_SHARED("two-shot");
  for (const char* name :
       {"clean_alum_bronze", "clean_pink_jasper", "measured_cc_ibiza", "measured_colodur_azure",
        "measured_felt_pink", "measured_satin_purple", "unknown_4"}) {
    EXPECT_EQ(clusterBundle(test::sharedData() / "two-shot" / name, 0).count, 1) << name;
  }
}

TEST(Clusters, SharedPairOfMaterialsIsTwo) {
  PATINA_NEEDS_SHARED("two-shot");
  const MaterialMap map = clusterBundle(test::sharedData() / "two-shot/fixed_camera_two_materials", 0);
  EXPECT_EQ(map.count, 2);
}

/// Three plastics in blobs of a few millimetres.
TwoShotScene threeMaterials() {
  TwoShotScene scene;
  scene.name = "three";
  const std::vector<std::string>& names = builtInNeuralNames();
  for (const char* name : {"blue-rubber", "red-plastic", "white-diffuse-bball"}) {
    const auto at = std::find(names.begin(), names.end(), name) - names.begin();
    scene.brdfs.push_back(builtInNeuralBrdfs().at(at));
  }
  scene.labels = Image(40, 40, 1);
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 40; ++x) scene.labels.at(x, y) = static_cast<float>((x / 5 + 2 * (y / 5)) % 3);
  scene.pixels = 128;
  scene.samplesPerPixelSide = 2;
  const ShotDirections mirror = shotFromHalfDiff({0.1, 0.7, 1.5});
  ShotDirections diffuse = mirror;
  diffuse.toLight = Eigen::Vector3d(0.1, 0.5, 0.86).normalized();
  scene.poses = {{mirror, {1.0}, false}, {diffuse, {1.0}, false}};
  return scene;
}

TEST(Clusters, ThreeMaterialsAreFoundAndLabelledWhereTheyAre) {
  test::TempFolder folder;
  const TwoShotScene scene = threeMaterials();
  ASSERT_TRUE(simulateTwoShot(scene, folder / "b", {}).ok());
  LoadedCapture loaded;
  const MaterialMap map = clusterBundle(folder / "b", 0, &loaded);
  ASSERT_EQ(map.count, 3);
  // Labels are named by size; the truth's name of each is found by counting.
  const SampleView& view = loaded.pictures.front().view;
  const std::vector<std::int8_t> labels = map.labelsFor(view, true);
  std::array<std::array<int, 3>, 3> together{};
  int total = 0;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (labels[i] < 0) continue;
    const double r = scene.radiusMm();
    const int x = static_cast<int>((view.positionMm[i].x() + r) / (2 * r) * 40),
              y = static_cast<int>((r - view.positionMm[i].y()) / (2 * r) * 40);
    ++together[labels[i]][static_cast<int>(scene.labels.at(std::clamp(x, 0, 39), std::clamp(y, 0, 39)))];
    ++total;
  }
  int right = 0;
  for (const auto& row : together) right += *std::max_element(row.begin(), row.end());
  ASSERT_GT(total, 1000);
  EXPECT_GE(right, (1 - kMostWrong) * total);
}

TEST(Clusters, SameInputGivesTheSameLabels) {
  test::TempFolder folder;
  ASSERT_TRUE(simulateTwoShot(threeMaterials(), folder / "b", {}).ok());
  EXPECT_EQ(clusterBundle(folder / "b", 3).label, clusterBundle(folder / "b", 3).label);
}

}  // namespace
}  // namespace patina
