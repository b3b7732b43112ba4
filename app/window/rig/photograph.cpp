#include "app/window/rig/photograph.h"

#include <algorithm>
#include <cmath>

#include "engine/acquire/exposure.h"

namespace patina {

namespace {
constexpr int kAttempts = 7;
constexpr double kPercentile = 0.995;  ///< the brightest half per cent may be highlights
constexpr double kNear = 0.15;         ///< so near to the exposure wanted is near enough
}  // namespace

Result<Photograph> takePhotograph(CameraDevice& camera, const PhotographOptions& options,
                                  const JobContext& job) {
  std::optional<CameraControl> exposure;
  if (const auto controls = camera.controls(); controls) {
    for (const CameraControl& control : *controls)
      if (control.id == CameraControlId::ExposureS && control.writable) exposure = control;
  } else {
    return controls.error();
  }
  StillRequest request;
  request.notBefore = options.notBefore;
  if (exposure) {
    request.exposureS =
        std::clamp(options.exposureS.value_or(exposure->value), exposure->least, exposure->most);
    if (!options.exposureS)
      request.exposureS =
          wholeRefreshes(*request.exposureS, options.refreshHz, exposure->least, exposure->most);
  }
  Photograph photograph;
  for (int attempt = 0;; ++attempt) {
    job.progress("photograph", attempt, kAttempts, "attempts");
    Result<std::vector<Frame>> frames = camera.still(request, job.stop);
    if (!frames) return frames.error();
    Result<Image> image = linearImage(frames->front(), options.conversion);
    if (!image) return image.error();
    const Result<Image> clipped = clippedMask(frames->front());
    double clippedShare = 0;
    if (clipped) {
      for (const float sample : clipped->samples()) clippedShare += sample;
      clippedShare /= std::max<double>(1, static_cast<double>(clipped->samples().size()));
    }
    photograph.exposureS = frames->front().metadata.exposureS.value_or(request.exposureS.value_or(0.0));
    photograph.clippedShare = clippedShare;
    photograph.image = std::move(*image);
    if (!exposure || options.exposureS || attempt + 1 >= kAttempts) break;
    const double wanted = wholeRefreshes(exposureFor(photograph.image, {}, *request.exposureS, options.fill,
                                                     kPercentile, exposure->least, exposure->most),
                                         options.refreshHz, exposure->least, exposure->most);
    if (std::abs(wanted / *request.exposureS - 1) < kNear) break;
    request.exposureS = wanted;
  }
  if (options.frames > 1) {
    request.frames = options.frames;
    Result<std::vector<Frame>> frames = camera.still(request, job.stop);
    if (!frames) return frames.error();
    Result<Image> image = meanImage(*frames, options.conversion);
    if (!image) return image.error();
    photograph.image = std::move(*image);
  }
  job.progress("photograph", kAttempts, kAttempts, "attempts");
  return photograph;
}

}  // namespace patina
