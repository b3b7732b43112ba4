#pragma once

#include <functional>
#include <span>
#include <string_view>
#include <vector>

#include "engine/fourier/measurements.h"

namespace patina {

class PhotoCorrection;

/// Some image rows of all photographs, at the sites on them. Where sites are groups of pixels, each strip
/// brings a part of their sum; parts add up to the mean.
struct SiteStrip {
  SiteRun run;                                      ///< of sites that the rows touch
  std::vector<std::span<const float>> values;       ///< by photograph: [site - run.first][R G B]
  std::vector<std::vector<std::uint32_t>> clipped;  ///< by photograph: the site of every saturated pixel
};

/// Reads photographs (indices into capture.photos) strip by strip, all of them side by side, each file once
/// from top to bottom, and hands every strip to `take`, one after the other. The strips take an eighth of the
/// memory limit, or 16 rows where that is more. `correction` is undone pixel by pixel, after the look for
/// saturated ones; null: nothing. Errors: those of readPhoto; what `take` returns; Cancelled.
Status readSites(const FourierCapture& capture, const SiteSet& sites, std::span<const int> photos,
                 const MeasurementStorage& storage, std::string_view stage, const JobContext& job,
                 const PhotoCorrection* correction, const std::function<Status(const SiteStrip&)>& take);

}  // namespace patina
