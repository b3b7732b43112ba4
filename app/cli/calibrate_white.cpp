#include "app/cli/calibrate.h"
#include "engine/fourier/emission_calibration.h"
#include "engine/image/exr.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

struct WhiteArguments : CalibrateArguments {
  std::string reflectance = "0.99,0.99,0.99", encoding, region, black = "0,0,0", albedo;
  double exposureS = 1, saturation = 0;
  bool freeMeanX = false;
};

/// Three numbers, or one for all three.
bool readRgb(const std::string& text, Eigen::Vector3d* rgb) {
  std::vector<double> numbers;
  if (!readNumbers(text, &numbers) || (numbers.size() != 1 && numbers.size() != 3)) return false;
  for (int c = 0; c < 3; ++c) (*rgb)[c] = numbers[numbers.size() == 1 ? 0 : static_cast<std::size_t>(c)];
  return true;
}

/// White paper in a Fourier bundle: the screen's emission.
int runPaper(const WhiteArguments& arguments, Context& context) {
  EmissionOptions options;
  if (!arguments.albedo.empty() && !readRgb(arguments.albedo, &options.albedo))
    return context.misuse("--albedo is one number or three between commas. Try: --albedo 0.9.");
  options.freeMeanX = arguments.freeMeanX;
  const JobContext job = context.job();
  const Result<FourierCapture> capture = readFourierCapture(arguments.photos[0], job);
  if (!capture) return context.fail(capture.error());
  const Result<EmissionCalibration> found = calibrateEmission(*capture, options, job);
  if (!found) return context.fail(found.error());
  context.console.finishProgress();
  const ScreenEmission& emission = found->emission;
  context.console.say(
      worded("Emission: mean (%.4f, %.4f) +- %.4f, sigma (%.4f, %.4f) +- (%.4f, %.4f), gain %.5f +- %.5f",
             emission.mean.x(), emission.mean.y(), found->meanSd.y(), emission.sigma.x(), emission.sigma.y(),
             found->sigmaSd.x(), found->sigmaSd.y(), emission.gain, found->gainSd));
  context.console.say(worded(
      "Channels R G B over it: %.4f %.4f %.4f; radiance scale %.6g; paper's albedo taken as %.3f %.3f %.3f",
      found->channelGain[0], found->channelGain[1], found->channelGain[2], found->radianceScale,
      found->albedo[0], found->albedo[1], found->albedo[2]));
  context.console.say(worded("The model leaves %.3f %% of the light, noise %.3f %%, at %d points.",
                             100 * found->residual, 100 * found->noise, found->points));
  for (const std::string& warning : found->warnings) job.warn(warning);
  const StoredEmission stored{emission,           found->meanSd, found->sigmaSd,      found->gainSd,
                              found->channelGain, found->albedo, found->radianceScale};
  return finishCalibration(
      arguments, recordNow(arguments, stored, 100 * found->residual, "%", found->warnings), context);
}

int runTile(const WhiteArguments& arguments, Context& context) {
  WhiteTileOptions options;
  CertifiedReflectance reflectance;
  reflectance.source = "entered";
  if (!readRgb(arguments.reflectance, &reflectance.rgb)) {
    const Result<CertifiedReflectance> table = readReflectanceTable(arguments.reflectance);
    if (!table) return context.fail(table.error());
    reflectance = *table;
  }
  if (!readRgb(arguments.black, &options.blackLevel))
    return context.misuse("--black is one number or three between commas. Try: --black 0.01.");
  std::vector<double> region;
  if (!arguments.region.empty()) {
    if (!readNumbers(arguments.region, &region) || region.size() != 4)
      return context.misuse("--region is x0,y0,x1,y1 in pixels.");
    options.region = {static_cast<int>(region[0]), static_cast<int>(region[1]), static_cast<int>(region[2]),
                      static_cast<int>(region[3])};
  }
  options.exposureS = arguments.exposureS;
  options.saturation = arguments.saturation;
  const JobContext job = context.job();
  // Several photographs are averaged: less noise.
  Image mean;
  for (std::size_t i = 0; i < arguments.photos.size(); ++i) {
    job.progress("read", static_cast<std::int64_t>(i), static_cast<std::int64_t>(arguments.photos.size()),
                 "photos");
    const Result<Image> photo = readLinearPhoto(arguments.photos[i], arguments.encoding);
    if (!photo) return context.fail(photo.error());
    if (i == 0) mean = Image(photo->width(), photo->height(), 3);
    if (photo->width() != mean.width() || photo->height() != mean.height())
      return context.fail(
          {ErrorCode::Invalid, "the photographs are not of one size", arguments.photos[i], ""});
    for (std::size_t k = 0; k < mean.samples().size(); ++k)
      mean.samples()[k] += photo->samples()[k] / static_cast<float>(arguments.photos.size());
  }
  const Result<WhiteTileCalibration> found = calibrateWhiteTile(mean, reflectance, options, job);
  if (!found) return context.fail(found.error());
  context.console.finishProgress();
  context.console.say(
      worded("Irradiance R G B: %.6g %.6g %.6g +- %.3f %% (pixel units a second), reflectance %.4f %.4f %.4f",
             found->mean[0], found->mean[1], found->mean[2], 100 * found->relativeSd.maxCoeff(),
             reflectance.rgb[0], reflectance.rgb[1], reflectance.rgb[2]));
  std::vector<std::string> remarks;
  for (const TileCheck& check : found->checks) {
    context.console.say((check.passed ? "Good: " : "Not good: ") + check.sentence);
    if (!check.passed) remarks.push_back(check.sentence);
  }
  fs::path map = arguments.out;
  map.replace_extension(".exr");
  const Status written =
      writeExr(map, found->irradiance, {"R", "G", "B"},
               {{"what", "irradiance times the cosine of incidence, pixel units a second"}});
  if (!written) return context.fail(written.error());
  context.console.say("Written: " + map.string());
  const StoredWhiteTile stored{found->reflectance, found->mean, found->relativeSd, found->region,
                               map.filename().string()};
  return finishCalibration(arguments, recordNow(arguments, stored, 100 * found->residual, "%", remarks),
                           context);
}

int runWhite(const WhiteArguments& arguments, Context& context) {
  if (fs::path(arguments.out).extension() == ".exr")
    return context.misuse(
        "--out names the calibration, JSON; the irradiance of every pixel goes beside it as .exr.");
  if (const Status writable = checkCalibrationOut(arguments.out); !writable)
    return context.fail(writable.error());
  std::error_code code;
  const fs::path first = arguments.photos[0];
  if (fs::is_directory(first, code) || first.filename() == "capture.json") {
    if (arguments.photos.size() != 1)
      return context.misuse("one bundle of white paper is calibrated at a time.");
    return runPaper(arguments, context);
  }
  return runTile(arguments, context);
}

}  // namespace

void addCalibrateWhite(CLI::App& parent, Context& context) {
  CLI::App* verb = parent.add_subcommand(
      "white",
      "The light, from photographs of a white tile; or the screen's emission, from a bundle of white paper");
  auto arguments = std::make_shared<WhiteArguments>();
  addCalibrateOptions(
      *verb, arguments.get(), context,
      "Photographs of the tile in the sample's place (several are averaged); or the folder of a bundle\n"
      "of kind fourier that shows white paper");
  verb->add_option(
          "--reflectance", arguments->reflectance,
          "Tile: R,G,B or one number, or a certificate's table of nm and reflectance [default: 0.99]")
      ->option_text("R,G,B|FILE");
  verb->add_option("--exposure", arguments->exposureS, "Tile: exposure in seconds [default: 1]")
      ->check(CLI::PositiveNumber)
      ->option_text("S");
  verb->add_option("--saturation", arguments->saturation,
                   "Tile: pixel value at which the sensor clips [default: a plateau at the largest]")
      ->option_text("V");
  verb->add_option("--black", arguments->black, "Tile: black level, pixel values [default: 0]")
      ->option_text("R,G,B");
  verb->add_option("--region", arguments->region, "Tile: its place in the picture, pixels [default: all]")
      ->option_text("X0,Y0,X1,Y1");
  verb->add_option("--encoding", arguments->encoding,
                   "Tile: how PNG and JPEG pixels become light: response:FILE, srgb, gamma:2.2")
      ->option_text("ENCODING");
  verb->add_option("--albedo", arguments->albedo, "Paper: its albedo [default: what the bundle says, else 1]")
      ->option_text("R,G,B");
  verb->add_flag("--free-mean-x", arguments->freeMeanX,
                 "Paper: let the emission's middle move sideways as well");
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runWhite(*arguments, context); };
  });
}

}  // namespace patina::cli
