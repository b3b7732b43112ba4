#include "app/cli/fit_two_shot.h"

#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <optional>

#include "app/cli/fit_folder.h"
#include "engine/base/text.h"
#include "engine/render/two_shot_pictures.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

/// A whole text as a number; empty where it isn't one.
template <typename Number>
std::optional<Number> parseNumber(const std::string& text) {
  Number value{};
  const char* end = text.data() + text.size();
  const auto [last, code] = std::from_chars(text.data(), end, value);
  if (code != std::errc() || last != end) return std::nullopt;
  return value;
}

std::string number(const char* pattern, double value) {
  char text[64];
  std::snprintf(text, sizeof text, pattern, value);
  return text;
}

void printTwoShotSummary(const TwoShotFit& fit, Context& context) {
  const TwoShotStats& stats = fit.stats;
  std::size_t fitted = 0;
  for (const TwoShotPhoto& shot : fit.capture.shots) fitted += !shot.holdout;
  for (const TwoShotComparison& shot : fit.comparisons) fitted -= !shot.leftOut.empty();
  const auto total = stats.seconds.find("total");
  context.console.say((stats.cancelled ? "Cancelled; kept " : "Reconstructed ") +
                      counted(fit.materials.size(), "material") + " from " + counted(fitted, "photograph") +
                      " in " + number("%.1f", total == stats.seconds.end() ? 0.0 : total->second) + " s.");
  for (const std::string& remark : stats.remarks) context.console.say(remark);
}

void printTwoShotStats(const TwoShotFit& fit, Context& context) {
  const TwoShotStats& stats = fit.stats;
  context.console.say("");
  context.console.say("Time, s");
  for (const auto& [stage, seconds] : stats.seconds) {
    context.console.say("  " + stage + std::string(stage.size() < 12 ? 12 - stage.size() : 1, ' ') +
                        number("%9.3f", seconds));
  }
  context.console.say("Pixels used " + std::to_string(stats.pixels) + ", in rows " +
                      std::to_string(stats.rows) + "; clipped " + std::to_string(stats.clippedPixels) +
                      ", not above black " + std::to_string(stats.darkPixels) + ", rows beyond the basis " +
                      std::to_string(stats.unreachedPixels));
  for (const TwoShotMaterial& material : fit.materials) {
    context.console.say("eta " + number("%.3g", material.eta[0]) + ", rows' residual " +
                        number("%.4f", material.residualSd.mean()) + " ln, expected " +
                        number("%.4f", material.expected.unseen) + " ln, share " +
                        number("%.3f", material.share));
  }
  for (const TwoShotComparison& comparison : fit.comparisons) {
    const char* role = comparison.holdout ? " (held out)" : comparison.leftOut.empty() ? "" : " (left out)";
    context.console.say(comparison.file + role + ": " +
                        (comparison.rms >= 0 ? "relative RMS " + number("%.4f", comparison.rms) + ", noise " +
                                                   number("%.4f", comparison.noiseFloor)
                                             : std::string("nothing to compare")));
  }
}

}  // namespace

int runTwoShotFit(const std::string& bundle, const std::string& out, const TwoShotArguments& arguments,
                  Context& context) {
  TwoShotFitOptions options;
  options.rowsPerShot = arguments.rowsPerShot;
  options.noiseWeights = !arguments.noNoiseWeights;
  options.basisFile = arguments.basis;
  if (arguments.eta == "auto") {
    options.chooseEta = true;
  } else {
    const auto eta = parseNumber<double>(arguments.eta);
    if (!eta)
      return context.misuse("--eta " + inQuotes(arguments.eta) + " is not a number. Try: 40, or auto.");
    options.eta = *eta;
  }
  if (arguments.clusters == "auto") {
    options.clusters = 0;
  } else {
    const auto clusters = parseNumber<int>(arguments.clusters);
    if (!clusters || *clusters < 1)
      return context.misuse("--clusters " + inQuotes(arguments.clusters) +
                            " is not a number of materials. Try: 2, or auto.");
    options.clusters = *clusters;
  }
  const std::vector<std::string> problems = options.validate();
  if (!problems.empty()) {
    std::string sentence;
    for (const std::string& problem : problems) sentence += (sentence.empty() ? "" : "; ") + problem;
    return context.misuse(sentence + ". Try: patina-cli fit --help.");
  }

  const JobContext job = context.job();
  Result<TwoShotCapture> capture = readTwoShotCapture(bundle, job);
  if (!capture) return context.fail(capture.error());
  if (isInside(out, capture->folder)) return refuseInside(out, capture->folder, context);
  if (Status writable = checkWritable(out); !writable) return context.fail(writable.error());
  Result<BasisPtr> basis = basisFor(arguments.basis, job);
  if (!basis) return context.fail(basis.error());

  Result<std::shared_ptr<const TwoShotFit>> fit = fitTwoShot(*capture, *basis, options, job);
  if (!fit) return context.fail(fit.error());
  // The fit is there, whole or as far as it came: its pictures, a second or two, don't stop half way and lose
  // it.
  JobContext pictures = job;
  pictures.stop = {};
  Status written = writeTwoShotFit(
      out, **fit, [&](const fs::path& folder) { return writeTwoShotPictures(folder, **fit, pictures); });
  if (!written) return context.fail(written.error());
  context.console.finishProgress();
  printTwoShotSummary(**fit, context);
  context.console.say("The BRDF is in " + (fs::path(out) / "brdf.binary").string() +
                      ", pictures in sphere.png and comparison.png, numbers in " +
                      (fs::path(out) / "fit.json").string() + ".");
  if (context.common.stats) printTwoShotStats(**fit, context);
  if (!(*fit)->stats.cancelled) return kDone;
  context.console.complain("Cancelled: what was reconstructed until then is kept, and fit.json says so.");
  return kCancelled;
}

}  // namespace patina::cli
