#include "devices/simulated/two_shot_rig.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

#include "devices/simulated/bundle_folder.h"
#include "engine/capture/two_shot_capture.h"
#include "engine/image/exr.h"

namespace patina {
namespace {

namespace fs = std::filesystem;

constexpr double kPi = std::numbers::pi;
constexpr double kFilled = 0.94;        // of the picture's half side that the sample may reach
constexpr double kTileLevel = 2.0 / 3;  // of full scale

double secondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Error cancelledError() {
  return Error{ErrorCode::Cancelled, "the simulated capture was stopped", "", ""};
}

/// The sample's rim, mm.
std::vector<Eigen::Vector3d> rim(const TwoShotScene& scene) {
  std::vector<Eigen::Vector3d> points;
  if (scene.disc()) {
    constexpr int kPoints = 180;
    for (int i = 0; i < kPoints; ++i) {
      const double angle = 2 * kPi * i / kPoints;
      points.emplace_back(scene.radiusMm() * std::cos(angle), scene.radiusMm() * std::sin(angle), 0);
    }
  } else {
    for (double x : {-0.5, 0.5})
      for (double y : {-0.5, 0.5}) points.emplace_back(x * scene.widthMm, y * scene.heightMm, 0);
  }
  return points;
}

/// A camera without a lens: its pose, unit focal length.
Camera posed(const TwoShotScene& scene, const Eigen::Vector3d& toCamera) {
  Camera camera;
  camera.width = camera.height = scene.pixels;
  const Eigen::Vector3d forward = -toCamera.normalized();
  // Up in the picture is away from the surface; straight above it, +y. (1e-6: below, the azimuth is
  // rounding.)
  const bool above = std::hypot(forward.x(), forward.y()) < 1e-6;
  const Eigen::Vector3d up = above ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d right = forward.cross(up).normalized();
  Eigen::Matrix3d rotation;
  rotation << right.transpose(), forward.cross(right).transpose(), forward.transpose();
  camera.cameraFromWorld =
      Eigen::AngleAxisd(scene.rollDeg * kPi / 180, Eigen::Vector3d::UnitZ()).toRotationMatrix() * rotation;
  camera.translationMm = -camera.cameraFromWorld * (toCamera.normalized() * scene.distanceMm);
  return camera;
}

/// One focal length for all poses: the sample nearly fills the picture where it looks largest.
double focalPixels(const TwoShotScene& scene) {
  double reach = 0;  // at focal length 1
  for (const TwoShotPose& pose : scene.poses) {
    Camera camera = posed(scene, pose.directions.toCamera);
    camera.distortion = scene.distortion;
    for (const Eigen::Vector3d& point : rim(scene))
      if (const auto at = camera.pixelFromWorld(point)) reach = std::max(reach, at->cwiseAbs().maxCoeff());
  }
  return reach > 0 ? kFilled * 0.5 * (scene.pixels - 1) / reach : scene.pixels;
}

Camera withLens(const TwoShotScene& scene, const Eigen::Vector3d& toCamera, double focal) {
  Camera camera = posed(scene, toCamera);
  const double middle = 0.5 * (scene.pixels - 1);
  camera.intrinsics << focal, 0, middle, 0, focal, middle, 0, 0, 1;
  camera.distortion = scene.distortion;
  return camera;
}

const Brdf* brdfAt(const TwoShotScene& scene, double xMm, double yMm) {
  if (scene.labels.empty()) return scene.brdfs[0].get();
  const double width = scene.disc() ? 2 * scene.radiusMm() : scene.widthMm;
  const double height = scene.disc() ? 2 * scene.radiusMm() : scene.heightMm;
  const auto texel = [](double share, int count) {
    return std::clamp(static_cast<int>(std::floor(share * count)), 0, count - 1);
  };
  const float label = scene.labels.at(texel(xMm / width + 0.5, scene.labels.width()),
                                      texel(0.5 - yMm / height, scene.labels.height()));
  return scene.brdfs[static_cast<std::size_t>(std::lround(label))].get();
}

bool onSample(const TwoShotScene& scene, double xMm, double yMm, double scale) {
  if (scene.disc()) return std::hypot(xMm, yMm) <= scale * scene.radiusMm();
  return std::abs(xMm) <= scale * scene.widthMm / 2 && std::abs(yMm) <= scale * scene.heightMm / 2;
}

}  // namespace

double TwoShotScene::radiusMm() const {
  return distanceMm * std::tan(fovDeg * kPi / 360);
}

std::vector<std::string> TwoShotScene::validate() const {
  std::vector<std::string> problems;
  const auto need = [&](bool good, std::string sentence) {
    if (!good) problems.push_back(std::move(sentence));
  };
  need(!brdfs.empty(), "the sample has no BRDF");
  for (const BrdfPtr& brdf : brdfs) need(brdf != nullptr, "one of the sample's BRDFs is missing");
  need(labels.empty() || labels.channels() == 1, "labels must have one channel");
  if (labels.channels() == 1)
    need(std::ranges::all_of(labels.samples(),
                             [&](float label) {
                               return label >= 0 && label == std::floor(label) &&
                                      label < static_cast<float>(brdfs.size());
                             }),
         "every label must be the index of one of the BRDFs");
  need(distanceMm > 0, "the camera's distance must be positive millimetres");
  need(!disc() || (fovDeg > 0 && fovDeg < 150),
       "the disc's field of view must lie between 0 and 150 degrees");
  need(pixels >= 4 && pixels <= 16384, "the camera must have 4 to 16384 pixels a side");
  need(samplesPerPixelSide >= 1 && samplesPerPixelSide <= 16, "samplesPerPixelSide must lie in 1 to 16");
  need(vignetting >= 0 && vignetting < 1, "vignetting must lie in 0 to 1, without 1");
  need((irradiance.array() > 0).all(), "the light's irradiance must be positive");
  need((whiteReflectance.array() > 0).all() && (whiteReflectance.array() <= 1).all(),
       "the white tile's reflectance must lie above 0 and be at most 1");
  need(tileExcess >= 1, "the white tile must be at least as large as the sample");
  need(noise.shot >= 0 && noise.read >= 0 && fullScale >= 0, "noise and full scale can't be negative");
  need(std::ranges::any_of(poses, [](const TwoShotPose& pose) { return !pose.holdout; }),
       "there is no photograph that a fit may read");
  need(!declareIrradiance || vignetting == 0,
       "a lens that loses light in the corners needs the white tile: declared irradiance can't say it");
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const std::string pose = "pose " + std::to_string(i) + ": ";
    const ShotDirections& directions = poses[i].directions;
    for (const auto& [what, to] : {std::pair{"light", &directions.toLight}, {"camera", &directions.toCamera}})
      // 1e-6: what a direction typed with 7 digits misses of unit length
      need(std::abs(to->norm() - 1) < 1e-6 && to->z() > 0,
           pose + "the " + what + "'s direction must be a unit vector above the sample");
    need(!poses[i].exposuresS.empty() &&
             std::ranges::all_of(poses[i].exposuresS, [](double s) { return s > 0 && std::isfinite(s); }),
         pose + "it needs at least one exposure time, all of them positive");
    if (!disc() || distanceMm <= 0) continue;
    // The camera must lie above the plane of every point that it looks at, and not inside the sample's
    // circle.
    need(directions.toCamera.z() * distanceMm > 1e-3 * distanceMm, pose + "the camera grazes the sample");
  }
  return problems;
}

Camera twoShotCamera(const TwoShotScene& scene, const ShotDirections& directions) {
  return withLens(scene, directions.toCamera, focalPixels(scene));
}

Result<Image> exposeTwoShot(const TwoShotScene& scene, const ShotDirections& directions, bool tile,
                            const JobContext& job, std::size_t* unknownRays) {
  const Camera camera = twoShotCamera(scene, directions);
  const Eigen::Vector3d eye = camera.positionMm();
  const Eigen::Array3d white = scene.whiteReflectance.array() / kPi;
  const double scale = tile ? scene.tileExcess : 1.0;
  const int side = scene.samplesPerPixelSide;
  const double middle = 0.5 * (scene.pixels - 1), corner = 2 * middle * middle;
  Image image(scene.pixels, scene.pixels, 3);
  std::atomic<std::size_t> unknown{0};
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  arena.execute([&] {
    tbb::parallel_for(0, scene.pixels, [&](int y) {
      for (int x = 0; x < scene.pixels; ++x) {
        if (job.cancelled()) return;
        Eigen::Array3d sum = Eigen::Array3d::Zero();
        int known = 0;
        for (int j = 0; j < side; ++j)
          for (int i = 0; i < side; ++i) {
            const Eigen::Vector2d at(x + (i + 0.5) / side - 0.5, y + (j + 0.5) / side - 0.5);
            const auto point = camera.samplePlaneFromPixel(at);
            if (!point || !onSample(scene, point->x(), point->y(), scale)) {
              sum += scene.effects.surroundings;  // as bright whatever lies in their middle
              ++known;
              continue;
            }
            const LampAtPoint lamp = lampAt(scene.effects, directions.toLight, eye, *point, tile);
            const Eigen::Array3d brdf =
                tile ? white : brdfAt(scene, point->x(), point->y())->evaluate(lamp.toLight, lamp.toView);
            if (!brdf.isFinite().all()) {
              ++unknown;
              continue;
            }
            sum += brdf * lamp.cosineGain;
            ++known;
          }
        if (known == 0) continue;
        const double fromAxis = Eigen::Vector2d(x - middle, y - middle).squaredNorm() / corner;
        const double gain = (1 - scene.vignetting * fromAxis) / known;
        for (int c = 0; c < 3; ++c)
          image.at(x, y, c) = static_cast<float>(sum[c] * gain * scene.irradiance[c]);
      }
    });
  });
  if (job.cancelled()) return cancelledError();
  if (unknownRays) *unknownRays += unknown;
  return image;
}

Result<TwoShotSimulationReport> simulateTwoShot(const TwoShotScene& scene, const fs::path& folder,
                                                const JobContext& job) {
  const std::vector<std::string> problems = scene.validate();
  if (!problems.empty()) {
    std::string all;
    for (const std::string& problem : problems) all += (all.empty() ? "" : "; ") + problem;
    return Error{ErrorCode::Invalid, "the simulated capture can't be taken: " + all, scene.name,
                 "correct these values"};
  }
  Result<BundleFolder> bundle = BundleFolder::create(folder);
  if (!bundle) return bundle.error();

  TwoShotSimulationReport report;
  const auto start = std::chrono::steady_clock::now();
  std::vector<Image> perSecond;
  const auto poses = static_cast<std::int64_t>(scene.poses.size());
  double brightest = 0, level = 0;
  const double focalOfAll = focalPixels(scene);
  std::vector<std::vector<char>> shown;
  for (const TwoShotPose& pose : scene.poses) {
    job.progress("expose", static_cast<std::int64_t>(perSecond.size()), poses, "poses");
    Result<Image> image = exposeTwoShot(scene, pose.directions, false, job, &report.unknownRays);
    if (!image) return image.error();
    const double longest = *std::ranges::max_element(pose.exposuresS);
    for (float sample : image->samples()) brightest = std::max(brightest, longest * sample);
    std::vector<char> onIt(image->pixelCount(), 0);
    const Camera camera = withLens(scene, pose.directions.toCamera, focalOfAll);
    double sum = 0, count = 0;
    for (int y = 0; y < image->height(); ++y)
      for (int x = 0; x < image->width(); ++x) {
        const auto point = camera.samplePlaneFromPixel({x, y});
        const std::size_t i = static_cast<std::size_t>(y) * image->width() + x;
        onIt[i] = point && onSample(scene, point->x(), point->y(), 1.0);
        if (onIt[i]) sum += image->at(x, y, 1), ++count;
      }
    level += sum / std::max(count, 1.0) / static_cast<double>(scene.poses.size());
    shown.push_back(std::move(onIt));
    perSecond.push_back(std::move(*image));
  }
  job.progress("expose", poses, poses, "poses");
  report.fullScale = scene.fullScale > 0 ? scene.fullScale : 1.1 * brightest;
  if (report.fullScale <= 0) report.fullScale = 1;  // a black sample: any scale will do
  if (scene.effects.clipShare > 0) report.fullScale = scene.effects.clipShare * brightest;
  report.seconds["expose"] = secondsSince(start);

  const auto writing = std::chrono::steady_clock::now();
  TwoShotCapture capture;
  capture.folder = bundle->path();
  capture.disc = scene.disc();
  capture.radiusMm = scene.disc() ? scene.radiusMm() : 0;
  capture.widthMm = scene.disc() ? 0 : scene.widthMm;
  capture.heightMm = scene.disc() ? 0 : scene.heightMm;
  capture.sampleName = scene.name;
  capture.madeBy = kMadeBySimulatedRig;
  capture.whiteReflectance = scene.whiteReflectance;
  if (scene.withNoise && scene.statesSaturation && !(scene.effects.clipShare > 0))
    capture.saturation = report.fullScale;

  std::uint64_t photoIndex = 0;
  const auto take = [&](const Image& oneSecond, double exposureS, const std::string& file,
                        const std::size_t* pose) -> Status {
    Image photo = oneSecond;
    for (float& sample : photo.samples()) sample = static_cast<float>(sample * exposureS);
    if (pose && scene.effects.any())
      distortPhoto(scene.effects, *pose, shown[*pose], level, report.fullScale, photo);
    if (scene.withNoise)
      report.clippedSamples += senseInPlace(photo, scene.noise, report.fullScale, job.seed, photoIndex);
    ++photoIndex;
    ++report.photos;
    return writeExr(bundle->path() / file, photo, {"R", "G", "B"}, {{"units", "pixel units of the sensor"}},
                    scene.halfFloats);
  };
  const auto named = [](const char* what, std::size_t index) {
    char name[32];
    std::snprintf(name, sizeof name, "%s_%03zu.exr", what, index);
    return std::string(name);
  };
  const double focal = focalPixels(scene);
  for (std::size_t p = 0; p < scene.poses.size(); ++p) {
    const TwoShotPose& pose = scene.poses[p];
    TwoShotPhoto photo;
    photo.camera = withLens(scene, pose.directions.toCamera, focal);
    photo.toLight = pose.directions.toLight;
    photo.holdout = pose.holdout;
    if (scene.declareIrradiance) photo.normalIrradiance = scene.irradiance;
    for (double exposureS : pose.exposuresS) {
      if (job.cancelled()) return cancelledError();
      photo.file = named("shot", capture.shots.size());
      photo.exposureS = exposureS;
      if (const Status taken = take(perSecond[p], exposureS, photo.file, &p); !taken) return taken.error();
      capture.shots.push_back(photo);
    }
    if (scene.declareIrradiance) continue;
    const Result<Image> tile = exposeTwoShot(scene, pose.directions, true, job);
    if (!tile) return tile.error();
    double brightestTile = 0;
    for (float sample : tile->samples()) brightestTile = std::max<double>(brightestTile, sample);
    photo.holdout = false;
    photo.file = named("white", p);
    photo.exposureS = kTileLevel * report.fullScale / brightestTile;
    if (const Status taken = take(*tile, photo.exposureS, photo.file, nullptr); !taken) return taken.error();
    capture.whiteShots.push_back(photo);
  }
  if (const Status written = writeTwoShotCapture(capture); !written) return written.error();
  if (const Status moved = bundle->commit(); !moved) return moved.error();
  report.seconds["write"] = secondsSince(writing);
  return report;
}

}  // namespace patina
