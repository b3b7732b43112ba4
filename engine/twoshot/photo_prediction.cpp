#include "engine/twoshot/photo_prediction.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

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
                               const MaterialMap& materials, ErrorSums* sums) {
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
  tbb::parallel_for(tbb::blocked_range<int>(0, view.height), [&](const tbb::blocked_range<int>& range) {
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < view.width; ++x) {
        const std::size_t i = view.index(x, y);
        if (!view.onSample[i]) continue;
        // A pixel that the labels' picture doesn't see is taken for the largest material.
        const std::size_t material = labels[i] >= 0 ? static_cast<std::size_t>(labels[i]) : 0;
        const Eigen::Array3d brdf =
            brdfs[material]->evaluate(halfDiffFromDirections(photo.toLight, view.toView(i)));
        for (int c = 0; c < 3; ++c) {
          const double seen = captured.at(x, y, c);
          const double light = irradiance.rate.at(x, y, c) * photo.exposureS;
          const double predicted = std::isfinite(brdf[c]) ? brdf[c] * light : 0;
          comparison.captured.at(x, y, c) = static_cast<float>(seen);
          comparison.rendered.at(x, y, c) = static_cast<float>(predicted);
          if (!(light > 0) || seen >= clipped[c]) continue;
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

Result<std::vector<TwoShotComparison>> compareShots(const TwoShotCapture& capture,
                                                    const std::vector<TwoShotMaterial>& found,
                                                    const MaterialMap& materials, const JobContext& job,
                                                    ErrorSums* fitted, ErrorSums* held,
                                                    const std::vector<bool>& wanted, std::int64_t done) {
  std::vector<std::shared_ptr<const TabulatedBrdf>> brdfs;
  for (const TwoShotMaterial& material : found) brdfs.push_back(material.brdf);
  std::vector<TwoShotComparison> comparisons;
  const auto total = static_cast<std::int64_t>(capture.shots.size());
  for (const bool holdout : {false, true}) {
    for (std::size_t s = 0; s < capture.shots.size(); ++s) {
      const TwoShotPhoto& shot = capture.shots[s];
      if (shot.holdout != holdout || (!wanted.empty() && !wanted[s])) continue;
      if (job.cancelled())
        return Error{ErrorCode::Cancelled, "comparing the photographs was cancelled", "", ""};
      Result<Image> photo = readPhoto(capture, shot);
      if (!photo) return photo.error();
      const SampleView view = viewOf(capture, shot.camera);
      Result<IrradiancePicture> irradiance = irradianceOf(capture, shot, view, nullptr);
      if (!irradiance) return irradiance.error();
      const PhotoNoise noise = estimateNoise({&*photo, &view.inside});
      comparisons.push_back(predictPhoto(capture, s, *photo, noise, view, *irradiance, brdfs, materials,
                                         holdout ? held : fitted));
      job.progress("predict", ++done, total, "photos");
    }
  }
  return comparisons;
}

}  // namespace patina
