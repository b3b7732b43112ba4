#include <filesystem>
#include <string>
#include <vector>

#include "app/cli/fit_effects.h"
#include "app/cli/fit_folder.h"
#include "app/cli/verbs.h"
#include "engine/capture/two_shot_capture.h"
#include "engine/diagnosis/explanation.h"
#include "engine/report/explanation_files.h"
#include "engine/report/explanation_words.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

struct ExplainArguments {
  std::vector<std::string> bundles;
  std::string out;
  bool noPictures = false;
  ExplainOptions options;
};

/// What was not added and still speaks against the model is worth a line each; beyond this many,
/// explain.json.
constexpr std::size_t kMostConsidered = 5;

void printSummary(const Explanation& explanation, Console& console) {
  const ExplanationVerdict verdict = verdictOf(explanation);
  console.say(verdict.headline);
  console.say(verdict.detail);
  for (const EffectFinding& finding : explanation.effects) printFinding(finding, console);
  std::size_t shown = 0;
  for (const EffectFinding& finding : explanation.considered) {
    if (finding.correctedP > 0.05 || shown == kMostConsidered) continue;
    if (shown++ == 0) {
      console.say("");
      console.say("Considered and not added:");
    }
    console.say("  " + effectTitle(finding.id) + " (" + finding.id + "): " + finding.verdict);
  }
  if (!explanation.confusable.empty() || !explanation.suggest.empty()) console.say("");
  for (const auto& group : explanation.confusable) {
    if (group.size() < 2) continue;
    std::string names;
    for (const std::string& id : group) names += (names.empty() ? "" : ", ") + id;
    console.say("Not told apart by these photographs: " + names + ".");
  }
  for (const Suggestion& suggestion : explanation.suggest)
    console.say("To tell " + suggestion.separatesA + " from " + suggestion.separatesB + ": " +
                suggestion.capture);
  if (!explanation.remarks.empty()) console.say("");
  for (const std::string& remark : explanation.remarks) console.say(remark);
}

int runExplain(const ExplainArguments& arguments, Context& context) {
  ExplainOptions options = arguments.options;
  options.pictures = !arguments.noPictures;
  const std::vector<std::string> problems = options.validate();
  if (!problems.empty()) {
    std::string sentence;
    for (const std::string& problem : problems) sentence += (sentence.empty() ? "" : "; ") + problem;
    return context.misuse(sentence + ". Try: patina-cli explain --help.");
  }
  const std::vector<fs::path> bundles(arguments.bundles.begin(), arguments.bundles.end());
  for (const fs::path& bundle : bundles)
    if (isInside(arguments.out, bundle)) return refuseInside(arguments.out, bundle, context);
  const JobContext job = context.job();
  // Before the result's place is tried: what is no bundle is the better thing to be told of.
  for (const fs::path& bundle : bundles)
    if (const auto kind = captureKind(bundle); !kind) return context.fail(kind.error());
  if (const Status writable = checkWritable(arguments.out); !writable) return context.fail(writable.error());

  const Result<ExplanationPtr> explained = explain(bundles, options, job);
  if (!explained) return context.fail(explained.error());
  const Explanation& explanation = **explained;
  context.console.finishProgress();
  if (const Status written = writeExplanation(arguments.out, explanation); !written)
    return context.fail(written.error());
  printSummary(explanation, context.console);
  context.console.say("");
  context.console.say("The report is " + (fs::path(arguments.out) / "report.html").string() +
                      ", its numbers are in explain.json, and the final fit is beside them.");
  if (context.common.stats) {
    context.console.say("");
    context.console.say("Time, s");
    for (const auto& [stage, seconds] : explanation.seconds)
      context.console.say("  " + stage + std::string(stage.size() < 22 ? 22 - stage.size() : 1, ' ') +
                          shortNumber(seconds));
  }
  if (!explanation.cancelled) return kDone;
  context.console.complain("Cancelled: what was found until then is kept, and explain.json says so.");
  return kCancelled;
}

}  // namespace

void addExplainVerb(CLI::App& program, Context& context) {
  auto arguments = std::make_shared<ExplainArguments>();
  const ExplainOptions defaults;
  CLI::App* verb = program.add_subcommand(
      "explain",
      "Find out what the model lacks: fit, trace the residual to an effect, add it, fit again, and\n"
      "report the error before and after on photographs that the fit never saw");
  verb->add_option(
          "bundles", arguments->bundles,
          "Capture bundles of one kind: the one to explain, then others of the same rig or the same\n"
          "sample, which are explained together with it")
      ->required()
      ->option_text("BUNDLE...");
  verb->add_option(
          "--out", arguments->out,
          "Folder for explain.json, report.html and the final fit (maps/, fit.json); made if missing,\n"
          "replaced only where names are the same")
      ->required()
      ->option_text("DIR");
  verb->add_option("--size", arguments->options.size,
                   "Longest side of the maps, texels; 0: what the photographs resolve [default: " +
                       std::to_string(defaults.size) + "]")
      ->option_text("N");
  verb->add_option("--texels", arguments->options.testedTexels,
                   "Points of the sample on which effects are tested; more: slower, finer [default: " +
                       std::to_string(defaults.testedTexels) + "]")
      ->option_text("N");
  verb->add_option("--max-effects", arguments->options.maxEffects,
                   "Effects added at most [default: " + std::to_string(defaults.maxEffects) + "]")
      ->option_text("N");
  verb->add_option(
          "--false-alarms", arguments->options.falseAlarmRate,
          "Chance of adding an effect to photographs that have none, over all that are tried; lower:\n"
          "misses weaker effects [default: 0.01]")
      ->option_text("SHARE");
  verb->add_flag("--no-pictures", arguments->noPictures, "A report without pictures of photographs");
  addCommonOptions(*verb, context);
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runExplain(*arguments, context); };
  });
}

}  // namespace patina::cli
