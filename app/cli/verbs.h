#pragma once

#include <CLI/CLI.hpp>
#include <functional>

#include "app/cli/console.h"
#include "engine/base/job.h"
#include "engine/base/result.h"

namespace patina::cli {

/// What the program's exit status says; see the command-line contract.
enum ExitStatus : int {
  kDone = 0,
  kOurFault = 1,   ///< a bug of Patina's
  kWrongUse = 2,   ///< the command line makes no sense
  kBadInput = 3,   ///< what, where and what to try are on stderr; nothing half-written is left
  kCancelled = 4,  ///< what was finished is kept and marked
};

/// Options that every verb has.
struct CommonOptions {
  bool progressJson = false;  ///< --progress json
  int threads = 0;            ///< --threads; 0: all cores
  bool stats = false;         ///< --stats: times, counts and memory at the end
};

/// What the verbs share. A verb's file has one function, `addXVerb`, that adds a CLI::App subcommand with its
/// options and a callback that sets `run`; `main` parses and then calls `run` once. `run` returns an
/// ExitStatus and may throw only our own bugs.
struct Context {
  CommonOptions common;
  Console console;
  std::stop_token stop;  ///< requested by Ctrl-C and SIGTERM
  std::function<int()> run;

  /// For the engine's calls: stop, progress, log, threads. Valid while this lives.
  JobContext job();
  /// Tells the failure on stderr and returns its exit status: kCancelled or kBadInput.
  int fail(const Error& error);
  /// Tells a misuse that the parser couldn't see, on stderr; returns kWrongUse.
  int misuse(const std::string& sentence);
};

/// Adds --progress, --threads and --stats; every verb calls it.
void addCommonOptions(CLI::App& verb, Context& context);

void addFitVerb(CLI::App& program, Context& context);
void addExplainVerb(CLI::App& program, Context& context);  // explain.cpp
void addBrdfVerb(CLI::App& program, Context& context);     // brdf.cpp
void addDemoVerb(CLI::App& program, Context& context);     // demo.cpp
void addCaptureVerb(CLI::App& program, Context& context);  // capture.cpp
void addPlanVerb(CLI::App& program, Context& context);
void addExpectVerb(CLI::App& program, Context& context);
void addBasisVerb(CLI::App& program, Context& context);
void addCalibrateVerb(CLI::App& program, Context& context);  // calibrate.cpp
/// The contract's verbs that this version doesn't have: not listed, and typing one says so.
void addMissingVerbs(CLI::App& program, Context& context);

}  // namespace patina::cli
