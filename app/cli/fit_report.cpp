#include "app/cli/fit_report.h"

#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <vector>

#include "engine/base/text.h"

namespace patina::cli {
namespace {

__attribute__((format(printf, 1, 2))) std::string format(const char* pattern, ...) {
  char text[512];
  va_list values;
  va_start(values, pattern);
  std::vsnprintf(text, sizeof text, pattern, values);
  va_end(values);
  return text;
}

/// Seconds of the whole fit.
double total(const FourierFitStats& stats) {
  const auto given = stats.seconds.find("total");
  if (given != stats.seconds.end()) return given->second;
  double seconds = 0;
  for (const auto& [stage, time] : stats.seconds) seconds += time;
  return seconds;
}

}  // namespace

void printSummary(const FourierFit& fit, Context& context) {
  const FourierFitStats& stats = fit.stats();
  const SvbrdfMaps& maps = fit.maps();
  context.console.say(format("%s %d x %d texels from %s in %.1f s.",
                             stats.cancelled ? "Cancelled; kept what was fitted of" : "Fitted", maps.width,
                             maps.height, counted(fit.capture().photos.size(), "photograph").c_str(),
                             total(stats)));
  if (stats.fitRms < 0) {
    context.console.say("Relative error: not computed.");
    return;
  }
  std::string errors = format("Relative error: %.2f %% of the photographs fitted", 100 * stats.fitRms);
  if (stats.noiseFloorFit > 0) errors += format(" (their noise: %.2f %%)", 100 * stats.noiseFloorFit);
  if (stats.holdoutRms >= 0) {
    errors += format(", %.2f %% of those held out", 100 * stats.holdoutRms);
    if (stats.noiseFloorHoldout > 0)
      errors += format(" (their noise: %.2f %%)", 100 * stats.noiseFloorHoldout);
  }
  context.console.say(errors + ".");
}

void printStats(const FourierFitStats& stats, Context& context) {
  Console& console = context.console;
  console.say("");
  console.say("Time, s");
  for (const auto& [stage, seconds] : stats.seconds) {
    if (stage == "total") continue;
    console.say(format("  %-22s %9.3f", stage.c_str(), seconds));
  }
  console.say(format("  %-22s %9.3f", "total", total(stats)));
  console.say(format("Threads                  %8d", stats.threads));
  console.say(format("Texels solved            %8zu", stats.texels));
  const auto solve = stats.seconds.find("solve");
  if (solve != stats.seconds.end() && solve->second > 0) {
    console.say(format("Texels a second (solve)  %8.0f", static_cast<double>(stats.texels) / solve->second));
  }
  console.say(format("Iterations a texel       %8.1f", stats.meanIterations));
  console.say("What became of the maps' texels");
  for (const auto& [name, count] : stats.statusCounts) {
    console.say(format("  %-22s %9zu", name.c_str(), count));
  }
  if (stats.fitRms >= 0) {
    console.say(
        format("Relative error, fitted   %8.5f  (noise floor %.5f)", stats.fitRms, stats.noiseFloorFit));
  } else {
    console.say("Relative error, fitted   not computed");
  }
  if (stats.holdoutRms >= 0) {
    console.say(format("Relative error, held out %8.5f  (noise floor %.5f)", stats.holdoutRms,
                       stats.noiseFloorHoldout));
  }
  console.say(format("Noise variance           %.3g * radiance + %.3g^2", stats.noiseShot, stats.noiseRead));
  console.say(format("Clipped samples          %8zu", stats.clippedSamples));
  console.say(format("  measurements left out  %8zu", stats.droppedRows));
  console.say(format("  points with too few    %8zu", stats.clippedSites));
  if (stats.resumedTexels > 0) console.say(format("Texels taken over        %8zu", stats.resumedTexels));
  console.say(std::string("Measurements were in     ") +
              (stats.measurementsOnDisk ? "a scratch file" : "memory"));
  console.say(
      format("Peak memory, MiB         %8.0f", static_cast<double>(stats.peakBytes) / (1024.0 * 1024.0)));
}

void printTexel(const FourierFit& fit, int texelX, int texelY, Context& context) {
  Console& console = context.console;
  const SvbrdfMaps& maps = fit.maps();
  const SvbrdfParameters p = fit.parametersAt(texelX, texelY);
  const double xMm = ((texelX + 0.5) / maps.width - 0.5) * maps.widthMm;
  const double yMm = (0.5 - (texelY + 0.5) / maps.height) * maps.heightMm;
  console.say("");
  console.say(format("Texel %d,%d at x = %.2f mm, y = %.2f mm, status %d, residual %.4f", texelX, texelY, xMm,
                     yMm, static_cast<int>(maps.status.at(texelX, texelY)),
                     double{maps.residual.at(texelX, texelY)}));
  console.say(format("  diffuse   R %.5f  G %.5f  B %.5f", double{p.diffuse[0]}, double{p.diffuse[1]},
                     double{p.diffuse[2]}));
  console.say(format("  specular  R %.5f  G %.5f  B %.5f", double{p.specular[0]}, double{p.specular[1]},
                     double{p.specular[2]}));
  console.say(format("  normal    X %.5f  Y %.5f  Z %.5f", double{p.normal[0]}, double{p.normal[1]},
                     double{p.normal[2]}));
  console.say(format("  sigma     %.5f   kurtosis %.4f", double{p.sigma}, double{p.kurtosis}));
  console.say(
      "  frequency  split    channel  measured re    im           model re       im           "
      "residual/noise  re      im");
  constexpr char kChannels[] = "RGB";
  for (const SpectrumSample& sample : fit.spectrumAt(texelX, texelY)) {
    for (std::size_t c = 0; c < 3; ++c) {
      const std::complex<float> model = sample.diffuse[c] + sample.specular[c];
      const std::complex<float> residual = model - sample.measured[c];
      const double noise = sample.noiseSigma[c] > 0 ? double{sample.noiseSigma[c]} : NAN;
      console.say(format("  %4d,%-4d  %-7s  %c        % .5e  % .5e  % .5e  % .5e  %12.2f  %8.2f",
                         sample.frequency.x(), sample.frequency.y(), sample.holdout ? "holdout" : "fit",
                         kChannels[c], double{sample.measured[c].real()}, double{sample.measured[c].imag()},
                         double{model.real()}, double{model.imag()}, residual.real() / noise,
                         residual.imag() / noise));
    }
  }
}

}  // namespace patina::cli
