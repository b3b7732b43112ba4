#include <algorithm>
#include <cstdio>
#include <memory>

#include "app/cli/capture_two_shot.h"
#include "app/cli/verbs.h"
#include "devices/camera_providers.h"
#include "devices/simulated/live_rig.h"
#include "engine/acquire/capture_session.h"
#include "engine/base/text.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSimulated = "simulated";

struct CaptureArguments {
  std::string camera, screen, kind = "fourier", out, rig, plan;
  bool list = false, resume = false, skipChecks = false;
  double exposureS = 0;
  int frames = 1, bracket = 1;
  std::vector<int> retake;
  bool noHeldOut = false;
};

int listAll(Context& context) {
  std::vector<std::string> remarks;
  const auto providers = cameraProviders();
  for (const CameraInfo& camera : listCameras(providers, &remarks))
    context.console.say(camera.id + "\n    " + camera.name +
                        (camera.remark.empty() ? "" : "\n    can't be used now: " + camera.remark));
  context.console.say(
      "folder:PATH\n    A folder that a camera's own program puts photographs into (folder:PATH?existing: "
      "those that are there already)");
  context.console.say("simulated:FILE.json\n    A simulated rig described by a file (see docs/rig.md)");
  for (const std::string& remark : remarks) context.console.complain("Note: " + remark);
  context.console.say(
      "Screens: simulated (with a simulated camera). Real screens are driven by the window: patina, "
      "Capture.");
  return kDone;
}

/// Tells what happens, one line a photograph that isn't good.
class Teller : public CaptureObserver {
 public:
  explicit Teller(Context& context) : context_(context) {}
  void checked(const Checklist& list) override {
    for (const CheckItem& item : list.items) {
      const char* mark = item.state == CheckItem::State::Good      ? "good   "
                         : item.state == CheckItem::State::Warning ? "WARNING"
                         : item.state == CheckItem::State::Bad     ? "BAD    "
                                                                   : "?      ";
      context_.console.say(std::string(mark) + " " + item.title + ": " + item.sentence +
                           (item.tryThis.empty() ? "" : " Try: " + item.tryThis + "."));
    }
    char line[100];
    std::snprintf(line, sizeof line, "Exposure: %.4g s, gain %.3g.", list.exposureS, list.gain);
    context_.console.say(line);
  }
  void photographed(int photo, const Image&, const PhotoState& state, bool kept) override {
    if (state.quality.good()) return;
    context_.console.say("Photograph " + std::to_string(photo) +
                         (kept ? " is kept though: " : " is taken again: ") + state.quality.sentence);
  }

 private:
  Context& context_;
};

int report(const CaptureSession::Outcome& outcome, const fs::path& out, Context& context) {
  for (const std::string& remark : outcome.remarks) context.console.say(remark);
  const std::string count =
      std::to_string(outcome.taken) + " of " + counted(static_cast<std::size_t>(outcome.total), "photograph");
  if (outcome.cancelled) {
    context.console.complain("Cancelled: " + count + " are in " + out.string() +
                             ". Go on with: the same command and --resume.");
    return kCancelled;
  }
  context.console.say(count + " taken" +
                      (outcome.flawed > 0
                           ? ", " + std::to_string(outcome.flawed) +
                                 " of them not good (see journal.jsonl; --retake N takes one again)"
                           : "") +
                      ". Fit them with: patina-cli fit " + out.string() + " --out DIR");
  return kDone;
}

int runFourier(const CaptureArguments& arguments, LiveRigProvider& provider, Context& context) {
  const Result<std::shared_ptr<LiveRig>> rig = provider.rig(arguments.camera);
  if (!rig) return context.fail(rig.error());
  RigDescription description = (*rig)->description();
  if (!arguments.rig.empty()) {
    Result<RigDescription> read = readRigDescription(arguments.rig);
    if (!read) return context.fail(read.error());
    description = std::move(*read);
  }
  CaptureOptions options;
  options.check = !arguments.skipChecks;
  options.exposureS = arguments.exposureS;
  options.framesAveraged = arguments.frames;
  options.bracket = arguments.bracket;
  if (arguments.noHeldOut) options.plan.heldOut.clear();
  if (!options.check && !(options.exposureS > 0))
    return context.misuse("--skip-checks needs --exposure. Try: --exposure 0.1.");
  Result<std::unique_ptr<CaptureSession>> session =
      CaptureSession::open(arguments.out, description, options, arguments.resume);
  if (!session) return context.fail(session.error());
  for (const int photo : arguments.retake)
    if (const Status again = (*session)->retake(photo); !again) return context.fail(again.error());
  Result<std::unique_ptr<CameraDevice>> camera = (*rig)->openCamera();
  if (!camera) return context.fail(camera.error());
  const std::unique_ptr<PatternDisplay> display = (*rig)->openDisplay();
  Teller teller(context);
  const Result<CaptureSession::Outcome> outcome = (*session)->run(**camera, *display, context.job(), &teller);
  context.console.finishProgress();
  if (!outcome) return context.fail(outcome.error());
  return report(*outcome, arguments.out, context);
}

int runCapture(const CaptureArguments& arguments, Context& context) {
  if (arguments.list) return listAll(context);
  for (const auto& [name, value] :
       {std::pair{"--camera", &arguments.camera}, {"--screen", &arguments.screen}, {"--out", &arguments.out}})
    if (value->empty() && !(std::string(name) == "--screen" && arguments.kind == "two-shot"))
      return context.misuse(std::string(name) + " is needed. Try: patina-cli capture --list.");
  const bool simulatedCamera = arguments.camera.starts_with(std::string(kSimulated) + ":");
  if (arguments.kind == "fourier" && arguments.screen != kSimulated)
    return context.misuse(
        "patterns on a real screen need the window: start patina and choose Capture. On the command line "
        "there is --screen simulated.");
  if (!simulatedCamera) {
    // Tell first whether there is such a camera at all.
    const auto providers = cameraProviders();
    const Result<std::unique_ptr<CameraDevice>> camera = openCamera(providers, arguments.camera);
    if (!camera) return context.fail(camera.error());
    return context.misuse(
        "a real camera and real light need the window, which shows the patterns and leads through the steps: "
        "start "
        "patina and choose Capture. On the command line there is --camera simulated:laminate --screen "
        "simulated.");
  }
  LiveRigProvider provider;
  if (arguments.kind == "two-shot")
    return runTwoShotCapture({arguments.camera, arguments.out, arguments.plan, arguments.resume}, context);
  return runFourier(arguments, provider, context);
}

}  // namespace

void addCaptureVerb(CLI::App& program, Context& context) {
  CLI::App* verb = program.add_subcommand(
      "capture", "Takes a capture bundle with the simulated rig (real screens: the window); lists cameras");
  verb->set_help_flag("-h,--help", "Print this help");
  auto arguments = std::make_shared<CaptureArguments>();
  verb->add_flag("--list", arguments->list, "List the cameras that are there, and end");
  verb->add_option("--camera", arguments->camera,
                   "The camera, by its id of --list: simulated:laminate, simulated:FILE.json")
      ->option_text("ID");
  verb->add_option("--screen", arguments->screen, "The screen that shows the patterns: simulated")
      ->option_text("ID");
  verb->add_option("--kind", arguments->kind, "What to take [default: fourier]")
      ->check(CLI::IsMember({"fourier", "two-shot"}))
      ->option_text("fourier|two-shot");
  verb->add_option("--out", arguments->out, "Folder for the bundle; new or empty, unless --resume")
      ->option_text("BUNDLE");
  verb->add_flag("--resume", arguments->resume,
                 "Go on with a capture that was cancelled or broke off; begins one where there is none");
  verb->add_option(
          "--rig", arguments->rig,
          "What calibration knows of camera and screen: a file with the keys camera, screen and sample of\n"
          "a capture.json [default: what the simulated rig says]")
      ->option_text("FILE");
  verb->add_option("--plan", arguments->plan,
                   "two-shot: a plan of 'patina-cli plan' [default: two shots, 25 degrees]")
      ->option_text("FILE");
  verb->add_option("--exposure", arguments->exposureS, "Seconds [default: chosen by the checklist]")
      ->check(CLI::Range(1e-6, 3600.0))
      ->option_text("S");
  verb->add_option("--frames", arguments->frames, "Frames averaged for each photograph [default: 1]")
      ->check(CLI::Range(1, 1000))
      ->option_text("N");
  verb->add_option("--bracket", arguments->bracket,
                   "Exposures merged for each photograph, each a fourth of the one before [default: 1]")
      ->check(CLI::Range(1, 8))
      ->option_text("N");
  verb->add_option("--retake", arguments->retake, "With --resume: take these photographs again, by number")
      ->option_text("N...");
  verb->add_flag("--skip-checks", arguments->skipChecks, "Leave the checklist out; needs --exposure");
  verb->add_flag("--no-held-out", arguments->noHeldOut,
                 "Leave out the photographs that measure the error of prediction");
  addCommonOptions(*verb, context);
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runCapture(*arguments, context); };
  });
}

}  // namespace patina::cli
