#include "app/cli/calibrate.h"

namespace patina::cli {
namespace {

struct ResponseArguments : CalibrateArguments {
  std::string exposures;
  std::vector<std::string> dark;
  ResponseOptions options;
};

int runResponse(const ResponseArguments& arguments, Context& context) {
  std::vector<double> exposures;
  if (!readNumbers(arguments.exposures, &exposures) || exposures.size() != arguments.photos.size())
    return context.misuse("--exposures gives the seconds of each of the " +
                          std::to_string(arguments.photos.size()) +
                          " photographs, between commas, in their order.");
  if (const Status writable = checkCalibrationOut(arguments.out); !writable)
    return context.fail(writable.error());
  const JobContext job = context.job();
  std::vector<ExposedPhoto> photos;
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    job.progress("read", static_cast<std::int64_t>(i), static_cast<std::int64_t>(exposures.size()), "photos");
    Result<PhotoFile> photo = readPhotoOrRaw(arguments.photos[i]);
    if (!photo) return context.fail(photo.error());
    photos.push_back({std::filesystem::path(arguments.photos[i]).filename().string(), std::move(photo->image),
                      exposures[i]});
  }
  StoredResponse stored;
  std::vector<std::string> remarks;
  if (!arguments.dark.empty()) {
    std::vector<Image> frames;
    for (const std::string& file : arguments.dark) {
      Result<PhotoFile> photo = readPhotoOrRaw(file);
      if (!photo) return context.fail(photo.error());
      frames.push_back(std::move(photo->image));
    }
    const Result<DarkLevel> dark = measureDarkLevel(frames);
    if (!dark) return context.fail(dark.error());
    stored.dark = *dark;
    remarks = dark->warnings;
  }
  const Result<CameraResponse> found = recoverResponse(photos, arguments.options, job);
  if (!found) return context.fail(found.error());
  context.console.finishProgress();
  stored.curves = found->curves;
  double residual = 0;
  for (int c = 0; c < 3; ++c) {
    residual += found->residual[c] * found->residual[c] / 3;
    context.console.say(
        worded("%c: light at a quarter, half, three quarters of full scale: %.4f %.4f %.4f; exposures agree "
               "within %.2f %%; photographs decide from %.3f to %.3f",
               "RGB"[c], linearFromResponse(found->curves[c], 0.25),
               linearFromResponse(found->curves[c], 0.5), linearFromResponse(found->curves[c], 0.75),
               100 * found -> residual[c], found -> coveredFrom[c], found -> coveredTo[c]));
  }
  context.console.say(found->linearity.sentence);
  if (stored.dark)
    context.console.say(worded("Black level R G B: %.5f %.5f %.5f; read noise %.5f", stored.dark->level[0],
                               stored.dark->level[1], stored.dark->level[2],
                               stored.dark->readNoise.maxCoeff()));
  remarks.insert(remarks.end(), found->warnings.begin(), found->warnings.end());
  for (const std::string& remark : remarks) job.warn(remark);
  return finishCalibration(arguments, recordNow(arguments, stored, 100 * std::sqrt(residual), "%", remarks),
                           context);
}

}  // namespace

void addCalibrateResponse(CLI::App& parent, Context& context) {
  CLI::App* verb = parent.add_subcommand(
      "response",
      "The camera's curve and black level, from a bracket of exposures; what it writes is also the file of\n"
      "a bundle's encoding response:FILE");
  auto arguments = std::make_shared<ResponseArguments>();
  addCalibrateOptions(
      *verb, arguments.get(), context,
      "5 to 9 photographs of one still scene, each with about twice the exposure of another (PNG, JPEG)");
  verb->add_option("--exposures", arguments->exposures, "Seconds of each photograph, in their order")
      ->required()
      ->option_text("S,S,...");
  verb->add_option("--dark", arguments->dark,
                   "A photograph with the lens covered, for black level and noise; may be given again")
      ->allow_extra_args(false)
      ->option_text("PHOTO");
  verb->add_option("--knots", arguments->options.knots, "Knots of the curve [default: 256]")
      ->check(CLI::Range(16, 1024))
      ->option_text("N");
  verb->add_option("--smoothness", arguments->options.smoothness, "More: smoother [default: 1]")
      ->check(CLI::PositiveNumber)
      ->option_text("W");
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runResponse(*arguments, context); };
  });
}

}  // namespace patina::cli
