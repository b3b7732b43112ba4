#include "tests/ui/two_shot_fake.h"

#include <gtest/gtest.h>

#include <QElapsedTimer>
#include <thread>

#include "devices/simulated/two_shot_rig.h"
#include "engine/brdf/analytic_brdf.h"
#include "widgets/shot_entry.h"

namespace patina::test {

namespace {

BrdfPtr paint(double red, double alpha) {
  AnalyticBrdfParameters parameters;
  parameters.diffuse = {red, 0.2, 0.1};
  parameters.specular.setConstant(0.05);
  parameters.alphaX = parameters.alphaY = alpha;
  return makeAnalyticBrdf("ggx", parameters).value();
}

/// On the MERL grid; made once, it takes a moment.
std::shared_ptr<const TabulatedBrdf> table(int material) {
  static const std::array<std::shared_ptr<const TabulatedBrdf>, 2> made{tabulate(*paint(0.5, 0.15)).value(),
                                                                        tabulate(*paint(0.05, 0.4)).value()};
  return made[static_cast<std::size_t>(material % 2)];
}

/// False where the job was stopped.
bool busyFor(int milliseconds, const JobContext& job, const char* stage) {
  QElapsedTimer timer;
  timer.start();
  while (timer.elapsed() < milliseconds) {
    if (job.cancelled()) return false;
    job.progress(stage, timer.elapsed(), milliseconds, "photos");
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return !job.cancelled();
}

}  // namespace

void simulateTwoShotBundle(const std::filesystem::path& folder, int pixels, bool sheet) {
  constexpr double kRad = 3.14159265358979323846 / 180;
  TwoShotScene scene;
  scene.name = "paint";
  scene.brdfs = {paint(0.5, 0.15)};
  scene.pixels = pixels;
  scene.samplesPerPixelSide = 2;
  const auto pose = [&](double thetaH, double thetaD, double phiD, bool holdout) {
    TwoShotPose made;
    made.directions = shotFromHalfDiff({thetaH * kRad, thetaD * kRad, phiD * kRad});
    made.holdout = holdout;
    scene.poses.push_back(made);
  };
  if (sheet) {
    scene.widthMm = 110;
    scene.heightMm = 80;
    scene.brdfs.push_back(paint(0.05, 0.4));
    scene.labels = Image(2, 1, 1);
    scene.labels.at(1, 0) = 1;
  }
  pose(6, 38, 90, false);
  pose(16, 70, 90, false);
  pose(20, 30, 45, true);
  const auto report = simulateTwoShot(scene, folder, {});
  ASSERT_TRUE(report.ok()) << (report.ok() ? "" : report.error().sentence());
}

std::shared_ptr<const TwoShotFit> fakeTwoShotFit(const TwoShotCapture& capture,
                                                 const TwoShotFitOptions& options, int materials,
                                                 bool cancelled) {
  auto fit = std::make_shared<TwoShotFit>();
  fit->capture = capture;
  fit->options = options;
  for (int i = 0; i < materials; ++i) {
    TwoShotMaterial material;
    material.brdf = table(i);
    material.posteriorSd = std::make_shared<const std::vector<float>>(MerlGrid::kCells, 0.2f);
    material.priorSd = 1;
    material.eta.setConstant(40);
    material.expected.training = 0.19;
    material.expected.unseen = 0.22;
    material.expected.unseenWorstTenth = 0.4;
    material.share = 1.0 / materials;
    fit->materials.push_back(material);
  }
  for (const bool holdout : {false, true})
    for (const TwoShotPhoto& shot : capture.shots) {
      if (shot.holdout != holdout) continue;
      auto photo = readPhoto(capture, shot);
      EXPECT_TRUE(photo.ok());
      if (!photo) continue;
      TwoShotComparison comparison;
      comparison.file = shot.file;
      comparison.holdout = holdout;
      comparison.centre = directionsOf(shot).centre();
      comparison.rms = holdout ? 0.2 : 0.1;
      comparison.noiseFloor = 0.01;
      comparison.captured = std::move(*photo);
      for (int y = 0; y < comparison.captured.height(); ++y)
        for (int x = 0; x < comparison.captured.width(); ++x)
          if (!anglesAtPixel(capture, shot, x, y))
            for (float& value : comparison.captured.pixel(x, y)) value = 0;
      comparison.rendered = comparison.captured;
      for (float& value : comparison.rendered.samples()) value *= 1.2f;
      fit->comparisons.push_back(std::move(comparison));
    }
  if (materials > 1 && !fit->comparisons.empty()) {
    const Image& first = fit->comparisons.front().captured;
    fit->labels = Image(first.width(), first.height(), 1, -1.0f);
    for (int y = 0; y < first.height(); ++y)
      for (int x = 0; x < first.width(); ++x)
        if (first.at(x, y) > 0) fit->labels.at(x, y) = x < first.width() / 2 ? 0.0f : 1.0f;
  }
  fit->stats.seconds = {{"read", 0.1}, {"solve", 0.2}, {"posterior", 0.2}, {"predict", 0.1}, {"total", 0.6}};
  fit->stats.fitRms = 0.1;
  fit->stats.holdoutRms = 0.2;
  fit->stats.noiseFloorFit = 0.01;
  fit->stats.noiseFloorHoldout = 0.01;
  fit->stats.pixels = 3000;
  fit->stats.rows = 2000;
  fit->stats.clippedPixels = 17;
  fit->stats.remarks = {"A third shot away from the highlight would help most."};
  fit->stats.cancelled = cancelled;
  return fit;
}

Services fakeTwoShotServices(int delayMs, int materials) {
  Services services = Services::engine();
  services.fitTwoShot = [=](const TwoShotCapture& capture, const std::filesystem::path&,
                            const TwoShotFitOptions& options,
                            const JobContext& job) -> Result<Services::TwoShotFitPtr> {
    if (!busyFor(delayMs, job, "solve")) return Error{ErrorCode::Cancelled, "cancelled", "", ""};
    return fakeTwoShotFit(capture, options, materials);
  };
  services.plan = [=](const std::filesystem::path&, const PlanOptions& options,
                      const JobContext& job) -> Result<Plan> {
    constexpr double kRad = 3.14159265358979323846 / 180;
    const bool finished = busyFor(delayMs, job, "search");
    Plan plan;
    plan.options = options;
    plan.cancelled = !finished;
    for (const ShotDirections& given : options.given) plan.shots.push_back({given, given.centre()});
    for (int i = 0; i < options.shots; ++i) {
      const HalfDiffAngles angles{(6 + 9 * i) * kRad, (38 + 14 * i) * kRad, (89 - 12 * i) * kRad};
      plan.shots.push_back({shotFromHalfDiff(angles), angles});
    }
    plan.expected.training = 0.194;
    plan.expected.unseen = 0.207;
    plan.expected.unseenWorstTenth = 0.35;
    plan.poseTolerant = 0.21;
    return plan;
  };
  services.expect = [](const std::filesystem::path&, const std::vector<ShotDirections>& shots,
                       const NearFieldDisc&, BasisRegion, double, const JobContext&) -> Result<Plan> {
    Plan plan;
    for (const ShotDirections& shot : shots) plan.shots.push_back({shot, shot.centre()});
    plan.expected.training = 0.3;
    plan.expected.unseen = 0.31;
    plan.expected.unseenWorstTenth = 0.5;
    return plan;
  };
  return services;
}

}  // namespace patina::test
