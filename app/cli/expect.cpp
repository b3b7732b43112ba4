#include <cmath>
#include <memory>

#include "app/cli/plan_report.h"
#include "app/cli/verbs.h"
#include "engine/base/text.h"
#include "engine/capture/two_shot_capture.h"
#include "engine/twoshot/plan.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

struct ExpectArguments {
  std::string what, basis, region;
  double eta = 0;  // 0: the plan's own, else the paper's
  bool compare = false, json = false;
  std::uint64_t seed = 0;
};

constexpr int kPoints = 300;

/// What the file or the bundle is expected to do.
Result<Plan> expectation(const ExpectArguments& arguments, const BasisPtr& basis, Context& context) {
  const auto regionOr = [&](BasisRegion otherwise) {
    return arguments.region.empty()        ? otherwise
           : arguments.region == "trusted" ? BasisRegion::Trusted
                                           : BasisRegion::All;
  };
  std::error_code code;
  const fs::path path = arguments.what;
  const bool bundle = fs::is_directory(path, code) || path.filename() == "capture.json";
  if (!bundle) {
    const Result<Plan> plan = readPlan(path);
    if (!plan) return plan.error();
    std::vector<ShotDirections> shots;
    for (const PlannedShot& shot : plan->shots) shots.push_back(shot.directions);
    Plan expected =
        expectationOf(basis, shots, {plan->options.fovDeg, kPoints}, regionOr(plan->options.region),
                      arguments.eta > 0 ? arguments.eta : plan->options.eta);
    expected.options.setup = plan->options.setup;
    return expected;
  }
  const fs::path folder = fs::is_directory(path, code) ? path
                          : path.has_parent_path()     ? path.parent_path()
                                                       : fs::path(".");
  const Result<std::string> kind = captureKind(folder);
  if (!kind) return kind.error();
  if (*kind != "two-shot")
    return Error{ErrorCode::Unsupported,
                 "the bundle is of kind " + inQuotes(*kind) + ", whose directions are not planned",
                 folder.string(), "name a bundle of kind two-shot, or a plan.json"};
  const Result<TwoShotCapture> capture = readTwoShotCapture(folder, context.job());
  if (!capture) return capture.error();
  return expectationOf(basis, *capture, regionOr(BasisRegion::All),
                       arguments.eta > 0 ? arguments.eta : kPaperEta);
}

int runExpect(const ExpectArguments& arguments, Context& context) {
  if (!(arguments.eta >= 0 && std::isfinite(arguments.eta)))
    return context.misuse("--eta must be positive. Try: --eta 40.");
  std::error_code code;
  if (!fs::exists(arguments.what, code))
    return context.fail({ErrorCode::NotFound, "there is nothing there", arguments.what,
                         "name a plan.json or the folder of a two-shot bundle"});
  JobContext job = context.job();
  job.seed = arguments.seed;
  const Result<BasisPtr> basis = basisFor(arguments.basis, job);
  if (!basis) return context.fail(basis.error());
  const Result<Plan> used = expectation(arguments, *basis, context);
  if (!used) return context.fail(used.error());

  std::optional<Plan> best;
  if (arguments.compare) {
    PlanOptions options = used->options;
    options.shots = static_cast<int>(used->shots.size());
    options.restarts = 4;
    if (const std::string problems = problemsOf(options); !problems.empty())
      return context.misuse("--compare can't search here: " + problems + ".");
    Result<Plan> found = planDirections(*basis, options, job);
    if (!found) return context.fail(found.error());
    best = std::move(*found);
  }
  context.console.finishProgress();
  if (arguments.json) {
    std::string json = planJson(*used);
    json.pop_back();
    context.console.say(json);
  } else {
    char line[200];
    std::snprintf(line, sizeof line,
                  "%zu photograph%s of a sample that subtends %.1f degrees; basis: %s, %zu materials.",
                  used->shots.size(), used->shots.size() == 1 ? "" : "s", used->options.fovDeg,
                  used->basisName.c_str(), used->materials.size());
    context.console.say(line);
    printPlan(*used, context);
    if (best) {
      context.console.say("");
      context.console.say("The best that a search finds for as many photographs:");
      printPlan(*best, context);
      std::snprintf(line, sizeof line, "The directions used cost %.0f %% more error than these.",
                    100 * (used->expected.unseen / best->expected.unseen - 1));
      context.console.say(used->expected.unseen > best->expected.unseen
                              ? line
                              : "The directions used are as good as these or better.");
    }
  }
  if (best && best->cancelled) return kCancelled;
  return kDone;
}

}  // namespace

void addExpectVerb(CLI::App& program, Context& context) {
  CLI::App* verb = program.add_subcommand(
      "expect", "Tells the expected error of directions: of a plan, or of those that a bundle really used");
  verb->set_help_flag("-h,--help", "Print this help");
  auto arguments = std::make_shared<ExpectArguments>();
  verb->add_option("PLAN_OR_BUNDLE", arguments->what,
                   "A plan.json, or the folder of a two-shot bundle (its photographs that a fit may read,\n"
                   "with the view directions of their own pixels)")
      ->required()
      ->option_text(" ");
  verb->add_option("--basis", arguments->basis,
                   "A basis made by 'patina-cli basis build' [default: the built-in one]")
      ->option_text("FILE");
  verb->add_option("--eta", arguments->eta,
                   "Weight of the basis against the measurements, for 300 rows a photograph [default: the\n"
                   "plan's, or 40]")
      ->option_text("ETA")
      ->check(CLI::PositiveNumber);
  verb->add_option("--region", arguments->region,
                   "Directions over which the error counts: all, or trusted for those within 81 degrees of\n"
                   "the normal [default: the plan's, or all]")
      ->check(CLI::IsMember({"all", "trusted"}))
      ->option_text("all|trusted");
  verb->add_flag("--compare", arguments->compare,
                 "Also search the best directions for as many photographs (some 10 seconds)");
  verb->add_option("--seed", arguments->seed, "Of the search of --compare [default: 0]")->option_text("N");
  verb->add_flag("--json", arguments->json, "Print the result as JSON, with the keys of plan.json");
  addCommonOptions(*verb, context);
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runExpect(*arguments, context); };
  });
}

}  // namespace patina::cli
