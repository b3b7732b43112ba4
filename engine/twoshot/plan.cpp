#include "engine/twoshot/plan.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <Eigen/QR>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <numbers>

#include "engine/twoshot/plan_search.h"

namespace patina {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kUsualPoseErrorDeg = 1.5;  // what a careful person with a protractor reaches
constexpr int kFinalPoints = 300;           // a picture, for what is reported

struct PictureRows {
  RowFactor factor;
  Eigen::VectorXd sum;     ///< of the scaled rows
  Eigen::MatrixXd scaled;  ///< n x k
};

PictureRows rowsOf(const Basis& basis, const std::vector<HalfDiffAngles>& directions, int points,
                   bool pointSample) {
  PictureRows picture;
  const double scale = pointSample ? 1.0 : std::sqrt(kEtaRows / points);
  const BasisRows rows = basis.rows(directions);
  picture.factor = reduceRows(rows.components, scale);
  picture.scaled = rows.components * scale;
  picture.sum = picture.scaled.colwise().sum();
  return picture;
}

/// All of a plan that follows from the pictures' rows.
void describe(Plan& plan, const BasisPtr& basis, const std::vector<PictureRows>& pictures, BasisRegion region,
              double eta) {
  const ErrorMetric metric(basis, region, eta);
  std::vector<const RowFactor*> factors;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(basis->componentCount());
  Eigen::Index rowCount = 0;
  plan.errorAfterShot.clear();
  const auto stacked = [&] {
    RowFactor all = stack(factors);
    return all.rank() > basis->componentCount() ? reduceRows(all.factor, 1.0) : all;
  };
  for (const PictureRows& picture : pictures) {
    factors.push_back(&picture.factor);
    sum += picture.sum;
    rowCount += picture.scaled.rows();
    plan.errorAfterShot.push_back(metric.training(stacked()));
  }
  Eigen::MatrixXd rows(rowCount, basis->componentCount());
  rowCount = 0;
  for (const PictureRows& picture : pictures) {
    rows.middleRows(rowCount, picture.scaled.rows()) = picture.scaled;
    rowCount += picture.scaled.rows();
  }
  plan.expected = metric.expect(stacked(), sum);
  // Many rows: their triangular factor has the same singular values and takes far less time.
  if (rows.rows() > 2 * rows.cols()) {
    const Eigen::HouseholderQR<Eigen::MatrixXd> factorised(rows);
    rows = factorised.matrixQR().topRows(rows.cols()).triangularView<Eigen::Upper>().toDenseMatrix();
  }
  plan.conditionNumber = conditionNumber(rows);
  plan.basisName = basis->name();
  plan.materials.clear();
  for (const BasisMaterial& material : basis->materials()) plan.materials.push_back(material.name);
  plan.options.region = region;
  plan.options.eta = eta;
}

double poseTolerantError(const BasisPtr& basis, const std::vector<PlannedShot>& shots,
                         const PlanOptions& options) {
  PlanOptions tolerant = options;
  tolerant.metric = PlanMetric::ExpectedError;
  tolerant.pointsPerShot = kFinalPoints;
  if (tolerant.poseErrorDeg <= 0) tolerant.poseErrorDeg = kUsualPoseErrorDeg;
  std::vector<IndexedShot> indexed;
  for (const PlannedShot& shot : shots)
    indexed.push_back({static_cast<int>(indexed.size()), shot.directions});
  return PlanObjective(basis, tolerant).value(indexed, true);
}

/// The order in which each picture tells most after those before it; the given ones stay first.
void orderShots(const BasisPtr& basis, const PlanOptions& options, std::vector<ShotDirections>& shots) {
  PlanOptions plain = options;
  plain.metric = PlanMetric::ExpectedError;
  const PlanObjective objective(basis, plain);
  const auto indexed = [&](std::size_t i) { return IndexedShot{static_cast<int>(i), shots[i]}; };
  std::vector<IndexedShot> chosen;
  for (std::size_t i = 0; i < options.given.size(); ++i) chosen.push_back(indexed(i));
  for (std::size_t at = options.given.size(); at + 1 < shots.size(); ++at) {
    const PlanObjective::Staying staying = objective.stay(chosen, false);
    std::vector<double> errors(shots.size());
    tbb::parallel_for(at, shots.size(),
                      [&](std::size_t next) { errors[next] = objective.value(staying, {indexed(next)}); });
    const auto best = std::min_element(errors.begin() + static_cast<std::ptrdiff_t>(at), errors.end());
    std::swap(shots[at], shots[static_cast<std::size_t>(best - errors.begin())]);
    chosen.push_back(indexed(at));
  }
}

}  // namespace

std::vector<std::string> PlanOptions::validate() const {
  std::vector<std::string> problems;
  const auto need = [&](bool good, const char* sentence) {
    if (!good) problems.emplace_back(sentence);
  };
  need(shots >= 1 && shots <= 30, "shots must lie in 1 to 30");
  need(fovDeg >= 0 && fovDeg <= 120, "the field of view must lie in 0 to 120 degrees; 0 is a point sample");
  need(eta > 0 && std::isfinite(eta), "eta must be positive");
  need(candidates >= 1 && candidates <= 100000, "candidates must lie in 1 to 100000");
  need(pointsPerShot >= 1 && pointsPerShot <= 10000, "points a picture must lie in 1 to 10000");
  need(restarts >= 1 && restarts <= 1000, "restarts must lie in 1 to 1000");
  need(poseErrorDeg >= 0 && poseErrorDeg <= 20, "the pose error must lie in 0 to 20 degrees");
  need(maxAngleDeg >= 10 && maxAngleDeg < 90, "the largest angle must lie in 10 to 90 degrees, without 90");
  need(given.size() <= 30, "at most 30 pictures can be given");
  bool above = true, sameCamera = true, sameLight = true;
  for (const ShotDirections& shot : given) {
    // 1e-6: what a direction typed with 7 digits misses of unit length
    for (const Eigen::Vector3d& to : {shot.toLight, shot.toCamera})
      above = above && std::abs(to.norm() - 1) < 1e-6 && to.z() > 0;
    sameCamera = sameCamera && (shot.toCamera - given[0].toCamera).norm() < 1e-3;
    sameLight = sameLight && (shot.toLight - given[0].toLight).norm() < 1e-3;
  }
  need(above, "the given directions must be unit vectors above the sample");
  need(setup != PlanSetup::FixedCamera || sameCamera, "with a fixed camera the given pictures must share it");
  need(setup != PlanSetup::FixedLight || sameLight, "with a fixed light the given pictures must share it");
  if (region == BasisRegion::Trusted) {
    // Straight from above the disc's rim is seen at half of the field of view.
    need(fovDeg / 2 < kTrustedAngleDeg, "a disc this wide is seen beyond the trusted angles from everywhere");
  }
  if (problems.empty() && setup != PlanSetup::Free && !given.empty()) {
    // What all pictures share must itself be allowed, or no picture is.
    const PlanSpace space(*this);
    const bool camera = setup == PlanSetup::FixedCamera;
    need(camera ? space.validCamera(given[0].toCamera) : space.validLight(given[0].toLight),
         camera ? "the given camera is further from the normal than the largest angle or the trusted region "
                  "allows"
                : "the given light is further from the normal than the largest angle or the trusted region "
                  "allows");
  }
  return problems;
}

Result<Plan> planDirections(const BasisPtr& basis, const PlanOptions& options, const JobContext& job) {
  const std::vector<std::string> problems = options.validate();
  if (!problems.empty()) {
    std::string all;
    for (const std::string& problem : problems) all += (all.empty() ? "" : "; ") + problem;
    return Error{ErrorCode::Invalid, all, "", "correct these options"};
  }
  const auto begin = std::chrono::steady_clock::now();
  const PlanObjective objective(basis, options);
  std::vector<SearchEnd> ends(static_cast<std::size_t>(options.restarts));
  const std::int64_t steps = std::int64_t{2} * options.shots * options.restarts;
  std::atomic<std::int64_t> done{0};
  job.progress("search", 0, steps, "steps");
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  arena.execute([&] {
    tbb::parallel_for(0, options.restarts, [&](int restart) {
      if (job.cancelled()) return;
      ends[static_cast<std::size_t>(restart)] = searchDirections(
          objective, options, restart, job, [&] { job.progress("search", ++done, steps, "steps"); });
    });
  });

  const SearchEnd* best = nullptr;
  Plan plan;
  for (const SearchEnd& end : ends) {
    if (end.shots.empty()) continue;
    plan.restartErrors.push_back(end.value);
    if (!best || end.value < best->value) best = &end;
  }
  if (!best) return Error{ErrorCode::Cancelled, "the search for directions was stopped", "", ""};
  std::vector<ShotDirections> shots = options.given;
  shots.insert(shots.end(), best->shots.begin(), best->shots.end());
  arena.execute([&] {
    if (!job.cancelled()) orderShots(basis, options, shots);
    Plan expectation =
        expectationOf(basis, shots, {options.fovDeg, kFinalPoints}, options.region, options.eta);
    expectation.restartErrors = std::move(plan.restartErrors);
    plan = std::move(expectation);
    plan.options = options;
    if (options.poseErrorDeg > 0 || options.setup != PlanSetup::Free)
      plan.poseTolerant = poseTolerantError(basis, plan.shots, options);
  });
  plan.seed = job.seed;
  plan.cancelled = job.cancelled();
  plan.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return plan;
}

Plan expectationOf(const BasisPtr& basis, const std::vector<ShotDirections>& shots, const NearFieldDisc& disc,
                   BasisRegion region, double eta) {
  const auto begin = std::chrono::steady_clock::now();
  Plan plan;
  plan.options.shots = static_cast<int>(shots.size());
  plan.options.fovDeg = disc.fovDeg;
  std::vector<PictureRows> pictures;
  for (const ShotDirections& shot : shots) {
    plan.shots.push_back({shot, shot.centre()});
    pictures.push_back(rowsOf(*basis, discDirections(shot, disc), disc.points, disc.fovDeg <= 0));
  }
  describe(plan, basis, pictures, region, eta);
  plan.poseTolerant = poseTolerantError(basis, plan.shots, plan.options);
  plan.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return plan;
}

SeenPicture seenPicture(const TwoShotCapture& capture, const TwoShotPhoto& photo, int points) {
  SeenPicture picture;
  picture.points = points;
  const Camera& camera = photo.camera;
  const Eigen::Vector3d eye = camera.positionMm();
  picture.centre = {photo.toLight, eye.normalized()};
  const double goldenAngle = std::numbers::pi * (3 - std::sqrt(5.0));
  for (int i = 0; i < points; ++i) {
    Eigen::Vector3d at = Eigen::Vector3d::Zero();
    if (capture.disc) {
      const double r = capture.radiusMm * std::sqrt((i + 0.5) / points), angle = i * goldenAngle;
      at.head<2>() << r * std::cos(angle), r * std::sin(angle);
    } else {
      // The rectangle's own even layout: a lattice of the golden ratio.
      const double u = (i + 0.5) / points, v = std::fmod(i * 0.6180339887498949, 1.0);
      at.head<2>() << (u - 0.5) * capture.widthMm, (v - 0.5) * capture.heightMm;
    }
    const auto pixel = camera.pixelFromWorld(at);
    if (!pixel || pixel->x() < -0.5 || pixel->y() < -0.5 || pixel->x() > camera.width - 0.5 ||
        pixel->y() > camera.height - 0.5)
      continue;
    const Eigen::Vector3d toView = (eye - at).normalized();
    if (toView.z() > 0 && photo.toLight.z() > 0)
      picture.directions.push_back(halfDiffFromDirections(photo.toLight, toView));
  }
  return picture;
}

std::vector<SeenPicture> seenPictures(const TwoShotCapture& capture, int points) {
  std::vector<SeenPicture> pictures;
  std::vector<const TwoShotPhoto*> taken;
  for (const TwoShotPhoto& photo : capture.shots) {
    if (photo.holdout) continue;
    const bool again = std::ranges::any_of(taken, [&](const TwoShotPhoto* other) {
      // A thousandth of a millimetre and of a radian: the same tripod.
      return sameLight(*other, photo) &&
             (other->camera.translationMm - photo.camera.translationMm).norm() < 1e-3 &&
             (other->camera.cameraFromWorld - photo.camera.cameraFromWorld).norm() < 1e-3;
    });
    if (again) continue;
    taken.push_back(&photo);
    pictures.push_back(seenPicture(capture, photo, points));
  }
  return pictures;
}

Plan expectationOf(const BasisPtr& basis, const TwoShotCapture& capture, BasisRegion region, double eta) {
  const auto begin = std::chrono::steady_clock::now();
  const std::vector<SeenPicture> seen = seenPictures(capture, kFinalPoints);
  Plan plan;
  std::vector<PictureRows> pictures;
  double distanceMm = 0;
  for (const SeenPicture& picture : seen) {
    plan.shots.push_back({picture.centre, picture.centre.centre()});
    pictures.push_back(rowsOf(*basis, picture.directions, picture.points, false));
  }
  std::size_t fitted = 0;
  for (const TwoShotPhoto& photo : capture.shots) {
    if (photo.holdout) continue;
    distanceMm += photo.camera.positionMm().norm();
    ++fitted;
  }
  distanceMm /= static_cast<double>(std::max<std::size_t>(fitted, 1));
  const double radiusMm =
      capture.disc ? capture.radiusMm : std::sqrt(capture.widthMm * capture.heightMm / std::numbers::pi);
  plan.options.shots = static_cast<int>(plan.shots.size());
  plan.options.fovDeg = distanceMm > 0 ? 2 * std::atan(radiusMm / distanceMm) / kDegree : 0;
  describe(plan, basis, pictures, region, eta);
  plan.poseTolerant = poseTolerantError(basis, plan.shots, plan.options);
  plan.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return plan;
}

}  // namespace patina
