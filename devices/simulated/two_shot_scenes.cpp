#include "devices/simulated/two_shot_scenes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/base/text.h"
#include "engine/twoshot/basis.h"

namespace patina {

namespace {

constexpr double kRad = std::numbers::pi / 180;

struct Entry {
  const char* name;
  const char* summary;
  std::vector<const char*> materials;  ///< of the built-in hundred; two: side by side on a sheet
};

const std::vector<Entry>& entries() {
  static const std::vector<Entry> list{
      {"plastic-disc", "A disc of red plastic: three shots, two held out", {"red-plastic"}},
      {"bronze-disc", "A disc of alum bronze: three shots, two held out", {"alum-bronze"}},
      {"two-paints",
       "A sheet of two paints under one camera: three lights, two held out",
       {"blue-acrylic", "yellow-matte-plastic"}}};
  return list;
}

TwoShotPose pose(double thetaHDeg, double thetaDDeg, double phiDDeg, bool holdout) {
  TwoShotPose made;
  made.directions = shotFromHalfDiff({thetaHDeg * kRad, thetaDDeg * kRad, phiDDeg * kRad});
  made.holdout = holdout;
  return made;
}

Eigen::Vector3d direction(double zenithDeg, double azimuthDeg) {
  return {std::sin(zenithDeg * kRad) * std::cos(azimuthDeg * kRad),
          std::sin(zenithDeg * kRad) * std::sin(azimuthDeg * kRad), std::cos(zenithDeg * kRad)};
}

/// One camera at 50 degrees; lights near the mirror direction, to the side, and near the normal.
void makeSheet(TwoShotScene& scene) {
  scene.widthMm = 110;
  scene.heightMm = 80;
  scene.poses.clear();
  struct Light {
    double zenithDeg, azimuthDeg;
    bool holdout;
  };
  for (const Light& light : {Light{46, 180, false}, Light{44, 97, false}, Light{15, 20, false},
                             Light{33, 150, true}, Light{58, 60, true}}) {
    TwoShotPose made;
    made.directions = {direction(light.zenithDeg, light.azimuthDeg), direction(50, 0)};
    made.holdout = light.holdout;
    scene.poses.push_back(made);
  }
  constexpr int kWidth = 88, kHeight = 64;
  scene.labels = Image(kWidth, kHeight, 1);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)  // a wavy border between the two
      scene.labels.at(x, y) = x + 6 * std::sin(y * 0.2) > kWidth / 2.0 ? 1.0f : 0.0f;
}

}  // namespace

std::vector<std::string> twoShotSceneNames() {
  std::vector<std::string> names;
  for (const Entry& entry : entries()) names.emplace_back(entry.name);
  return names;
}

std::string twoShotSceneSummary(const std::string& name) {
  for (const Entry& entry : entries())
    if (name == entry.name) return entry.summary;
  return {};
}

Result<TwoShotScene> twoShotScene(const std::string& name) {
  const auto entry =
      std::find_if(entries().begin(), entries().end(), [&](const Entry& one) { return name == one.name; });
  if (entry == entries().end()) {
    std::string names;
    for (const std::string& one : twoShotSceneNames()) names += (names.empty() ? "" : ", ") + one;
    return Error{ErrorCode::NotFound, "there is no simulated sample " + inQuotes(name), "",
                 "one of: " + names};
  }
  TwoShotScene scene;
  scene.name = name;
  for (const char* wanted : entry->materials) {
    const auto& materials = builtInMaterials();
    const auto found = std::find_if(materials.begin(), materials.end(),
                                    [&](const BrdfPtr& brdf) { return brdf->origin().name == wanted; });
    if (found == materials.end())  // a slip in the table above
      return Error{ErrorCode::NotFound, std::string("there is no built-in material ") + wanted, name, ""};
    scene.brdfs.push_back(*found);
  }
  scene.poses = {pose(6, 15, 37.5, false), pose(16, 67, 89, false), pose(42, 25, 60, false),
                 pose(3, 45, 90, true), pose(25, 30, 20, true)};
  if (entry->materials.size() > 1) makeSheet(scene);
  return scene;
}

}  // namespace patina
