#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "engine/brdf/tabulated_brdf.h"
#include "engine/twoshot/cluster.h"
#include "engine/twoshot/fit.h"
#include "engine/twoshot/reflectance_picture.h"

namespace patina {

/// Sums behind a relative RMS, so that those of several photographs can be put together.
struct ErrorSums {
  double residual = 0, signal = 0, noise = 0;
  void add(const ErrorSums& other) {
    residual += other.residual, signal += other.signal, noise += other.noise;
  }
  double rms() const;         ///< sqrt(residual / signal); -1 without signal
  double noiseFloor() const;  ///< sqrt(noise / signal)
};

/// The photograph that the BRDFs predict, beside the captured one, over all pixels whose centre is on the
/// sample: BRDF * E cos(thetaI) * exposure, E from the white photograph or the bundle. Clipped pixels, and
/// pixels without a known E, are left out of the error (and 0 in `rendered` where E is unknown); a direction
/// that the table doesn't hold is predicted black and counts. `noise`: of the photograph's sensor.
/// `deviation`: how the photograph was really taken; the tables hold its terms of the surface already.
TwoShotComparison predictPhoto(const TwoShotCapture& capture, std::size_t shot, const Image& captured,
                               const PhotoNoise& noise, const SampleView& view,
                               const IrradiancePicture& irradiance,
                               const std::vector<std::shared_ptr<const TabulatedBrdf>>& brdfs,
                               const MaterialMap& materials, ErrorSums* sums,
                               const TwoShotDeviation* deviation = nullptr);

/// Reads photographs and their white photographs and predicts them: those for which `wanted` is true, all
/// where it is empty; fitted ones first, then those of `leftOut` (shot, reason), then those held out.
/// `fitted` and `held` collect the sums, to which what was left out adds nothing; where its light is unknown
/// it has no prediction. Progress: "predict", beginning at `done` of all shots. Errors: those of reading;
/// Cancelled.
Result<std::vector<TwoShotComparison>> compareShots(
    const TwoShotCapture& capture, const std::vector<TwoShotMaterial>& found, const MaterialMap& materials,
    const std::map<std::size_t, std::string>& leftOut, const JobContext& job, ErrorSums* fitted,
    ErrorSums* held, const std::vector<bool>& wanted = {}, std::int64_t done = 0,
    const TwoShotDeviation* deviation = nullptr);

}  // namespace patina
