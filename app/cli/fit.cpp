#include "engine/fourier/fit.h"

#include <charconv>
#include <memory>

#include "app/cli/fit_effects.h"
#include "app/cli/fit_flash.h"
#include "app/cli/fit_folder.h"
#include "app/cli/fit_report.h"
#include "app/cli/fit_two_shot.h"
#include "app/cli/verbs.h"
#include "engine/base/text.h"
#include "engine/capture/two_shot_capture.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

struct FitArguments {
  std::string bundle, out, effects = "none", dumpDir;
  std::string lobe = "exact", weights = "noise", schedule = "independent";
  double memoryGib = 4;
  std::vector<std::string> texels;
  bool noRestarts = false;
  bool noPooling = false;
  FourierFitOptions options;
  TwoShotArguments twoShot;
  FlashArguments flash;
  std::vector<const CLI::Option*> fourierOnly, twoShotOnly, flashOnly;
  std::vector<const CLI::Option*> mapsOnly;  ///< fourier and flash
};

/// "12,34"
std::optional<std::pair<int, int>> parseTexel(const std::string& text) {
  std::pair<int, int> texel;
  const char* end = text.data() + text.size();
  const auto [comma, code] = std::from_chars(text.data(), end, texel.first);
  if (code != std::errc() || comma == end || *comma != ',') return std::nullopt;
  const auto [last, code2] = std::from_chars(comma + 1, end, texel.second);
  if (code2 != std::errc() || last != end || texel.first < 0 || texel.second < 0) return std::nullopt;
  return texel;
}

/// Options that were typed and hold for one kind of bundle only, as "--size, --lobe".
std::string typed(const std::vector<const CLI::Option*>& options) {
  std::string names;
  for (const CLI::Option* option : options) {
    if (option->count() > 0) names += (names.empty() ? "" : ", ") + option->get_name();
  }
  return names;
}

/// Beside the result: "DIR.unfinished". Scratch files go to where the result will be: it has the room, if
/// any.
FourierFitStorage storageBeside(const fs::path& out) {
  fs::path folder = fs::absolute(out).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  FourierFitStorage storage;
  storage.keepFolder = folder;
  storage.keepFolder += ".unfinished";
  std::error_code code;
  for (storage.scratchFolder = folder.parent_path();
       !fs::is_directory(storage.scratchFolder, code) && storage.scratchFolder.has_relative_path();)
    storage.scratchFolder = storage.scratchFolder.parent_path();
  return storage;
}

int runFit(FitArguments& arguments, Context& context) {
  const Result<std::string> kind = captureKind(arguments.bundle);
  const bool twoShot = kind && *kind == "two-shot", flash = kind && *kind == "flash";
  const auto wanted = wantedEffects(arguments.effects, kind ? *kind : "");
  if (!wanted)
    return context.misuse("--effects " + wanted.error().what + ". Try: " + wanted.error().tryThis + ".");
  FourierFitOptions& options = arguments.options;
  options.lobe = arguments.lobe == "paper" ? LobeMapping::PaperAffine : LobeMapping::ExactMoments;
  options.weights =
      arguments.weights == "paper" ? MeasurementWeights::PaperConstant : MeasurementWeights::Noise;
  options.schedule = arguments.schedule == "paper" ? FitSchedule::Paper : FitSchedule::Independent;
  options.memoryLimitBytes = static_cast<std::uint64_t>(arguments.memoryGib * (1u << 30));
  options.neighbourRestarts = !arguments.noRestarts;
  options.poolNeighbours = !arguments.noPooling;
  const std::vector<std::string> problems = options.validate();
  if (!problems.empty()) {
    std::string sentence;
    for (const std::string& problem : problems) sentence += (sentence.empty() ? "" : "; ") + problem;
    return context.misuse(sentence + ". Try: patina-cli fit --help.");
  }
  std::vector<std::pair<int, int>> texels;
  for (const std::string& text : arguments.texels) {
    const auto texel = parseTexel(text);
    if (!texel) return context.misuse("--texel " + inQuotes(text) + " is not a texel. Try: --texel 12,34.");
    texels.push_back(*texel);
  }

  std::vector<const CLI::Option*> foreign;
  const auto add = [&](const std::vector<const CLI::Option*>& options) {
    foreign.insert(foreign.end(), options.begin(), options.end());
  };
  if (twoShot || flash) add(arguments.fourierOnly);
  if (!twoShot) add(arguments.twoShotOnly);
  if (!flash) add(arguments.flashOnly);
  if (twoShot) add(arguments.mapsOnly);
  const std::string wrong = typed(foreign);
  // What can't be told (no such bundle, another kind) is reported by the reader below.
  if (!wrong.empty() && (twoShot || flash || (kind && *kind == "fourier"))) {
    return context.misuse(wrong + " doesn't apply to a bundle of kind '" + *kind +
                          "'. Try: patina-cli fit --help, which says what belongs to which kind.");
  }
  if (!wanted->none && kind && (!flash || wanted->automatic)) {
    // The effects' fit decides about lobe, weights and schedule by itself.
    std::string settled = typed(arguments.fourierOnly);
    for (const auto* more : {&arguments.twoShotOnly, &arguments.flashOnly})
      if (const std::string names = typed(*more); !names.empty())
        settled += (settled.empty() ? "" : ", ") + names;
    if (!settled.empty())
      return context.misuse(settled + " can't be chosen together with --effects " + arguments.effects +
                            ". Try: without " + settled + ".");
    return runFitWithEffects(arguments.bundle, arguments.out, *wanted, options.size, context);
  }
  if (flash) {
    arguments.flash.size = options.size, arguments.flash.effects = arguments.effects;
    return runFlashFit(arguments.bundle, arguments.out, arguments.flash, context);
  }
  if (twoShot) return runTwoShotFit(arguments.bundle, arguments.out, arguments.twoShot, context);

  const JobContext job = context.job();
  Result<FourierCapture> capture = readFourierCapture(arguments.bundle, job);
  if (!capture) return context.fail(capture.error());
  for (const std::string& folder : {arguments.out, arguments.dumpDir}) {
    if (folder.empty()) continue;
    if (isInside(folder, capture->folder)) return refuseInside(folder, capture->folder, context);
    Status writable = checkWritable(folder);
    if (!writable) return context.fail(writable.error());
  }

  const FourierFitStorage storage = storageBeside(arguments.out);
  Result<std::shared_ptr<const FourierFit>> fit = fitFourier(*capture, options, job, storage);
  if (!fit) {
    // What was finished is of use to the same fit of the same photographs only; bad input will be others.
    if (fit.error().code != ErrorCode::Cancelled) removeUnfinished(storage.keepFolder);
    return context.fail(fit.error());
  }
  const FourierFit& fitted = **fit;
  context.console.finishProgress();
  Status written = writeFourierFit(arguments.out, fitted);
  if (!written) {
    if (fs::exists(storage.keepFolder))
      context.console.complain("The fitted texels wait in " + storage.keepFolder.string() +
                               ": the same command goes on from there once there is room.");
    return context.fail(written.error());
  }
  if (!fitted.stats().cancelled) removeUnfinished(storage.keepFolder);
  if (fitted.stats().resumedTexels > 0) {
    context.console.say("Resumed: " + std::to_string(fitted.stats().resumedTexels) +
                        " texels were taken over from the run that was stopped.");
  }

  printSummary(fitted, context);
  context.console.say("Maps are in " + (fs::path(arguments.out) / "maps").string() + ", numbers in " +
                      (fs::path(arguments.out) / "fit.json").string() + ".");
  if (context.common.stats) printStats(fitted.stats(), context);
  int status = kDone;
  for (const auto& [x, y] : texels) {
    if (x < fitted.maps().width && y < fitted.maps().height) {
      printTexel(fitted, x, y, context);
    } else {
      status =
          context.misuse("--texel " + std::to_string(x) + "," + std::to_string(y) +
                         " is not on the maps, which are " + std::to_string(fitted.maps().width) + " x " +
                         std::to_string(fitted.maps().height) + " texels; everything else was written.");
    }
  }
  // Cancelled counts more than a texel off the maps: the maps are not whole.
  if (fitted.stats().cancelled) status = kCancelled;
  if (!arguments.dumpDir.empty() && status != kCancelled) {
    Status dumped = writeDump(arguments.dumpDir, fitted, job);
    if (!dumped) return context.fail(dumped.error());
    context.console.say("Stage images are in " + arguments.dumpDir + ".");
  }
  if (status == kCancelled) {
    context.console.complain(
        "Cancelled: the maps hold what was fitted until then; status.exr marks the rest (6), and fit.json "
        "says so. The same command goes on from there; finished texels wait in " +
        storage.keepFolder.string() + ".");
  }
  return status;
}

}  // namespace

void addFitVerb(CLI::App& program, Context& context) {
  CLI::App* verb = program.add_subcommand(
      "fit",
      "Fits a capture bundle: material maps (kinds fourier and flash) or a measured BRDF (kind two-shot)");
  verb->set_help_flag("-h,--help", "Print this help");
  auto arguments = std::make_shared<FitArguments>();
  const FourierFitOptions defaults;
  const auto byDefault = [](const std::string& text, const std::string& value) {
    return text + " [default: " + value + "]";
  };
  verb->add_option("BUNDLE", arguments->bundle, "The bundle: a folder with capture.json and its photographs")
      ->required()
      ->option_text(" ");
  verb->add_option(
          "--out", arguments->out,
          "Folder for the results (kinds fourier and flash: maps/*.exr and fit.json; two-shot: brdf.binary,\n"
          "fit.json, pictures); made if missing, replaced only where names are the same")
      ->required()
      ->option_text("DIR");
  verb->add_option("--size", arguments->options.size,
                   byDefault("Longest side of the maps, texels; 0: what the photographs resolve",
                             std::to_string(defaults.size)))
      ->option_text("N");
  verb->add_option(
          "--effects", arguments->effects,
          byDefault("Effects beyond the standard model, fitted with it: ids with commas between them\n"
                    "(docs/effects.md); auto: those that the photographs show, as explain finds them",
                    "none"))
      ->option_text("none|auto|ID,ID");

  constexpr const char* kModel = "Bundles of kind fourier";
  verb->add_option("--lobe", arguments->lobe,
                   byDefault("How the glossy lobe is mapped onto the screen: exact moments, or the paper's\n"
                             "first-order map",
                             "exact"))
      ->check(CLI::IsMember({"exact", "paper"}))
      ->option_text("exact|paper")
      ->group(kModel);
  verb->add_option(
          "--weights", arguments->weights,
          byDefault("Weights of measurements: by the photographs' noise, or the paper's constant", "noise"))
      ->check(CLI::IsMember({"noise", "paper"}))
      ->option_text("noise|paper")
      ->group(kModel);
  verb->add_option("--max-iterations", arguments->options.maxIterations,
                   byDefault("Steps for each texel and start; more: slower, fewer texels stopped early",
                             std::to_string(defaults.maxIterations)))
      ->option_text("N")
      ->group(kModel);
  verb->add_option(
          "--tolerance", arguments->options.tolerance,
          byDefault("A texel has converged when its cost falls by less than this share in a step", "1e-05"))
      ->option_text("SHARE")
      ->group(kModel);
  verb->add_flag("--no-restarts", arguments->noRestarts,
                 "Don't offer texels their neighbours' solutions: a few percent faster, some texels stuck")
      ->group(kModel);
  verb->add_flag("--no-pooling", arguments->noPooling,
                 "Don't average a pixel's measurements with neighbours that noise can't tell from it:\n"
                 "every pixel alone, noisier where lobes are broad")
      ->group(kModel);

  verb->add_option(
          "--schedule", arguments->schedule,
          byDefault("Order of the solve: coarse levels, then every texel by itself at the photographs'\n"
                    "resolution; or the paper's, which solves at half of it and upsamples",
                    "independent"))
      ->check(CLI::IsMember({"independent", "paper"}))
      ->option_text("independent|paper")
      ->group(kModel);
  verb->add_option(
          "--memory", arguments->memoryGib,
          byDefault("Memory that the fit may take, GiB; measurements beyond it wait in a scratch file\n"
                    "beside the result, and where that isn't enough the maps become coarser",
                    "4"))
      ->check(CLI::Range(0.125, 4096.0))
      ->option_text("GIB")
      ->group(kModel);

  constexpr const char* kTwoShot = "Bundles of kind two-shot";
  TwoShotArguments& twoShot = arguments->twoShot;
  verb->add_option("--basis", twoShot.basis,
                   byDefault("Basis of measured BRDFs (patina-cli basis build)", "the built-in one"))
      ->option_text("FILE")
      ->group(kTwoShot);
  verb->add_option("--eta", twoShot.eta,
                   byDefault("Tikhonov's weight for 300 rows a picture; larger: closer to the basis' mean;\n"
                             "auto: by cross-validation over parts of the pictures",
                             twoShot.eta))
      ->option_text("V|auto")
      ->group(kTwoShot);
  verb->add_option(
          "--clusters", twoShot.clusters,
          byDefault("Materials on the sample, told apart by colour, 1 to 8; auto: chosen", twoShot.clusters))
      ->option_text("N|auto")
      ->group(kTwoShot);
  verb->add_option("--rows", twoShot.rowsPerShot,
                   byDefault("Measurements a picture after averaging neighbouring pixels; more: slower,\n"
                             "finer highlights",
                             std::to_string(twoShot.rowsPerShot)))
      ->option_text("N")
      ->group(kTwoShot);
  verb->add_flag("--no-noise-weights", twoShot.noNoiseWeights,
                 "Every pixel counts alike, as in the paper, whatever its noise")
      ->group(kTwoShot);

  verb->add_option("--materials", arguments->flash.materials,
                   byDefault("Groups of texels that share a highlight's shape, 1 to 8; 0: chosen by colour",
                             std::to_string(arguments->flash.materials)))
      ->option_text("N")
      ->group("Bundles of kind flash");

  constexpr const char* kLook = "Looking inside (kind fourier)";
  verb->add_option(
          "--texel", arguments->texels,
          "Print all samples, residuals and parameters of this texel (0,0 is the corner at -x, +y);\n"
          "may be repeated")
      ->option_text("X,Y")
      ->group(kLook)
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  verb->add_option("--dump-dir", arguments->dumpDir,
                   "Also write pictures of the stages into this folder; spectra at 128 x 128 texels at most")
      ->option_text("DIR")
      ->group(kLook);
  addCommonOptions(*verb, context);
  for (const char* name : {"--lobe", "--weights", "--max-iterations", "--tolerance", "--no-restarts",
                           "--no-pooling", "--schedule", "--memory", "--texel", "--dump-dir"}) {
    arguments->fourierOnly.push_back(verb->get_option(name));
  }
  for (const char* name : {"--basis", "--eta", "--clusters", "--rows", "--no-noise-weights"}) {
    arguments->twoShotOnly.push_back(verb->get_option(name));
  }
  arguments->flashOnly.push_back(verb->get_option("--materials"));
  arguments->mapsOnly.push_back(verb->get_option("--size"));
  verb->callback(
      [arguments, &context] { context.run = [arguments, &context] { return runFit(*arguments, context); }; });
}

}  // namespace patina::cli
