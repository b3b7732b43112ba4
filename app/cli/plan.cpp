#include "engine/twoshot/plan.h"

#include <unistd.h>

#include <charconv>
#include <memory>
#include <numbers>

#include "app/cli/plan_report.h"
#include "app/cli/verbs.h"
#include "engine/base/atomic_file.h"
#include "engine/base/text.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kRobustDeg = 1.5;

struct PlanArguments {
  std::string out, basis, setup = "free", metric = "expected-error", region = "all";
  std::vector<std::string> given;
  bool robust = false, json = false;
  std::uint64_t seed = 0;
  PlanOptions options;
};

Eigen::Vector3d direction(double angleDeg, double azimuthDeg) {
  const double t = angleDeg * kDegree, a = azimuthDeg * kDegree;
  return {std::sin(t) * std::cos(a), std::sin(t) * std::sin(a), std::cos(t)};
}

/// Numbers between commas; empty where it is anything else.
std::vector<double> numbersOf(const std::string& text) {
  std::vector<double> numbers;
  const char *at = text.data(), *end = at + text.size();
  while (at < end) {
    double value = 0;
    const auto [next, code] = std::from_chars(at, end, value);
    if (code != std::errc() || !std::isfinite(value)) return {};
    numbers.push_back(value);
    at = next;
    while (at < end && *at == ' ') ++at;
    if (at == end) return numbers;
    if (*at != ',') return {};
    ++at;
    while (at < end && *at == ' ') ++at;
  }
  return {};
}

/// --given as (theta_h, theta_d, phi_d); as camera and light angles; or the photographs of a plan.
Result<std::vector<ShotDirections>> givenShots(const std::string& text) {
  const std::vector<double> numbers = numbersOf(text);
  if (numbers.size() == 3)
    return std::vector{shotFromHalfDiff({numbers[0] * kDegree, numbers[1] * kDegree, numbers[2] * kDegree})};
  if (numbers.size() == 4)
    return std::vector{ShotDirections{direction(numbers[2], numbers[3]), direction(numbers[0], numbers[1])}};
  if (!numbers.empty())
    return Error{ErrorCode::Invalid, "a photograph is given by 3 or 4 angles", "--given " + text,
                 "--given theta_h,theta_d,phi_d"};
  const Result<Plan> plan = readPlan(text);
  if (!plan) return plan.error();
  std::vector<ShotDirections> shots;
  for (const PlannedShot& shot : plan->shots) shots.push_back(shot.directions);
  return shots;
}

/// Fails now rather than after a minute of search.
Status checkOut(const fs::path& out) {
  std::error_code code;
  const fs::path folder = out.has_parent_path() ? out.parent_path() : fs::path(".");
  if (fs::is_directory(out, code))
    return Error{ErrorCode::Refused, "a folder stands where the plan should go", out.string(),
                 (out / "plan.json").string()};
  if (fs::exists(folder, code) ? ::access(folder.c_str(), W_OK) != 0 || !fs::is_directory(folder, code)
                               : false)
    return Error{ErrorCode::WriteFailed, "the plan can't be written there", folder.string(),
                 "choose another folder"};
  return Done{};
}

/// The drawing first, so that where there is a plan there is its drawing.
Status writeBoth(const fs::path& out, const fs::path& drawing, const Plan& plan) {
  std::error_code code;
  if (out.has_parent_path()) fs::create_directories(out.parent_path(), code);
  const bool drawnBefore = fs::exists(drawing, code);
  if (const Status drawn = writeFileAtomically(drawing, drawPlanSvg(plan)); !drawn) return drawn;
  const Status written = writePlan(out, plan);
  if (!written && !drawnBefore) fs::remove(drawing, code);
  return written;
}

int runPlan(PlanArguments& arguments, Context& context) {
  PlanOptions& options = arguments.options;
  options.setup = arguments.setup == "fixed-camera"  ? PlanSetup::FixedCamera
                  : arguments.setup == "fixed-light" ? PlanSetup::FixedLight
                                                     : PlanSetup::Free;
  options.metric =
      arguments.metric == "condition-number" ? PlanMetric::ConditionNumber : PlanMetric::ExpectedError;
  options.region = arguments.region == "trusted" ? BasisRegion::Trusted : BasisRegion::All;
  if (arguments.robust && options.poseErrorDeg == 0) options.poseErrorDeg = kRobustDeg;
  const fs::path out = arguments.out;
  fs::path drawing = out;
  drawing.replace_extension(".svg");
  if (drawing == out)
    return context.misuse("the plan is written as JSON, and its drawing as " + drawing.string() +
                          " beside it. Try: --out " + fs::path(out).replace_extension(".json").string() +
                          ".");
  for (const std::string& text : arguments.given) {
    Result<std::vector<ShotDirections>> shots = givenShots(text);
    if (!shots) {
      if (shots.error().code == ErrorCode::Invalid) return context.misuse(shots.error().sentence());
      return context.fail(shots.error());
    }
    options.given.insert(options.given.end(), shots->begin(), shots->end());
  }
  if (const std::string problems = problemsOf(options); !problems.empty())
    return context.misuse(problems + ". Try: patina-cli plan --help.");
  if (const Status writable = checkOut(out); !writable) return context.fail(writable.error());

  JobContext job = context.job();
  job.seed = arguments.seed;
  const Result<BasisPtr> basis = basisFor(arguments.basis, job);
  if (!basis) return context.fail(basis.error());
  const Result<Plan> plan = planDirections(*basis, options, job);
  context.console.finishProgress();
  if (!plan) return context.fail(plan.error());
  if (const Status written = writeBoth(out, drawing, *plan); !written) return context.fail(written.error());

  if (arguments.json) {
    std::string json = planJson(*plan);
    json.pop_back();
    context.console.say(json);
  } else {
    printPlan(*plan, context);
    const bool few =
        options.fovDeg > 0 && options.metric == PlanMetric::ExpectedError && plan->shots.size() <= 2;
    if (few && !plan->cancelled)
      if (const auto more = oneMore(*basis, *plan, job)) printOneMore(*plan, *more, context);
    context.console.say("The plan is in " + out.string() + ", drawn in " + drawing.string() + ".");
  }
  if (context.common.stats) {
    char line[160];
    std::snprintf(line, sizeof line, "Searched for %.1f s; the restarts ended at", plan->seconds);
    std::string text = line;
    for (const double error : plan->restartErrors) {
      std::snprintf(line, sizeof line, " %.4g", error);
      text += line;
    }
    context.console.say(text + ".");
  }
  if (!plan->cancelled) return kDone;
  context.console.complain("Cancelled: the plan holds the best that was found until then, and says so.");
  return kCancelled;
}

}  // namespace

void addPlanVerb(CLI::App& program, Context& context) {
  CLI::App* verb = program.add_subcommand(
      "plan", "Finds camera and light directions that tell most about a flat sample's BRDF");
  verb->set_help_flag("-h,--help", "Print this help");
  auto arguments = std::make_shared<PlanArguments>();
  PlanOptions& options = arguments->options;
  const auto byDefault = [](const std::string& text, auto value) {
    std::ostringstream out;
    out << text << " [default: " << value << "]";
    return out.str();
  };
  verb->add_option("--shots", options.shots, byDefault("Photographs to plan, 1 to 30", options.shots))
      ->option_text("N");
  verb->add_option("--fov", options.fovDeg,
                   byDefault("Angle that the sample subtends from straight above, degrees; 0: point samples",
                             options.fovDeg))
      ->option_text("DEG");
  verb->add_option("--out", arguments->out,
                   "File for the plan (JSON); a drawing of the same name with .svg goes beside it")
      ->required()
      ->option_text("plan.json");
  verb->add_option("--setup", arguments->setup,
                   byDefault("What may move between photographs: both camera and light (free), the light\n"
                             "only (fixed-camera), the camera only (fixed-light)",
                             "free"))
      ->check(CLI::IsMember({"free", "fixed-camera", "fixed-light"}))
      ->option_text("free|fixed-camera|fixed-light");
  verb->add_option("--basis", arguments->basis,
                   "A basis made by 'patina-cli basis build' [default: the built-in one]")
      ->option_text("FILE");
  verb->add_option("--given", arguments->given,
                   "A photograph that is already decided or taken, as theta_h,theta_d,phi_d or as camera\n"
                   "angle,azimuth,light angle,azimuth (degrees), or a plan.json for all of its photographs;\n"
                   "the search adds --shots more. May be repeated")
      ->option_text("ANGLES|FILE");

  constexpr const char* kCounts = "What counts";
  verb->add_flag("--robust", arguments->robust,
                 "Directions that may be off by 1.5 degrees: the same as --pose-error 1.5")
      ->group(kCounts);
  verb->add_option("--pose-error", options.poseErrorDeg,
                   byDefault("Average the error over camera and light off by this much, degrees; slower,\n"
                             "keeps away from cliffs",
                             0))
      ->option_text("DEG")
      ->group(kCounts);
  verb->add_option("--region", arguments->region,
                   byDefault("Directions over which the error counts: all, or trusted for those within 81\n"
                             "degrees of the normal, where measured BRDFs are good; photographs then\n"
                             "stay within them too",
                             "all"))
      ->check(CLI::IsMember({"all", "trusted"}))
      ->option_text("all|trusted")
      ->group(kCounts);
  verb->add_option("--metric", arguments->metric,
                   byDefault("What is minimised: the expected error, or the condition number for comparison",
                             "expected-error"))
      ->check(CLI::IsMember({"expected-error", "condition-number"}))
      ->option_text("expected-error|condition-number")
      ->group(kCounts);
  verb->add_option(
          "--eta", options.eta,
          byDefault("Weight of the basis against the measurements, for 300 rows a photograph", options.eta))
      ->option_text("ETA")
      ->group(kCounts);
  verb->add_option(
          "--max-angle", options.maxAngleDeg,
          byDefault("Camera and light no further than this from the normal, degrees", options.maxAngleDeg))
      ->option_text("DEG")
      ->group(kCounts);

  constexpr const char* kSearch = "The search";
  verb->add_option(
          "--restarts", options.restarts,
          byDefault("Whole searches, the best of which is kept; more: slower, better", options.restarts))
      ->option_text("N")
      ->group(kSearch);
  verb->add_option("--candidates", options.candidates,
                   byDefault("Random directions tried for each photograph", options.candidates))
      ->option_text("N")
      ->group(kSearch);
  verb->add_option("--points", options.pointsPerShot,
                   byDefault("Points of the disc a photograph while searching", options.pointsPerShot))
      ->option_text("N")
      ->group(kSearch);
  verb->add_option("--seed", arguments->seed,
                   byDefault("Of the random numbers: the same seed, the same plan", 0))
      ->option_text("N")
      ->group(kSearch);
  verb->add_flag("--json", arguments->json, "Print the plan as JSON instead of a table");
  addCommonOptions(*verb, context);
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runPlan(*arguments, context); };
  });
}

}  // namespace patina::cli
