#include "app/cli/fit_flash.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <sstream>

#include "app/cli/fit_folder.h"
#include "engine/base/text.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

std::string number(const char* pattern, double value) {
  char text[64];
  std::snprintf(text, sizeof text, pattern, value);
  return text;
}

void printFlashSummary(const FlashFit& fit, Context& context) {
  const FlashFitStats& stats = fit.stats;
  const auto total = stats.seconds.find("total");
  context.console.say((stats.cancelled ? "Cancelled; kept " : "Fitted ") + std::to_string(fit.maps.width) +
                      " x " + std::to_string(fit.maps.height) + " texels of " +
                      counted(fit.model.materials.size(), "material") + " in " +
                      number("%.1f", total != stats.seconds.end() ? total->second : 0) + " s.");
  if (stats.fitRms >= 0)
    context.console.say("Relative RMS of fitted photographs: " + number("%.4f", stats.fitRms) + ", noise " +
                        number("%.4f", stats.noiseFloorFit));
  if (stats.holdoutRms >= 0)
    context.console.say("Relative RMS of held-out photographs: " + number("%.4f", stats.holdoutRms) +
                        ", noise " + number("%.4f", stats.noiseFloorHoldout));
  for (const std::string& remark : stats.remarks) context.console.say(remark);
}

void printFlashStats(const FlashFit& fit, Context& context) {
  for (const auto& [stage, seconds] : fit.stats.seconds)
    context.console.say("seconds " + stage + ": " + number("%.2f", seconds));
  for (const auto& [status, count] : fit.stats.statusCounts)
    context.console.say("texels " + status + ": " + std::to_string(count));
  context.console.say("iterations a texel: " + number("%.2f", fit.stats.meanIterations));
  context.console.say("clipped values: " + std::to_string(fit.stats.clippedSamples));
  for (const FlashComparison& photo : fit.comparisons)
    context.console.say(photo.file + (photo.holdout ? " (held out)" : "") + ": relative RMS " +
                        number("%.4f", photo.rms) + ", noise " + number("%.4f", photo.noiseFloor));
}

}  // namespace

int runFlashFit(const std::string& bundle, const std::string& out, const FlashArguments& arguments,
                Context& context) {
  FlashFitOptions options;
  options.size = arguments.size;
  options.materials = arguments.materials;
  if (arguments.effects != "none") {
    std::vector<std::string> ids;
    for (const FlashEffect effect : allFlashEffects()) ids.push_back(flashEffectId(effect));
    std::istringstream list(arguments.effects);
    for (std::string id; std::getline(list, id, ',');) {
      const auto found = std::find(ids.begin(), ids.end(), id);
      if (found == ids.end()) {
        const std::string nearest = nearestWord(id, ids);
        std::string all;
        for (const std::string& one : ids) all += (all.empty() ? "" : ", ") + one;
        return context.misuse("--effects " + inQuotes(id) + " is no effect that flash photographs can show" +
                              (nearest.empty() ? "" : ". Did you mean " + nearest + "?") +
                              " Try: none, or one or more of " + all + ".");
      }
      const auto effect = static_cast<FlashEffect>(found - ids.begin());
      if (std::find(options.effects.begin(), options.effects.end(), effect) == options.effects.end())
        options.effects.push_back(effect);
    }
  }
  const std::vector<std::string> problems = options.validate();
  if (!problems.empty()) {
    std::string sentence;
    for (const std::string& problem : problems) sentence += (sentence.empty() ? "" : "; ") + problem;
    return context.misuse(sentence + ". Try: patina-cli fit --help.");
  }
  const JobContext job = context.job();
  Result<FlashCapture> capture = readFlashCapture(bundle, job);
  if (!capture) return context.fail(capture.error());
  if (isInside(out, capture->folder)) return refuseInside(out, capture->folder, context);
  if (Status writable = checkWritable(out); !writable) return context.fail(writable.error());
  Result<std::shared_ptr<const FlashFit>> fit = fitFlash(*capture, options, job);
  if (!fit) return context.fail(fit.error());
  if (Status written = writeFlashFit(out, **fit); !written) return context.fail(written.error());
  context.console.finishProgress();
  printFlashSummary(**fit, context);
  context.console.say("Maps are in " + (fs::path(out) / "maps").string() + ", numbers in " +
                      (fs::path(out) / "fit.json").string() + ".");
  if (context.common.stats) printFlashStats(**fit, context);
  if (!(*fit)->stats.cancelled) return kDone;
  context.console.complain(
      "Cancelled: texels that weren't reached hold the coarser solution; status.exr marks them (6), and "
      "fit.json says so.");
  return kCancelled;
}

}  // namespace patina::cli
