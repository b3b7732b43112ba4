#include "app/cli/calibrate.h"

namespace patina::cli {
namespace {

struct ScreenArguments : CalibrateArguments {
  std::string camera, size, pixels = "1920x1080";
  std::string sampleBoard = boardText(Board::forSamplePlane()), sampleAt = "0,0,0";
  std::string screenBoard, screenAt;
  double mirrorHeightMm = 0;
  // The screen's curve instead of its pose.
  std::string grey, encoding, region;
};

bool readPair(const std::string& text, double* a, double* b) {
  char extra = 0;
  return std::sscanf(text.c_str(), "%lfx%lf%c", a, b, &extra) == 2 && *a > 0 && *b > 0;
}

/// The response curve, from one photograph a grey value.
int runCurve(const ScreenArguments& arguments, Context& context) {
  std::vector<double> grey, corners;
  if (!readNumbers(arguments.grey, &grey) || grey.size() != arguments.photos.size())
    return context.misuse("--grey gives one value from 0 to 1 for each photograph, between commas.");
  PixelRegion region;
  if (!arguments.region.empty()) {
    if (!readNumbers(arguments.region, &corners) || corners.size() != 4)
      return context.misuse("--region is x0,y0,x1,y1 in pixels.");
    region = {static_cast<int>(corners[0]), static_cast<int>(corners[1]), static_cast<int>(corners[2]),
              static_cast<int>(corners[3])};
  }
  std::vector<GreySample> samples;
  for (std::size_t i = 0; i < grey.size(); ++i) {
    context.job().progress("read", static_cast<std::int64_t>(i), static_cast<std::int64_t>(grey.size()),
                           "photos");
    const Result<Image> photo = readLinearPhoto(arguments.photos[i], arguments.encoding);
    if (!photo) return context.fail(photo.error());
    samples.push_back({grey[i], meanLight(*photo, region)});
  }
  const Result<ScreenCurve> found = fitScreenResponse(samples);
  if (!found) return context.fail(found.error());
  context.console.finishProgress();
  context.console.say(
      worded("About value to the power of %.3f; black is %.3f %% of white; samples are %.3f %% of white from "
             "the curve.",
             found->exponent, 100 * found->blackShare, 100 * found->residual));
  for (const std::string& warning : found->warnings) context.job().warn(warning);
  return finishCalibration(
      arguments,
      recordNow(arguments, StoredScreenResponse{*found}, 100 * found->residual, "%", found->warnings),
      context);
}

int runPose(const ScreenArguments& arguments, Context& context) {
  if (arguments.photos.size() != 1)
    return context.misuse(
        "the mirror calibration takes one photograph; with --grey, one for each grey value.");
  if (arguments.camera.empty() || arguments.size.empty() || arguments.screenAt.empty())
    return context.misuse(
        "the mirror calibration needs --camera, --size and --screen-at (or --grey for the screen's curve).");
  MirrorCalibrationInput input;
  double width = 0, height = 0, across = 0, down = 0;
  if (!readPair(arguments.size, &width, &height) || !readPair(arguments.pixels, &across, &down))
    return context.misuse(
        "--size is the lit area in mm and --pixels in pixels. Try: --size 344x194 --pixels 1920x1080.");
  input.screen.widthMm = width, input.screen.heightMm = height;
  input.screen.widthPx = static_cast<int>(across), input.screen.heightPx = static_cast<int>(down);
  const Result<Board> sample = parseBoard(arguments.sampleBoard, "--sample-board");
  if (!sample) return context.misuse(sample.error().sentence());
  const Result<Board> shown = parseBoard(
      arguments.screenBoard.empty() ? boardText(Board::forScreen(width, height)) : arguments.screenBoard,
      "--screen-board");
  if (!shown) return context.misuse(shown.error().sentence());
  std::vector<double> at, onScreen;
  if (!readNumbers(arguments.sampleAt, &at) || at.size() != 3)
    return context.misuse("--sample-at is x,y,turn: millimetres and degrees. Try: --sample-at 0,-50,0.");
  if (!readNumbers(arguments.screenAt, &onScreen) || onScreen.size() != 3 || !(onScreen[2] > 0))
    return context.misuse("--screen-at is x,y,square in pixels of the screen. Try: --screen-at 192,92,128.");
  input.onSample = {*sample, {at[0], at[1]}, at[2]};
  input.onScreen = boardOnScreen(*shown, input.screen, onScreen[2], {onScreen[0], onScreen[1]});
  input.mirrorHeightMm = arguments.mirrorHeightMm;

  const Result<CalibrationRecord> lens = readCalibration(arguments.camera, "camera");
  if (!lens) return context.fail(lens.error());
  input.camera = std::get<StoredCamera>(lens->content).camera;
  const Result<PhotoFile> photo = readPhotoOrRaw(arguments.photos[0]);
  if (!photo) return context.fail(photo.error());
  const Result<ScreenPoseCalibration> found = calibrateScreenPose(input, photo->image);
  if (!found) return context.fail(found.error());
  const Eigen::Vector3d eye = found->camera.positionMm(), origin = found->screen.originMm;
  const Eigen::Vector3d normal = found->screen.worldFromScreen.col(2);
  context.console.say(worded("Camera at (%.2f, %.2f, %.2f) mm +- %.2f mm, turned within %.3f degrees.",
                             eye.x(), eye.y(), eye.z(), found->cameraPositionSdMm, found->cameraAngleSdDeg));
  context.console.say(
      worded("Screen's middle at (%.2f, %.2f, %.2f) mm +- %.2f mm, its normal (%.4f, %.4f, %.4f) within %.3f "
             "degrees.",
             origin.x(), origin.y(), origin.z(), found->screenPositionSdMm, normal.x(), normal.y(),
             normal.z(), found->screenAngleSdDeg));
  context.console.say(
      worded("Corners are %.3f px RMS from their predictions (sample %.3f, mirror %.3f, direct %.3f).",
             found->rmsPx, found->sampleRmsPx, found->mirroredRmsPx, found->directRmsPx));
  for (const std::string& warning : found->warnings) context.job().warn(warning);
  const StoredScreenPose stored{
      found->camera,        found->screen,           input.onSample,           input.onScreen,
      input.mirrorHeightMm, found->screenAngleSdDeg, found->screenPositionSdMm};
  return finishCalibration(arguments, recordNow(arguments, stored, found->rmsPx, "px", found->warnings),
                           context);
}

int runScreen(const ScreenArguments& arguments, Context& context) {
  if (const Status writable = checkCalibrationOut(arguments.out); !writable)
    return context.fail(writable.error());
  return arguments.grey.empty() ? runPose(arguments, context) : runCurve(arguments, context);
}

}  // namespace

void addCalibrateScreen(CLI::App& parent, Context& context) {
  CLI::App* verb = parent.add_subcommand(
      "screen",
      "Where screen and camera stand, from one photograph of a mirror; with --grey the screen's curve");
  auto arguments = std::make_shared<ScreenArguments>();
  addCalibrateOptions(
      *verb, arguments.get(), context,
      "One photograph: a board on the sample plane beside a flat mirror that shows the screen's board;\n"
      "or with --grey one of the screen for each grey value");
  verb->add_option("--camera", arguments->camera, "What 'patina-cli calibrate camera' wrote")
      ->option_text("FILE");
  verb->add_option("--size", arguments->size, "The screen's lit area in mm, measured with a ruler")
      ->option_text("WxH");
  verb->add_option("--pixels", arguments->pixels, "The screen's pixels [default: 1920x1080]")
      ->option_text("WxH");
  verb->add_option("--sample-board", arguments->sampleBoard,
                   "The board on the sample plane [default: " + boardText(Board::forSamplePlane()) + "]")
      ->option_text("BOARD");
  verb->add_option("--sample-at", arguments->sampleAt,
                   "Its middle in the world, mm, and its turn counter-clockwise, degrees [default: 0,0,0]")
      ->option_text("X,Y,TURN");
  verb->add_option("--screen-board", arguments->screenBoard,
                   "The board that the screen shows [default: 12x7 squares, markers from 128]; its size "
                   "comes\nfrom --screen-at")
      ->option_text("BOARD");
  verb->add_option("--screen-at", arguments->screenAt,
                   "Top left corner of its squares and the side of one, pixels of the screen")
      ->option_text("X,Y,SQUARE");
  verb->add_option("--mirror-height", arguments->mirrorHeightMm,
                   "Height of the reflecting surface over the sample plane, mm [default: 0]")
      ->check(CLI::Range(-100.0, 100.0))
      ->option_text("MM");
  verb->add_option("--grey", arguments->grey,
                   "Grey values 0 to 1, one a photograph: measures the screen's curve")
      ->option_text("V,V,...");
  verb->add_option("--encoding", arguments->encoding,
                   "With --grey: how PNG and JPEG pixels become light: response:FILE, srgb, gamma:2.2")
      ->option_text("ENCODING");
  verb->add_option("--region", arguments->region,
                   "With --grey: where to look, pixels [default: the whole picture]")
      ->option_text("X0,Y0,X1,Y1");
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runScreen(*arguments, context); };
  });
}

}  // namespace patina::cli
