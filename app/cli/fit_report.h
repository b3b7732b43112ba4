#pragma once

#include <filesystem>
#include <string>

#include "app/cli/verbs.h"
#include "engine/fourier/fit.h"

namespace patina::cli {

/// One or two lines: what came out, how well it predicts.
void printSummary(const FourierFit& fit, Context& context);

/// --stats: seconds by stage, texels per second, iterations, errors, noise, what became of the texels,
/// memory.
void printStats(const FourierFitStats& stats, Context& context);

/// --texel x,y: parameters, and every sample with the model's value and the residual in standard deviations
/// of the noise. The texel must be on the maps.
void printTexel(const FourierFit& fit, int texelX, int texelY, Context& context);

/// --dump-dir: pictures of the stages, for eyes: `window_minus_black.exr` and `.png` (camera pixels),
/// `spectrum_measured.exr` and `spectrum_model.exr` (|Z| over the sample, green, one layer a frequency, DC
/// first), `residual_dc.exr`, and every map as PNG. Written atomically. Errors: those of `readPhoto` and
/// `writeExr`; Cancelled.
Status writeDump(const std::filesystem::path& folder, const FourierFit& fit, const JobContext& job);

}  // namespace patina::cli
