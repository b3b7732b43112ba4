#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "app/cli/interrupt.h"
#include "app/cli/verbs.h"
#include "engine/base/text.h"

namespace patina::cli {

JobContext Context::job() {
  JobContext job;
  job.stop = stop;
  job.progressSink = &console;
  job.logSink = &console;
  job.threads = common.threads;
  return job;
}

int Context::fail(const Error& error) {
  console.complain(error.code == ErrorCode::Cancelled ? "Cancelled: " : "Error: ", error);
  return error.code == ErrorCode::Cancelled ? kCancelled : kBadInput;
}

int Context::misuse(const std::string& sentence) {
  console.complain("Error: ", Error{ErrorCode::Invalid, sentence, "", ""});
  return kWrongUse;
}

void addCommonOptions(CLI::App& verb, Context& context) {
  constexpr int kMostThreads = 1024;  // a typing error beyond
  constexpr const char* kGroup = "Options of every verb";
  verb.add_option_function<std::string>(
          "--progress",
          [&context](const std::string& style) {
            context.common.progressJson = style == "json";
            context.console.useJson(context.common.progressJson);
            sayNothingOnInterrupt(context.common.progressJson);
          },
          "How progress is shown on stderr: text, or json for one object a line,\n"
          "{\"stage\", \"done\", \"total\", \"unit\"}, and a failure as\n"
          "{\"error\": {\"what\", \"where\", \"try\"}} [default: text]")
      ->check(CLI::IsMember({"text", "json"}))
      ->option_text("text|json")
      ->group(kGroup);
  verb.add_option("--threads", context.common.threads, "Threads to work with; 0: one a core [default: 0]")
      ->check(CLI::Range(0, kMostThreads))
      ->option_text("N")
      ->group(kGroup);
  verb.add_flag("--stats", context.common.stats, "Print times (seconds), counts and peak memory at the end")
      ->group(kGroup);
}

namespace {

std::vector<std::string> verbNames(CLI::App& program) {
  std::vector<std::string> names;
  for (const CLI::App* verb : program.get_subcommands([](CLI::App*) { return true; })) {
    names.push_back(verb->get_name());
  }
  return names;
}

int runProgram(int argc, char** argv) {
  Context context;
  context.stop = stopOnInterrupt();

  CLI::App program("Fits material maps to photographs of a sample lit by patterns on a screen.",
                   "patina-cli");
  program.set_version_flag("--version", "patina-cli " PATINA_VERSION, "Print the version");
  program.set_help_flag("-h,--help", "Print this help; 'patina-cli VERB --help' says more about one verb");
  program.require_subcommand(0, 1);
  program.get_formatter()->column_width(34);
  program.footer(
      "Exit status: 0 done; 1 a fault of Patina's; 2 wrong use; 3 bad input (what, where and what to try are "
      "on stderr);\n"
      "4 cancelled (what was finished is kept and marked).");
#ifdef PATINA_HAS_DEMO
  addDemoVerb(program, context);
#endif
  addCaptureVerb(program, context);
  addFitVerb(program, context);
#ifdef PATINA_HAS_EXPLAIN
  addExplainVerb(program, context);
#endif
  addBrdfVerb(program, context);
  addPlanVerb(program, context);
  addExpectVerb(program, context);
  addBasisVerb(program, context);
  addCalibrateVerb(program, context);
  addMissingVerbs(program, context);
  program.allow_extras();  // after the verbs, which would inherit it: an unknown verb is told from an unknown
                           // option below

  try {
    program.parse(argc, argv);
  } catch (const CLI::Success& request) {  // --help, --version
    program.exit(request);
    return kDone;
  } catch (const CLI::ParseError& failure) {
    const auto chosen = program.get_subcommands();
    const std::string verb = chosen.empty() ? "" : " " + chosen.front()->get_name();
    return context.misuse(std::string(failure.what()) + ". Try: patina-cli" + verb + " --help.");
  }
  if (context.run) {
    const int status = context.run();
    context.console.finishProgress();
    return status;
  }

  const std::vector<std::string> extras = program.remaining();
  if (extras.empty()) {
    std::fputs(program.help().c_str(), stderr);
    return context.misuse("a verb is needed, for example: patina-cli fit BUNDLE --out DIR.");
  }
  const std::string nearest = nearestWord(extras.front(), verbNames(program));
  return context.misuse(inQuotes(extras.front()) + " is not a verb of patina-cli. Try: " +
                        (nearest.empty() ? "patina-cli --help" : nearest) + ".");
}

}  // namespace
}  // namespace patina::cli

int main(int argc, char** argv) {
  int status = patina::cli::kOurFault;
  try {
    status = patina::cli::runProgram(argc, argv);
  } catch (const std::exception& bug) {
    std::fprintf(
        stderr,
        "Error: something went wrong inside Patina that is no fault of yours (%s). Try: the same again with "
        "--threads 1, and report it with the command and the bundle.\n",
        bug.what());
  } catch (...) {
    std::fputs("Error: something went wrong inside Patina that is no fault of yours. Try: report it.\n",
               stderr);
  }
  // Results that stdout couldn't take (a full disk, a closed pipe) are not done.
  if (std::fflush(stdout) != 0 && status == patina::cli::kDone) {
    std::fputs("Error: the results can't be printed: stdout is full or closed.\n", stderr);
    status = patina::cli::kBadInput;
  }
  return status;
}
