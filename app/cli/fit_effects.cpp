#include "app/cli/fit_effects.h"

#include <algorithm>
#include <filesystem>
#include <sstream>

#include "app/cli/fit_folder.h"
#include "engine/base/text.h"
#include "engine/effect/effect_info.h"
#include "engine/report/explanation_files.h"
#include "engine/report/explanation_words.h"

namespace patina::cli {

namespace fs = std::filesystem;

Result<WantedEffects> wantedEffects(const std::string& text, const std::string& kind) {
  WantedEffects wanted;
  if (text == "none") return wanted;
  wanted.none = false;
  if (text == "auto") {
    wanted.automatic = true;
    return wanted;
  }
  std::vector<std::string> possible;
  for (const EffectInfo* info : effectCatalogue())
    if (kind.empty() || (info->kinds & (kind == "two-shot" ? kTwoShotKind
                                        : kind == "flash"  ? kFlashKind
                                                           : kFourierKind)))
      possible.emplace_back(info->id);
  std::istringstream list(text);
  for (std::string id; std::getline(list, id, ',');) {
    if (std::ranges::find(possible, id) == possible.end()) {
      const std::string nearest = nearestWord(id, possible);
      std::string all = "none, auto";
      for (const std::string& one : possible) all += ", " + one;
      return Error{
          ErrorCode::Invalid,
          inQuotes(id) + (findEffect(id) ? " can't act in a capture of kind '" + kind + "'"
                                         : " is no effect" + (nearest.empty() || nearest == id
                                                                  ? std::string()
                                                                  : ". Did you mean " + nearest + "?")),
          "--effects", all};
    }
    if (std::ranges::find(wanted.ids, id) == wanted.ids.end()) wanted.ids.push_back(id);
  }
  if (wanted.ids.empty()) return Error{ErrorCode::Invalid, "no effect is named", "--effects", "none, auto"};
  return wanted;
}

void printFinding(const EffectFinding& finding, Console& console) {
  console.say("");
  console.say(effectTitle(finding.id) + " (" + finding.id + ")");
  if (!finding.sentence.empty()) console.say("  " + finding.sentence);
  std::string values;
  for (const EffectEstimate& estimate : finding.parameters)
    values += (values.empty() ? "" : "; ") + estimateText(estimate);
  if (!values.empty()) console.say("  " + values);
  std::string line = "  Evidence: " + evidenceWords(finding);
  if (finding.sigmas > 0) line += ", " + shortNumber(finding.sigmas) + " standard deviations";
  if (finding.confidence > 0) line += "; confidence " + percent(finding.confidence);
  if (finding.holdoutRmsWith >= 0 && finding.holdoutRmsWithout >= 0)
    line += "; error without it " + percent(finding.holdoutRmsWithout) + ", with it " +
            percent(finding.holdoutRmsWith);
  console.say(line);
}

int runFitWithEffects(const std::string& bundle, const std::string& out, const WantedEffects& wanted,
                      int size, Context& context) {
  if (isInside(out, bundle)) return refuseInside(out, bundle, context);
  if (const Status writable = checkWritable(out); !writable) return context.fail(writable.error());
  ExplainOptions options;
  options.size = size;
  options.pictures = false;
  const JobContext job = context.job();
  const std::vector<fs::path> bundles = {bundle};
  const Result<ExplanationPtr> explained =
      wanted.automatic ? explain(bundles, options, job) : explainWith(bundles, wanted.ids, options, job);
  if (!explained) return context.fail(explained.error());
  const Explanation& explanation = **explained;
  context.console.finishProgress();
  if (const Status written = writeExplainedFit(out, explanation); !written)
    return context.fail(written.error());
  if (wanted.automatic) {
    context.console.say(verdictOf(explanation).headline);
    for (const EffectFinding& finding : explanation.effects) printFinding(finding, context.console);
  } else {
    for (const EffectFinding& finding : explanation.effects) {
      context.console.say(effectTitle(finding.id) + " (" + finding.id + ")");
      if (!finding.sentence.empty()) context.console.say("  " + finding.sentence);
      for (const EffectEstimate& estimate : finding.parameters)
        context.console.say("  " + estimateText(estimate));
    }
  }
  context.console.say("");
  const bool held = explanation.after.holdoutRms >= 0;
  context.console.say(
      std::string("Error on ") + (held ? "held-out" : "fitted") + " photographs: " +
      percent(held ? explanation.before.holdoutRms : explanation.before.fitRms) + " without the effects, " +
      percent(held ? explanation.after.holdoutRms : explanation.after.fitRms) + " with them.");
  context.console.say("The fit is in " + out + ".");
  if (!explanation.cancelled) return kDone;
  context.console.complain("Cancelled: what was found until then is kept.");
  return kCancelled;
}

}  // namespace patina::cli
