#include "app/cli/capture_two_shot.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <random>

#include "devices/simulated/live_rig.h"
#include "engine/acquire/two_shot_guide.h"
#include "engine/acquire/two_shot_session.h"
#include "engine/twoshot/basis.h"

namespace patina::cli {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kFovDeg = 25;
constexpr double kSampleShare = 0.4;               ///< the disc's radius over the sheet's side
constexpr double kAimDeg = 0.8, kAimMm = 3;        ///< how far beside the plan the simulated operator stops
constexpr double kPoseDeg = 0.01, kPoseMm = 0.05;  ///< what the simulated markers get wrong

/// Two shots that tolerate an operator. Source: two-shot-model of the project, "Real, unseen materials": the
/// pair planned over directions that can be trusted.
std::vector<PlannedShot> defaultShots() {
  std::vector<PlannedShot> shots;
  for (const HalfDiffAngles& angles : {HalfDiffAngles{6 * kDegree, 15 * kDegree, 37.5 * kDegree},
                                       HalfDiffAngles{16 * kDegree, 67 * kDegree, 89 * kDegree}})
    shots.push_back({shotFromHalfDiff(angles), angles});
  return shots;
}

Eigen::Vector3d beside(const Eigen::Vector3d& direction, double degrees, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const Eigen::Vector3d axis =
      direction.cross(Eigen::Vector3d(normal(random), normal(random), normal(random))).normalized();
  return Eigen::AngleAxisd(degrees * kDegree, axis) * direction;
}

}  // namespace

int runTwoShotCapture(const TwoShotCaptureArguments& arguments, Context& context) {
  LiveRigProvider provider;
  const Result<std::shared_ptr<LiveRig>> found = provider.rig(arguments.camera);
  if (!found) return context.fail(found.error());
  LiveRig& rig = **found;
  TwoShotSetup setup;
  setup.shots = defaultShots();
  if (!arguments.plan.empty()) {
    const Result<Plan> plan = readPlan(arguments.plan);
    if (!plan) return context.fail(plan.error());
    setup.shots = plan->shots;
  }
  const RigDescription description = rig.description();
  setup.radiusMm = kSampleShare * std::min(description.sampleWidthMm, description.sampleHeightMm);
  setup.distanceMm = setup.radiusMm / std::tan(0.5 * kFovDeg * kDegree);
  setup.sampleName = description.sampleName;
  setup.whiteReflectance = whiteTileReflectance().matrix();
  const Result<BasisPtr> basis = basisFor("", context.job());
  if (!basis) return context.fail(basis.error());
  setup.basis = *basis;
  Result<std::unique_ptr<TwoShotSession>> opened =
      TwoShotSession::open(arguments.out, setup, arguments.resume);
  if (!opened) return context.fail(opened.error());
  TwoShotSession& session = **opened;
  Result<std::unique_ptr<CameraDevice>> camera = rig.openCamera();
  if (!camera) return context.fail(camera.error());
  const std::unique_ptr<PoseSource> poses = rig.poses(kPoseDeg, kPoseMm);
  const Camera lens = rig.camera();
  // A lamp that fills half of the sensor from the tile in a tenth of a second.
  const Eigen::Array3d irradiance =
      Eigen::Array3d(1.0, 0.9, 0.75) * (5 * std::numbers::pi * description.radianceOfFullScaleSecond);

  while (session.step() != TwoShotStep::Done) {
    if (context.stop.stop_requested()) {
      context.console.complain("Cancelled: what is finished is in " + arguments.out +
                               ". Go on with: the same command and --resume.");
      return kCancelled;
    }
    const auto index = static_cast<std::size_t>(session.shot());
    const ShotDirections& planned = setup.shots[index].directions;
    // Where this operator would stop: the same place each time that the capture is gone on with.
    std::mt19937_64 random(1 + index);
    const Eigen::Vector3d toCamera = beside(planned.toCamera, kAimDeg, random),
                          toLight = beside(planned.toLight, kAimDeg, random);
    Camera stand = lookingAtCentre(toCamera, setup.distanceMm + kAimMm);
    stand.width = lens.width;
    stand.height = lens.height;
    const double focal =
        0.42 * std::min(lens.width, lens.height) * (setup.distanceMm - setup.radiusMm) / setup.radiusMm;
    stand.intrinsics << focal, 0, 0.5 * (lens.width - 1), 0, focal, 0.5 * (lens.height - 1), 0, 0, 1;
    rig.moveCamera(stand);
    rig.light(LiveLamp{toLight, irradiance});
    const std::string shot = "Shot " + std::to_string(index + 1);
    Status done = Done{};
    switch (session.step()) {
      case TwoShotStep::PlaceCamera: {
        const CameraGuide far = session.guideCamera([&] {
          Camera start = lookingAtCentre(beside(planned.toCamera, 6, random), setup.distanceMm + 25);
          start.width = stand.width;
          start.height = stand.height;
          start.intrinsics = stand.intrinsics;
          return start;
        }());
        context.console.say(shot + ", camera: " + far.sentence);
        const CameraGuide guide = session.guideCamera(stand);
        char line[200];
        std::snprintf(line, sizeof line,
                      "%s, camera: %.1f degrees off; expected error %.3f ln, planned %.3f.", shot.c_str(),
                      guide.offDeg, guide.errorNow, guide.plannedError);
        context.console.say(line);
        done = session.placeCamera(stand, false);
        break;
      }
      case TwoShotStep::PlaceLight: {
        const LightGuide guide = session.guideLight(toLight);
        context.console.say(shot + ", light: " + guide.sentence);
        done = session.placeLight(toLight, false);
        break;
      }
      case TwoShotStep::PhotographSample:
        rig.put(OnTable::Sheet);
        done = session.photograph(**camera, poses.get(), context.job());
        break;
      case TwoShotStep::PlaceTile:
        done = session.tilePlaced();
        break;
      case TwoShotStep::PhotographTile:
        rig.put(OnTable::WhiteTile);
        done = session.photograph(**camera, poses.get(), context.job());
        break;
      case TwoShotStep::Done:
        break;
    }
    if (!done) return context.fail(done.error());
  }
  context.console.finishProgress();
  const TwoShotCapture capture = session.capture();
  context.console.say(std::to_string(capture.shots.size()) + " photographs of the sample, " +
                      std::to_string(capture.whiteShots.size()) +
                      " of the tile. Reconstruct with: patina-cli fit " + arguments.out + " --out DIR");
  return kDone;
}

}  // namespace patina::cli
