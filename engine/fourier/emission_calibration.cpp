#include "engine/fourier/emission_calibration.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "engine/base/least_squares.h"
#include "engine/fourier/diffuse_transform.h"
#include "engine/fourier/measurements.h"
#include "engine/fourier/site_geometry.h"

namespace patina {
namespace {

/// White paper answers to low frequencies only; higher ones would add noise and time.
constexpr int kHighestFrequency = 8;
constexpr double kNarrowest = 0.15, kWidest = 30;  // of the Gaussian, pattern units at unit distance
constexpr double kFlat = 8;                        // wider than that is no shape any more
constexpr double kModelFloor = 1e-3;               // of full scale
constexpr double kMisfit = 0.02;                   // relative RMS that no noise explains

/// What the paper sent at the points, and where they are.
struct PaperData {
  std::vector<Eigen::Vector2d> frequencies;  ///< 0 first
  std::vector<Eigen::Vector2d> pointMm;
  std::vector<double> values;  ///< [point][frequency][re R G B, im R G B]; im of the first is 0
  std::vector<double> sd;      ///< of each by noise, and what the model may lack
  double noiseSquares = 0;     ///< expected sum over all values
  double squares = 0;
};

class PaperModel {
 public:
  PaperModel(const FourierCapture& capture, const PaperData& data, const Eigen::Vector3d& albedo)
      : capture_(capture), data_(data), albedo_(albedo) {}

  /// Transform of white paper of gain 1 at every point: [point][frequency][re, im]. Kept for the last shape.
  const std::vector<double>& transform(const Eigen::Vector4d& shape) {
    if (!kept_.empty() && shape == keptShape_) return kept_;
    Screen screen = capture_.screen;
    screen.emission = ScreenEmission{shape.head<2>(), shape.tail<2>().array().exp().matrix(), 1.0};
    const ScreenFrame frame(screen);
    const DiffuseTransform diffuse(frame, {capture_.sampleWidthMm, capture_.sampleHeightMm},
                                   data_.frequencies, DiffuseMethod::Quadrature);
    const Eigen::Vector3d normal = frame.screenFromWorld * Eigen::Vector3d::UnitZ();
    const std::size_t count = data_.frequencies.size();
    std::vector<float> out(count * 6);
    kept_.resize(data_.pointMm.size() * count * 2);
    for (std::size_t p = 0; p < data_.pointMm.size(); ++p) {
      diffuse.at(data_.pointMm[p], out.data());
      for (std::size_t f = 0; f < count; ++f)
        for (int part = 0; part < 2; ++part) {
          double sum = 0;
          for (int axis = 0; axis < 3; ++axis)
            sum +=
                normal[axis] * static_cast<double>(out[(f * 3 + static_cast<std::size_t>(axis)) * 2 + part]);
          kept_[(p * count + f) * 2 + part] = sum;
        }
    }
    keptShape_ = shape;
    return kept_;
  }

  /// Model minus measurement; in standard deviations, or as it is.
  void residuals(const Eigen::Vector4d& shape, const Eigen::Vector3d& gain, bool inSds,
                 Eigen::VectorXd& out) {
    const std::vector<double>& model = transform(shape);
    out.resize(static_cast<Eigen::Index>(data_.values.size()));
    for (std::size_t i = 0; i < model.size(); ++i)
      for (std::size_t c = 0; c < 3; ++c) {
        const double predicted = albedo_[static_cast<int>(c)] * gain[static_cast<int>(c)] * model[i];
        out[static_cast<Eigen::Index>(i * 3 + c)] =
            (predicted - data_.values[i * 3 + c]) / (inSds ? data_.sd[i * 3 + c] : 1);
      }
  }

  /// The gains that fit a shape best.
  Eigen::Vector3d bestGain(const Eigen::Vector4d& shape) {
    const std::vector<double>& model = transform(shape);
    Eigen::Vector3d gain;
    for (int c = 0; c < 3; ++c) {
      double products = 0, squares = 0;
      for (std::size_t i = 0; i < model.size(); ++i) {
        products += albedo_[c] * model[i] * data_.values[i * 3 + static_cast<std::size_t>(c)];
        squares += albedo_[c] * model[i] * albedo_[c] * model[i];
      }
      gain[c] = squares > 0 ? products / squares : 0;
    }
    return gain;
  }

 private:
  const FourierCapture& capture_;
  const PaperData& data_;
  Eigen::Vector3d albedo_;
  Eigen::Vector4d keptShape_ = Eigen::Vector4d::Zero();
  std::vector<double> kept_;
};

Result<PaperData> readPaper(const FourierCapture& capture, int points, const JobContext& job) {
  // Large photographs are grouped as they are read.
  const int size = std::max(2, static_cast<int>(std::lround(std::sqrt(points))));
  Result<SiteSet> sites = makeSites(capture, size);
  if (!sites) return sites.error();
  Result<MeasurementPlan> plan = planMeasurements(capture, job);
  if (!plan) return plan.error();
  Result<FourierMeasurements> measured = measure(capture, std::move(*plan), std::move(*sites), job);
  if (!measured) return measured.error();

  PaperData data;
  data.frequencies.push_back(Eigen::Vector2d::Zero());
  std::vector<int> kept;
  for (int f = 0; f < measured->frequencyCount(); ++f) {
    const Eigen::Vector2i& w = measured->plan.fitted[static_cast<std::size_t>(f)].frequency;
    if (w.cwiseAbs().maxCoeff() > kHighestFrequency) continue;
    kept.push_back(f);
    data.frequencies.push_back(w.cast<double>());
  }
  if (kept.size() < 3)
    return Error{ErrorCode::Invalid, "the bundle has fewer than three frequencies up to 8",
                 capture.folder.string(), "photograph the paper with the same patterns as a sample"};
  // Means over a grid of as many places as points are asked for: every pixel counts, and noise averages out.
  struct Place {
    Eigen::Vector2d pointMm = Eigen::Vector2d::Zero();
    std::vector<double> values, variances;  ///< as in PaperData
    double pixels = 0;
  };
  std::vector<Place> places(static_cast<std::size_t>(size) * size);
  const std::size_t width = data.frequencies.size() * 6;
  for (std::size_t s = 0; s < measured->sites.size(); ++s) {
    if (measured->clipped[s] || measured->windowClipped(s) || !measured->droppedRows(s).empty()) continue;
    const Eigen::Vector2d point = measured->sites.pointMm[s].cast<double>();
    const auto cellOf = [&](double mm, double sideMm) {
      return std::clamp(static_cast<int>((mm / sideMm + 0.5) * size), 0, size - 1);
    };
    Place& place = places[static_cast<std::size_t>(cellOf(point.y(), capture.sampleHeightMm)) * size +
                          static_cast<std::size_t>(cellOf(point.x(), capture.sampleWidthMm))];
    place.values.resize(width), place.variances.resize(width);
    const double pixels = measured->sites.pixelCount[s];
    const auto add = [&](std::size_t at, double value, double variance) {
      place.values[at] += pixels * value;
      place.variances[at] += pixels * pixels * variance;
    };
    for (int c = 0; c < 3; ++c)
      add(static_cast<std::size_t>(c), measured->dc[s * 3 + static_cast<std::size_t>(c)],
          measured->dcVariance(s, c));
    const SiteBlock block = measured->store.block(s, 1, MeasurementStore::kZ);
    for (std::size_t f = 0; f < kept.size(); ++f)
      for (int k = 0; k < 6; ++k)
        add((f + 1) * 6 + static_cast<std::size_t>(k), block.z(s)[kept[f] * 6 + k],
            measured->variance(s, k % 3));
    place.pointMm += pixels * point;
    place.pixels += pixels;
  }
  for (const Place& place : places) {
    if (!(place.pixels > 0)) continue;
    data.pointMm.push_back(place.pointMm / place.pixels);
    for (std::size_t i = 0; i < width; ++i) {
      data.values.push_back(place.values[i] / place.pixels);
      const double variance = place.variances[i] / (place.pixels * place.pixels);
      data.noiseSquares += variance;
      data.sd.push_back(variance > 0 ? std::sqrt(variance)
                                     : 1.0);  // the zero frequency has no imaginary part
    }
  }
  if (const auto failure = measured->store.failure()) return *failure;
  for (const double v : data.values) data.squares += v * v;
  // No screen is a Gaussian to a thousandth: beyond that, clean photographs must not make one value rule.
  const double floor = kModelFloor * measured->fullScale;
  for (double& sd : data.sd) sd = std::hypot(sd, floor);
  if (data.pointMm.size() < 12 || !(data.squares > 0))
    return Error{ErrorCode::Invalid,
                 "too little of the paper can be used: it is black, clipped or hardly in the picture",
                 capture.folder.string(),
                 "paper that fills the sample's place, exposed to two thirds of full scale"};
  return data;
}

}  // namespace

Result<EmissionCalibration> calibrateEmission(const FourierCapture& capture, const EmissionOptions& options,
                                              const JobContext& job) {
  EmissionCalibration result;
  result.albedo = options.albedo;
  if (result.albedo.isZero()) result.albedo = capture.known ? capture.known->albedo : Eigen::Vector3d::Ones();
  if (!(result.albedo.minCoeff() > 0.01 && result.albedo.maxCoeff() <= 1.05) || options.points < 12)
    return Error{ErrorCode::Invalid,
                 "the paper's albedo must lie between 0.01 and 1.05, and 12 points are needed", "emission",
                 "0.9 for uncoated white paper, where nothing better is known"};
  const Result<PaperData> data = readPaper(capture, options.points, job);
  if (!data) return data.error();
  result.points = static_cast<int>(data->pointMm.size());

  PaperModel model(capture, *data, result.albedo);
  // Unknowns: vertical mean, logarithms of both widths, three logarithms of gains relative to the start; the
  // horizontal mean last where it is free.
  Eigen::Vector4d start(0, 0, std::log(1.5), std::log(1.5));
  const Eigen::Vector3d startGain = model.bestGain(start);
  if (!(startGain.minCoeff() > 0))
    return Error{ErrorCode::Invalid, "the paper is dark in one channel at least", capture.folder.string(),
                 "is the screen white in the window photograph?"};
  const auto shapeOf = [&](const Eigen::VectorXd& x) {
    return Eigen::Vector4d(options.freeMeanX ? x[6] : 0.0, x[0], start[2] + x[1], start[3] + x[2]);
  };
  const auto gainOf = [&](const Eigen::VectorXd& x) {
    return Eigen::Vector3d(startGain.array() * x.segment<3>(3).array().exp());
  };
  const auto function = [&](const Eigen::VectorXd& x, Eigen::VectorXd& residuals) {
    const Eigen::Vector4d shape = shapeOf(x);
    if (!(shape.tail<2>().minCoeff() > std::log(kNarrowest) &&
          shape.tail<2>().maxCoeff() < std::log(kWidest)) ||
        shape.head<2>().cwiseAbs().maxCoeff() > kWidest)
      return false;
    model.residuals(shape, gainOf(x), true, residuals);
    return residuals.allFinite();
  };
  const Eigen::Index unknowns = options.freeMeanX ? 7 : 6;
  // The transform is in single precision: steps of 0.005 keep its rounding out of the derivatives.
  const Eigen::VectorXd scale = Eigen::VectorXd::Constant(unknowns, 5.0);
  LeastSquaresOptions squares;
  squares.iterations = options.iterations;
  squares.relativeStep = 2e-7;
  squares.stop = job.stop;
  job.progress("emission", 0, 1, "fits");
  const LeastSquaresSolution solution =
      minimiseSquares(function, Eigen::VectorXd::Zero(unknowns), scale, squares);
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "the calibration was cancelled", "", ""};
  job.progress("emission", 1, 1, "fits");

  const Eigen::Vector4d shape = shapeOf(solution.x);
  const Eigen::Vector3d gain = gainOf(solution.x);
  result.iterations = solution.iterations;
  result.converged = solution.converged && solution.determined;
  result.emission.mean = shape.head<2>();
  result.emission.sigma = shape.tail<2>().array().exp();
  result.emission.gain = gain.mean();
  result.channelGain = gain / gain.mean();
  const double headOn =
      result.emission.gain *
      std::exp(-0.5 * result.emission.mean.cwiseQuotient(result.emission.sigma).squaredNorm());
  result.radianceScale = capture.radianceScale / headOn;
  Eigen::VectorXd left;
  model.residuals(shape, gain, false, left);
  result.residual = left.norm() / std::sqrt(data->squares);
  result.noise = std::sqrt(data->noiseSquares / data->squares);
  if (solution.determined) {
    const Eigen::MatrixXd covariance = solution.variance() * solution.inverseNormal;
    result.meanSd = {options.freeMeanX ? std::sqrt(covariance(6, 6)) : 0.0, std::sqrt(covariance(0, 0))};
    result.sigmaSd = {std::sqrt(covariance(1, 1)) * result.emission.sigma[0],
                      std::sqrt(covariance(2, 2)) * result.emission.sigma[1]};
    result.gainSd = std::sqrt(covariance.block<3, 3>(3, 3).sum()) / 3 * result.emission.gain;
  }
  char text[240];
  if (!result.converged)
    result.warnings.push_back(
        "the fit didn't settle: are these photographs of plain white paper, with this screen and camera?");
  if (result.residual > kMisfit && result.residual > 3 * result.noise) {
    std::snprintf(text, sizeof text,
                  "the paper differs from what a Gaussian screen sends it by %.1f %% (noise %.1f %%): paper "
                  "that shines or "
                  "isn't flat, a wrong screen pose, or a screen that isn't Gaussian",
                  100 * result.residual, 100 * result.noise);
    result.warnings.push_back(text);
  }
  if (result.emission.sigma.maxCoeff() > kFlat)
    result.warnings.push_back(
        "the screen sends nearly the same light to all sides in one direction at least: its width there is "
        "hardly known");
  return result;
}

}  // namespace patina
