#include "app/cli/calibrate.h"
#include "devices/watched_folder/watched_folder.h"
#include "engine/acquire/frame_image.h"
#include "engine/base/text.h"
#include "engine/calibration/hdr_merge.h"
#include "engine/image/exr.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

struct RecheckArguments {
  std::string calibration, encoding, exposures;
  std::vector<std::string> photos;
};

int runRecheck(const RecheckArguments& arguments, Context& context) {
  const Result<CalibrationRecord> stored = readCalibration(arguments.calibration);
  if (!stored) return context.fail(stored.error());
  const std::string kind(kindOf(stored->content));
  std::vector<double> exposures;
  if (!arguments.exposures.empty() &&
      (!readNumbers(arguments.exposures, &exposures) || exposures.size() != arguments.photos.size()))
    return context.misuse(
        "--exposures gives the seconds of each photograph, between commas, in their order.");
  const auto exposureOf = [&](std::size_t i) { return i < exposures.size() ? exposures[i] : 1.0; };
  Result<Recheck> check = Error{};
  if (kind == "camera-response") {
    if (arguments.photos.size() < 2 || exposures.empty())
      return context.misuse(
          "a response is checked against two photographs of one scene, with --exposures. Try: patina-cli "
          "calibrate recheck response.json short.png long.png --exposures 0.01,0.02");
    std::vector<ExposedPhoto> photos;
    for (std::size_t i = 0; i < arguments.photos.size(); ++i) {
      Result<PhotoFile> photo = readPhotoOrRaw(arguments.photos[i]);
      if (!photo) return context.fail(photo.error());
      photos.push_back({arguments.photos[i], std::move(photo->image), exposureOf(i)});
    }
    check = recheckResponse(*stored, photos);
  } else {
    if (arguments.photos.size() != 1)
      return context.misuse("a calibration of kind " + kind + " is checked against one photograph.");
    if (kind == "camera" || kind == "screen-pose") {
      const Result<PhotoFile> photo = readPhotoOrRaw(arguments.photos[0]);
      if (!photo) return context.fail(photo.error());
      check =
          kind == "camera" ? recheckCamera(*stored, photo->image) : recheckScreenPose(*stored, photo->image);
    } else if (kind == "white-tile") {
      const Result<Image> photo = readLinearPhoto(arguments.photos[0], arguments.encoding);
      if (!photo) return context.fail(photo.error());
      WhiteTileOptions options;
      options.region = std::get<StoredWhiteTile>(stored->content).region;
      options.exposureS = exposureOf(0);
      check = recheckWhiteTile(*stored, *photo, options);
    } else {
      return context.fail({ErrorCode::Unsupported,
                           "one photograph can't tell whether this still holds: it is of kind '" + kind + "'",
                           arguments.calibration, "calibrate it again"});
    }
  }
  if (!check) return context.fail(check.error());
  context.console.say((check->good ? "Good: " : "Not good: ") + check->sentence + ".");
  context.console.say("Made " + ageInWords(stored->taken, std::chrono::system_clock::now()) +
                      (stored->device.empty() ? "" : ", " + stored->device) + ".");
  // A script can branch on it: what is stored doesn't fit what is photographed.
  return check->good ? kDone : kBadInput;
}

struct MergeArguments {
  std::vector<std::string> photos;
  std::string out, exposures, encoding;
  MergeOptions options;
};

int runMerge(const MergeArguments& arguments, Context& context) {
  std::vector<double> exposures;
  if (!readNumbers(arguments.exposures, &exposures) || exposures.size() != arguments.photos.size())
    return context.misuse("--exposures gives the seconds of each of the " +
                          std::to_string(arguments.photos.size()) +
                          " photographs, between commas, in their order.");
  if (fs::path(arguments.out).extension() != ".exr")
    return context.misuse("--out ends in .exr. Try: --out merged.exr.");
  if (const Status writable = checkCalibrationOut(arguments.out); !writable)
    return context.fail(writable.error());
  const JobContext job = context.job();
  std::vector<ExposedPhoto> photos;
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    job.progress("read", static_cast<std::int64_t>(i), static_cast<std::int64_t>(exposures.size()), "photos");
    Result<Image> photo = readLinearPhoto(arguments.photos[i], arguments.encoding);
    if (!photo) return context.fail(photo.error());
    photos.push_back({fs::path(arguments.photos[i]).filename().string(), std::move(*photo), exposures[i]});
  }
  const Result<MergedRadiance> merged = mergeExposures(photos, arguments.options, job);
  if (!merged) return context.fail(merged.error());
  context.console.finishProgress();
  const Status written = writeExr(arguments.out, merged->radiance, {"R", "G", "B"},
                                  {{"what", "radiance, pixel units a second, merged from a bracket"}});
  if (!written) return context.fail(written.error());
  const double samples = std::max<double>(1, static_cast<double>(merged->radiance.samples().size()));
  context.console.say(worded("%.2f %% of the samples are clipped in all exposures, %.2f %% too dark in all.",
                             100 * static_cast<double>(merged->clipped) / samples,
                             100 * static_cast<double>(merged->dark) / samples));
  for (const std::string& warning : merged->warnings) job.warn(warning);
  context.console.say("Written: " + arguments.out);
  return kDone;
}

}  // namespace

Result<PhotoFile> readPhotoOrRaw(const std::string& file) {
  std::string ending = fs::path(file).extension().string();
  for (char& c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  // What the engine reads itself is as it always was; RAW and TIFF come through the cameras' reader.
  if (ending == ".png" || ending == ".jpg" || ending == ".jpeg" || ending == ".exr" || !isPhotograph(file))
    return readPhotoFile(file);
  const Result<Frame> frame = readPhotograph(file);
  if (!frame) return frame.error();
  FrameConversion conversion;
  const bool linear = isLinear(frame->format.layout);
  if (!linear) {
    // As the file has it: what its values mean is for --encoding to say.
    const ResponseCurve straight{{0, 1}, {0, 1}};
    conversion.response = {straight, straight, straight};
  }
  Result<Image> image = linearImage(*frame, conversion);
  if (!image) return image.error();
  PhotoFile photo;
  photo.image = std::move(*image);
  photo.linear = linear;
  return photo;
}

void addCalibrateRecheck(CLI::App& parent, Context& context) {
  CLI::App* verb =
      parent.add_subcommand("recheck", "Compares a calibration with a fresh photograph: does it still hold?");
  verb->set_help_flag("-h,--help", "Print this help");
  auto arguments = std::make_shared<RecheckArguments>();
  verb->add_option("CALIBRATION", arguments->calibration, "What another 'patina-cli calibrate' wrote")
      ->required();
  verb->add_option("PHOTO", arguments->photos,
                   "Camera: one of its board. Screen pose: one of mirror and markers, or of the markers.\n"
                   "White tile: one of the tile. Response: two of one scene, exposed differently")
      ->required()
      ->option_text("...");
  verb->add_option("--exposures", arguments->exposures,
                   "Seconds of each photograph: white tile and response [default: 1]")
      ->option_text("S,S,...");
  verb->add_option("--encoding", arguments->encoding,
                   "White tile: how PNG and JPEG pixels become light: response:FILE, srgb, gamma:2.2")
      ->option_text("ENCODING");
  addCommonOptions(*verb, context);
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runRecheck(*arguments, context); };
  });
}

void addCalibrateMerge(CLI::App& parent, Context& context) {
  CLI::App* verb = parent.add_subcommand(
      "merge", "Merges a bracket of one still scene to one linear photograph of high dynamic range");
  verb->set_help_flag("-h,--help", "Print this help");
  auto arguments = std::make_shared<MergeArguments>();
  verb->add_option("PHOTO", arguments->photos, "Photographs of one scene that differ in exposure only")
      ->required()
      ->option_text("...");
  verb->add_option("--out", arguments->out, "OpenEXR, R G B, pixel units a second")
      ->required()
      ->option_text("FILE");
  verb->add_option("--exposures", arguments->exposures, "Seconds of each photograph, in their order")
      ->required()
      ->option_text("S,S,...");
  verb->add_option("--encoding", arguments->encoding,
                   "How PNG and JPEG pixels become light: response:FILE, srgb, gamma:2.2")
      ->option_text("ENCODING");
  verb->add_option("--saturation", arguments->options.saturation,
                   "Pixel value at which the sensor clips, in light [default: 1]")
      ->check(CLI::PositiveNumber)
      ->option_text("V");
  addCommonOptions(*verb, context);
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runMerge(*arguments, context); };
  });
}

}  // namespace patina::cli
