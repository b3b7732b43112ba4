#include "engine/twoshot/photo_prediction.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace patina {

double ErrorSums::rms() const {
  return signal > 0 ? std::sqrt(residual / signal) : -1;
}

double ErrorSums::noiseFloor() const {
  return signal > 0 ? std::sqrt(noise / signal) : 0;
}

TwoShotComparison predictPhoto(const TwoShotCapture& capture, std::size_t shot, const Image& captured,
                               const PhotoNoise& noise, const SampleView& view,
                               const IrradiancePicture& irradiance,
                               const std::vector<std::shared_ptr<const TabulatedBrdf>>& brdfs,
                               const MaterialMap& materials, ErrorSums* sums,
                               const TwoShotDeviation* deviation) {
  const TwoShotPhoto& photo = capture.shots[shot];
  TwoShotComparison comparison;
  comparison.file = photo.file;
  comparison.holdout = photo.holdout;
  comparison.centre = halfDiffFromDirections(photo.toLight, view.cameraMm.normalized());
  comparison.captured = Image(view.width, view.height, 3);
  comparison.rendered = Image(view.width, view.height, 3);
  const std::vector<std::int8_t> labels = materials.labelsFor(view, false);
  const double limit = photo.encoding.empty() ? std::numeric_limits<double>::infinity() : 1.0;
  const Eigen::Array3d clipped = clipLevels({&captured, &view.onSample}, capture.saturation, limit);
  std::vector<ErrorSums> rows(view.height);
  const TwoShotDeviation setUp = deviation ? deviation->withoutSurfaceTerms() : TwoShotDeviation{};
  const double saturation = deviation && deviation->saturation > 0 ? deviation->saturation
                                                                   : std::numeric_limits<double>::infinity();
  tbb::parallel_for(tbb::blocked_range<int>(0, view.height), [&](const tbb::blocked_range<int>& range) {
    PhotoPoint point;
    point.shot = shot, point.toLight = photo.toLight, point.cameraMm = view.cameraMm;
    point.exposureS = photo.exposureS;
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < view.width; ++x) {
        const std::size_t i = view.index(x, y);
        if (!view.onSample[i]) continue;
        // A pixel that the labels' picture doesn't see is taken for the largest material.
        const std::size_t material = labels[i] >= 0 ? static_cast<std::size_t>(labels[i]) : 0;
        Eigen::Array3d brdf;
        if (deviation) {
          point.positionMm = view.positionMm[i].cast<double>();
          point.cornerShare = cornerShareOf(photo.camera, x, y);
          for (int c = 0; c < 3; ++c) point.rate[c] = std::max(irradiance.rate.at(x, y, c), 1e-30f);
          const DirectionPair pair = setUp.directions(point);
          brdf = brdfs[material]->evaluate(setUp.angles(pair));
          for (int c = 0; c < 3; ++c) brdf[c] = std::isfinite(brdf[c]) ? brdf[c] : 0;
          brdf = setUp.seenFromBase(brdf, point, pair);
        } else {
          brdf = brdfs[material]->evaluate(halfDiffFromDirections(photo.toLight, view.toView(i)));
        }
        for (int c = 0; c < 3; ++c) {
          const double seen = captured.at(x, y, c);
          const double light = irradiance.rate.at(x, y, c) * photo.exposureS;
          const double predicted = std::isfinite(brdf[c]) ? std::min(brdf[c] * light, saturation) : 0;
          comparison.captured.at(x, y, c) = static_cast<float>(seen);
          comparison.rendered.at(x, y, c) = static_cast<float>(predicted);
        }
      }
    }
  });
  if (deviation && (setUp.glare != 0 || setUp.defocusPx > 0))
    comparison.rendered = setUp.blurred(comparison.rendered);
  tbb::parallel_for(tbb::blocked_range<int>(0, view.height), [&](const tbb::blocked_range<int>& range) {
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < view.width; ++x) {
        if (!view.onSample[view.index(x, y)]) continue;
        for (int c = 0; c < 3; ++c) {
          const double seen = captured.at(x, y, c), predicted = comparison.rendered.at(x, y, c);
          const double light = irradiance.rate.at(x, y, c) * photo.exposureS;
          if (!(light > 0) || seen >= std::min(clipped[c], saturation)) continue;
          rows[y].residual += (predicted - seen) * (predicted - seen);
          rows[y].signal += seen * seen;
          const double white = irradiance.relativeVariance.at(x, y, c) * seen * seen;
          rows[y].noise += noise.variance(seen) + white;
        }
      }
    }
  });
  ErrorSums total;
  for (const ErrorSums& row : rows) total.add(row);
  comparison.rms = total.rms();
  comparison.noiseFloor = total.noiseFloor();
  if (sums) sums->add(total);
  return comparison;
}

namespace {

/// A photograph of which only itself can be shown.
TwoShotComparison withoutPrediction(const TwoShotPhoto& photo, const Image& captured,
                                    const SampleView& view) {
  TwoShotComparison comparison;
  comparison.file = photo.file;
  comparison.holdout = photo.holdout;
  comparison.centre = halfDiffFromDirections(photo.toLight, view.cameraMm.normalized());
  comparison.captured = Image(view.width, view.height, 3);
  for (std::size_t i = 0; i < view.onSample.size(); ++i) {
    for (std::size_t c = 0; c < 3 && view.onSample[i]; ++c)
      comparison.captured.samples()[3 * i + c] = captured.samples()[3 * i + c];
  }
  return comparison;
}

}  // namespace

Result<std::vector<TwoShotComparison>> compareShots(
    const TwoShotCapture& capture, const std::vector<TwoShotMaterial>& found, const MaterialMap& materials,
    const std::map<std::size_t, std::string>& leftOut, const JobContext& job, ErrorSums* fitted,
    ErrorSums* held, const std::vector<bool>& wanted, std::int64_t done, const TwoShotDeviation* deviation) {
  std::vector<std::shared_ptr<const TabulatedBrdf>> brdfs;
  for (const TwoShotMaterial& material : found) brdfs.push_back(material.brdf);
  std::vector<std::size_t> order;
  for (const int pass : {0, 1, 2}) {
    for (std::size_t s = 0; s < capture.shots.size(); ++s) {
      const int group = capture.shots[s].holdout ? 2 : leftOut.contains(s) ? 1 : 0;
      if (group == pass && (wanted.empty() || wanted[s])) order.push_back(s);
    }
  }
  std::vector<TwoShotComparison> comparisons;
  const auto total = static_cast<std::int64_t>(capture.shots.size());
  for (const std::size_t s : order) {
    const TwoShotPhoto& shot = capture.shots[s];
    if (job.cancelled())
      return Error{ErrorCode::Cancelled, "comparing the photographs was cancelled", "", ""};
    Result<Image> photo = readPhoto(capture, shot);
    if (!photo) return photo.error();
    const SampleView view = viewOf(capture, shot.camera);
    const auto reason = leftOut.find(s);
    const bool unused = reason != leftOut.end();
    Result<IrradiancePicture> irradiance = irradianceOf(capture, shot, view, nullptr);
    if (!irradiance && !unused) return irradiance.error();
    const auto lit = [&] {
      const auto rates = irradiance->rate.samples();
      return std::any_of(rates.begin(), rates.end(), [](float rate) { return rate > 0; });
    };
    if (unused && (!irradiance || !lit())) {
      comparisons.push_back(withoutPrediction(shot, *photo, view));
    } else {
      const PhotoNoise noise = estimateNoise({&*photo, &view.inside});
      ErrorSums* sums = unused ? nullptr : shot.holdout ? held : fitted;
      comparisons.push_back(
          predictPhoto(capture, s, *photo, noise, view, *irradiance, brdfs, materials, sums, deviation));
    }
    if (unused) comparisons.back().leftOut = reason->second;
    job.progress("predict", ++done, total, "photos");
  }
  return comparisons;
}

}  // namespace patina
