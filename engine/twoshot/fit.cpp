#include "engine/twoshot/fit.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>

#include "engine/base/text.h"
#include "engine/twoshot/cluster.h"
#include "engine/twoshot/observations.h"
#include "engine/twoshot/photo_prediction.h"
#include "engine/twoshot/posterior.h"
#include "engine/twoshot/remarks.h"
#include "engine/twoshot/ridge.h"

namespace patina {
namespace {

constexpr double kSmallestEta = 1e-3, kLargestEta = 1e6;
/// A material with fewer pixels in the fitted pictures is not measured: a dozen rows at most, of a dozen
/// directions.
constexpr std::size_t kFewestPixels = 30;
constexpr double kSmallShare = 0.03;

class Stopwatch {
 public:
  explicit Stopwatch(std::map<std::string, double>* seconds) : seconds_(seconds) {}
  /// Adds the time since the last lap to `stage`.
  void lap(const std::string& stage) {
    const auto now = std::chrono::steady_clock::now();
    (*seconds_)[stage] += std::chrono::duration<double>(now - last_).count();
    last_ = now;
  }
  double total() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::map<std::string, double>* seconds_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now(), last_ = start_;
};

Error cancelled() {
  return {ErrorCode::Cancelled, "the reconstruction was cancelled", "", ""};
}

/// What a picture of the sample subtends, for suggestions.
NearFieldDisc discOf(const TwoShotCapture& capture) {
  const double radius =
      capture.disc ? capture.radiusMm : std::sqrt(capture.widthMm * capture.heightMm / std::numbers::pi);
  NearFieldDisc disc;
  for (const TwoShotPhoto& shot : capture.shots) {
    if (shot.holdout) continue;
    disc.fovDeg = 360 / std::numbers::pi * std::atan(radius / shot.camera.positionMm().norm());
    break;
  }
  return disc;
}

/// RMS of what the fit leaves of the rows, noise taken off, all channels; and for each channel with it.
double residuals(const RidgeProblem& problem, const Eigen::MatrixXd& coefficients,
                 Eigen::Vector3d* channels) {
  const Eigen::MatrixXd left =
      problem.target - problem.reduced * (problem.directions.transpose() * coefficients);
  double squares = 0, weights = 0, noise = 0;
  for (int c = 0; c < 3; ++c) {
    const Eigen::ArrayXd w = problem.weight.col(c).array();
    const double sum = (w * left.col(c).array().square()).sum(), total = w.sum();
    (*channels)[c] = total > 0 ? std::sqrt(sum / total) : 0;
    squares += sum, weights += total;
    noise += (w * problem.noise.col(c).array()).sum();
  }
  return weights > 0 ? std::sqrt(std::max(squares - noise, 0.0) / weights) : 0;
}

class Fitter {
 public:
  Fitter(const TwoShotCapture& capture, const BasisPtr& basis, const TwoShotFitOptions& options,
         const JobContext& job, std::shared_ptr<const TwoShotDeviation> deviation)
      : job_(job), watch_(&fit_->stats.seconds) {
    fit_->capture = capture;
    fit_->basis = basis;
    fit_->options = options;
    if (deviation && deviation->saturation > 0) fit_->capture.saturation = deviation->saturation;
    fit_->deviation = std::move(deviation);
  }

  Result<std::shared_ptr<const TwoShotFit>> run() {
    Result<LoadedCapture> loaded = loadFittedShots(fit_->capture, job_, fit_->deviation);
    watch_.lap("read");
    if (!loaded) return loaded.error();
    loaded_ = std::move(*loaded);
    TwoShotStats& stats = fit_->stats;
    for (const std::string& remark : loaded_.remarks) stats.remarks.push_back(remark);
    for (const ReflectancePicture& picture : loaded_.pictures) {
      stats.clippedPixels += picture.clipped;
      stats.darkPixels += picture.dark;
    }
    materials_ = clusterMaterials(fit_->capture, loaded_.pictures, fit_->options.clusters, job_);
    watch_.lap("observe");
    if (job_.cancelled()) return cancelled();

    job_.progress("solve", 0, materials_.count, "materials");
    for (int m = 0; m < materials_.count; ++m) {
      Status solved = solve(m);
      if (!solved) return solved.error();
      job_.progress("solve", m + 1, materials_.count, "materials");
    }
    for (int m = 0; m < materials_.count && !job_.cancelled(); ++m) {
      job_.progress("posterior", m, materials_.count, "materials");
      judge(m);
      job_.progress("posterior", m + 1, materials_.count, "materials");
    }
    Status predicted = predict();
    if (!predicted && predicted.error().code != ErrorCode::Cancelled) return predicted.error();
    stats.cancelled = job_.cancelled();
    labels();
    conclude();
    stats.seconds["total"] = watch_.total();
    return std::shared_ptr<const TwoShotFit>(std::move(fit_));
  }

 private:
  struct Work {
    Observations rows;
    std::optional<RidgeProblem> problem;
    double eta = 0, residual = 0;
    bool measured = false;
  };

  Status solve(int index) {
    TwoShotStats& stats = fit_->stats;
    const TwoShotFitOptions& options = fit_->options;
    Work& work = work_.emplace_back();
    std::vector<std::vector<std::int8_t>> materialOf;
    if (materials_.count > 1) {
      for (const ReflectancePicture& picture : loaded_.pictures)
        materialOf.push_back(materials_.labelsFor(picture.view, true));
    }
    work.rows = observe(loaded_.pictures, materialOf, index, options.rowsPerShot);
    if (job_.cancelled()) return cancelled();
    stats.pixels += work.rows.pixels;
    watch_.lap("observe");

    const double smallestEta = options.chooseEta ? 0.1 : options.eta;
    work.problem = makeRidgeProblem(*fit_->basis, work.rows, options.noiseWeights, smallestEta, job_);
    if (!work.problem) return cancelled();
    stats.rows += work.problem->target.rows();
    stats.unreachedPixels += work.problem->unreached;
    TwoShotMaterial& material = fit_->materials.emplace_back();
    work.measured = work.rows.pixels >= kFewestPixels && work.problem->target.rows() > 0;
    if (!work.measured && materials_.count == 1) {
      return Error{ErrorCode::Invalid,
                   work.rows.pixels < kFewestPixels ? "fewer than 30 pixels of the sample can be used"
                                                    : "no pixel shows directions that the basis covers",
                   fit_->capture.folder.string(),
                   "check the camera poses, the light directions and the sample's size in capture.json"};
    }
    const Eigen::Index k = fit_->basis->componentCount();
    material.coefficients = Eigen::MatrixXd::Zero(k, 3);
    if (work.measured) {
      work.eta = options.chooseEta ? chooseEta(*work.problem) : options.eta;
      material.coefficients = solveRidge(*work.problem, Eigen::Vector3d::Constant(work.eta));
      work.residual = residuals(*work.problem, material.coefficients, &material.residualSd);
    }
    material.eta.setConstant(work.eta);
    watch_.lap("solve");
    if (job_.cancelled()) return cancelled();
    const std::string& sample = fit_->capture.sampleName;
    BrdfOrigin origin;
    origin.name = sample.empty() ? fit_->capture.folder.filename().string() : sample;
    if (materials_.count > 1) origin.name += ", material " + std::to_string(index + 1);
    origin.format = "merl";
    origin.note = "reconstructed from photographs with the basis " + inQuotes(fit_->basis->name());
    material.brdf = fit_->basis->reconstruct(material.coefficients, std::move(origin), job_.stop);
    watch_.lap("unmap");
    if (!material.brdf) return cancelled();
    if (fit_->deviation) material.brdf = fit_->deviation->withSurfaceTerms(material.brdf);
    return Done{};
  }

  /// Expected error, posterior, remarks of one material.
  void judge(int index) {
    const Work& work = work_[index];
    TwoShotMaterial& material = fit_->materials[index];
    const std::string name = materials_.count > 1 ? "Material " + std::to_string(index + 1) + ": " : "";
    if (!work.measured) {
      fit_->stats.remarks.push_back(name + "too few pixels to measure; it shows the basis' mean.");
      return;
    }
    const Basis& basis = *fit_->basis;
    const RowFactor factor = work.problem->factor();
    const double rowWeight = work.problem->weight.rowwise().mean().sum();
    material.expected = ErrorMetric(fit_->basis, BasisRegion::All, work.eta).expect(factor);
    const LeaveOneOut left = leaveOneOut(basis, factor, rowWeight, work.eta, BasisRegion::All, {}, job_);
    if (job_.cancelled()) return;
    const Posterior posterior = makePosterior(basis, work.problem->directions, work.problem->eigenvalues,
                                              work.eta, left, work.residual);
    material.priorSd = posterior.priorSd;
    std::vector<float> sd =
        basis.posteriorSd(posterior.observed, posterior.shrunk, posterior.scale, job_.stop);
    if (sd.empty()) return;
    material.posteriorSd = std::make_shared<const std::vector<float>>(std::move(sd));
    if (job_.cancelled()) return;
    NextShot next;
    next = suggestNextShot(basis, material.coefficients, factor, rowWeight, work.eta, discOf(fit_->capture),
                           job_);
    for (std::string& remark : remarksOn(material, basis, posterior, work.rows.angles, work.rows.weight,
                                         work.residual, next, name)) {
      fit_->stats.remarks.push_back(std::move(remark));
    }
    for (std::size_t p = 0; p < work.rows.picturePixels.size() && materials_.count > 1; ++p) {
      std::size_t inside = 0;
      for (const std::uint8_t in : loaded_.pictures[p].view.inside) inside += in;
      if (static_cast<double>(work.rows.picturePixels[p]) < kSmallShare * static_cast<double>(inside)) {
        fit_->stats.remarks.push_back(
            name + "covers little of " +
            inQuotes(fit_->capture.shots[loaded_.pictures[p].shots.front()].file) + " (" +
            counted(work.rows.picturePixels[p], "pixel") +
            "), so that few directions of it were seen and its BRDF leans on the basis.");
      }
    }
    watch_.lap("posterior");
  }

  Status predict() {
    const TwoShotCapture& capture = fit_->capture;
    std::vector<std::shared_ptr<const TabulatedBrdf>> brdfs;
    for (const TwoShotMaterial& material : fit_->materials) brdfs.push_back(material.brdf);
    ErrorSums fitted, held;
    const auto total = static_cast<std::int64_t>(capture.shots.size());
    std::int64_t done = 0;
    job_.progress("predict", 0, total, "photos");
    for (const ReflectancePicture& picture : loaded_.pictures) {
      for (const std::size_t s : picture.shots) {
        if (job_.cancelled()) return cancelled();
        const LoadedShot& shot = loaded_.shots[s];
        const Image& taken = shot.asTaken.empty() ? shot.pixels : shot.asTaken;
        fit_->comparisons.push_back(predictPhoto(capture, s, taken, shot.noise, picture.view,
                                                 picture.irradiance, brdfs, materials_, &fitted,
                                                 fit_->deviation.get()));
        job_.progress("predict", ++done, total, "photos");
      }
    }
    std::vector<bool> others;
    for (std::size_t s = 0; s < capture.shots.size(); ++s)
      others.push_back(capture.shots[s].holdout || loaded_.leftOut.contains(s));
    auto compared = compareShots(capture, fit_->materials, materials_, loaded_.leftOut, job_, &fitted, &held,
                                 others, done, fit_->deviation.get());
    if (!compared) return compared.error();
    for (TwoShotComparison& comparison : *compared) fit_->comparisons.push_back(std::move(comparison));
    TwoShotStats& stats = fit_->stats;
    stats.fitRms = fitted.rms(), stats.noiseFloorFit = fitted.noiseFloor();
    stats.holdoutRms = held.rms(), stats.noiseFloorHoldout = held.noiseFloor();
    watch_.lap("predict");
    return Done{};
  }

  /// The label map over the first shot's pixels, and each material's share of the sample.
  void labels() {
    if (materials_.count == 1) return;
    const SampleView view = viewOf(fit_->capture, fit_->capture.shots.front().camera);
    const std::vector<std::int8_t> label = materials_.labelsFor(view, false);
    fit_->labels = Image(view.width, view.height, 1, -1.0f);
    std::vector<double> area(materials_.count, 0.0);
    double total = 0;
    for (std::size_t i = 0; i < label.size(); ++i) {
      if (!view.onSample[i] || label[i] < 0) continue;
      fit_->labels.samples()[i] = label[i];
      area[label[i]] += view.areaMm2[i], total += view.areaMm2[i];
    }
    for (int m = 0; m < materials_.count; ++m) fit_->materials[m].share = total > 0 ? area[m] / total : 0;
  }

  /// What the photographs themselves say of the error.
  void conclude() {
    TwoShotStats& stats = fit_->stats;
    std::string error;
    char text[200];
    if (stats.fitRms >= 0 && !stats.cancelled) {
      std::snprintf(
          text, sizeof text,
          "The photographs that were fitted are reproduced to %.1f %% (relative RMS; their noise: %.1f %%)",
          100 * stats.fitRms, 100 * stats.noiseFloorFit);
      error = text;
      if (stats.holdoutRms >= 0) {
        std::snprintf(text, sizeof text, ", those held out are predicted to %.1f %% (noise: %.1f %%)",
                      100 * stats.holdoutRms, 100 * stats.noiseFloorHoldout);
        error += text;
      } else {
        error += "; none was held out, so nothing was checked in directions that the fit didn't see";
      }
      stats.remarks.insert(stats.remarks.begin(), error + ".");
    }
    const auto share = [&](std::size_t count) {
      std::snprintf(text, sizeof text, " (%.1f %% of those on the sample)",
                    100.0 * static_cast<double>(count) /
                        static_cast<double>(std::max<std::size_t>(1, stats.pixels + stats.clippedPixels)));
      return std::string(text);
    };
    if (stats.clippedPixels > 0) {
      stats.remarks.push_back(
          counted(stats.clippedPixels, "pixel") + share(stats.clippedPixels) +
          " clipped in every exposure and left out: the brightest part of the highlight may be "
          "missing.");
    }
    if (stats.darkPixels * 10 > stats.pixels) {
      stats.remarks.push_back(counted(stats.darkPixels, "pixel") + share(stats.darkPixels) +
                              " not above black: a longer exposure would tell more.");
    }
    if (materials_.count > 1) {
      std::snprintf(
          text, sizeof text,
          "%d materials were told apart by colour; the two most alike are %.1f standard deviations apart.",
          materials_.count, materials_.separation);
      stats.remarks.push_back(text);
    } else if (fit_->options.clusters != 1) {
      stats.remarks.push_back("One material: no two groups of colours stand apart.");
    }
  }

  const JobContext& job_;
  std::shared_ptr<TwoShotFit> fit_ = std::make_shared<TwoShotFit>();
  Stopwatch watch_;
  LoadedCapture loaded_;
  MaterialMap materials_;
  std::vector<Work> work_;
};

}  // namespace

std::vector<std::string> TwoShotFitOptions::validate() const {
  std::vector<std::string> problems;
  if (!(eta >= kSmallestEta && eta <= kLargestEta))
    problems.push_back("eta must lie between 0.001 and 1000000");
  if (rowsPerShot < 10 || rowsPerShot > 200'000)
    problems.push_back("rows per shot must lie between 10 and 200000");
  if (clusters < 0 || clusters > kMostMaterials)
    problems.push_back("clusters must lie between 1 and " + std::to_string(kMostMaterials) +
                       ", or be 0 (chosen)");
  return problems;
}

Result<std::shared_ptr<const TwoShotFit>> fitTwoShot(const TwoShotCapture& capture, const BasisPtr& basis,
                                                     const TwoShotFitOptions& options, const JobContext& job,
                                                     std::shared_ptr<const TwoShotDeviation> deviation) {
  const std::vector<std::string> problems = options.validate();
  if (!problems.empty()) {
    std::string all;
    for (const std::string& problem : problems) all += (all.empty() ? "" : "; ") + problem;
    return Error{ErrorCode::Invalid, all, "options", "correct them"};
  }
  if (!basis) throw std::invalid_argument("fitTwoShot needs a basis");
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  std::optional<Result<std::shared_ptr<const TwoShotFit>>> result;
  arena.execute([&] { result.emplace(Fitter(capture, basis, options, job, std::move(deviation)).run()); });
  return std::move(*result);
}

}  // namespace patina
