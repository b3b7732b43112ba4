#include "app/cli/calibrate.h"

#include <unistd.h>

#include <charconv>
#include <cmath>
#include <set>

#include "engine/base/atomic_file.h"
#include "engine/base/text.h"
#include "engine/capture/encoding.h"
#include "engine/image/png.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

struct CameraArguments : CalibrateArguments {
  std::string board = boardText(Board::forCamera());
  std::vector<std::string> leaveOut;
  CameraCalibrationOptions options;
};

int runCamera(const CameraArguments& arguments, Context& context) {
  const Result<Board> board = parseBoard(arguments.board, "--board");
  if (!board) return context.misuse(board.error().sentence());
  if (const Status writable = checkCalibrationOut(arguments.out); !writable)
    return context.fail(writable.error());
  const JobContext job = context.job();
  std::set<std::string> leaveOut(arguments.leaveOut.begin(), arguments.leaveOut.end());
  std::vector<CalibrationView> views;
  const auto total = static_cast<std::int64_t>(arguments.photos.size());
  for (std::size_t i = 0; i < arguments.photos.size(); ++i) {
    if (job.cancelled()) return context.fail({ErrorCode::Cancelled, "the calibration was cancelled", "", ""});
    job.progress("boards", static_cast<std::int64_t>(i), total, "photos");
    const fs::path file = arguments.photos[i];
    const Result<PhotoFile> photo = readPhotoOrRaw(file.string());
    if (!photo) return context.fail(photo.error());
    const BoardDetection found = detectBoard(photo->image, *board, {}, job.stop);
    if (!found.found) {
      job.warn(file.filename().string() + ": " + found.whyNot);
      continue;
    }
    const std::string name = file.filename().string();
    views.push_back({name, found.view, leaveOut.erase(name) == 0});
  }
  job.progress("boards", total, total, "photos");
  for (const std::string& name : leaveOut)
    return context.misuse("--leave-out " + inQuotes(name) +
                          " names none of the photographs in which the board is seen.");
  const Result<CameraCalibration> found = calibrateCamera(*board, views, arguments.options, job);
  if (!found) return context.fail(found.error());
  context.console.finishProgress();

  const Camera& camera = found->camera;
  for (const CalibratedView& view : found->views)
    context.console.say(worded("%-24s %.3f px%s, %.0f degrees%s%s", view.name.substr(0, 60).c_str(),
                               view.rmsPx, view.used ? "" : " (left out)", view.tiltDeg,
                               view.remark.empty() ? "" : "; ", view.remark.c_str()));
  context.console.say(worded("fx %.3f +- %.3f, fy %.3f +- %.3f, cx %.3f +- %.3f, cy %.3f +- %.3f pixels",
                             camera.intrinsics(0, 0), found->sd[0], camera.intrinsics(1, 1), found->sd[1],
                             camera.intrinsics(0, 2), found->sd[2], camera.intrinsics(1, 2), found->sd[3]));
  context.console.say(
      worded("k1 %.5f +- %.5f, k2 %.5f +- %.5f, p1 %.6f +- %.6f, p2 %.6f +- %.6f, k3 %.5f +- %.5f",
             camera.distortion[0], found->sd[4], camera.distortion[1], found->sd[5], camera.distortion[2],
             found->sd[6], camera.distortion[3], found->sd[7], camera.distortion[4], found->sd[8]));
  context.console.say(
      worded("Corners are %.3f px RMS from their predictions; the lens puts rays within %.3f px (1 sd).",
             found->rmsPx, found->predictionSdPx));
  context.console.say(worded(
      "Corners lie in %.0f %% of the picture and in %.0f %% of its rim, tilts reach %.0f degrees.",
      100 * found->coverage.imageShare, 100 * found->coverage.edgeShare, found->coverage.greatestTiltDeg));
  for (const std::string& advice : found->coverage.advice)
    context.console.say("To do better: " + advice + ".");
  for (const std::string& warning : found->warnings) job.warn(warning);
  int used = 0;
  for (const CalibratedView& view : found->views) used += view.used;
  return finishCalibration(arguments,
                           recordNow(arguments, StoredCamera{camera, found->sd, *board, used}, found->rmsPx,
                                     "px", found->warnings),
                           context);
}

struct BoardArguments {
  std::string board = boardText(Board::forCamera()), out;
  std::string paper = "297x210";
  int squarePx = 100;
};

int runBoard(const BoardArguments& arguments, Context& context) {
  Result<Board> board = parseBoard(arguments.board, "--board");
  if (!board) return context.misuse(board.error().sentence());
  PrintOptions print;
  double width = 0, height = 0;
  char extra = 0;
  if (std::sscanf(arguments.paper.c_str(), "%lfx%lf%c", &width, &height, &extra) != 2 ||
      !(width > 0 && height > 0))
    return context.misuse("--paper is a width and a height in millimetres. Try: --paper 297x210.");
  print.paperWidthMm = width, print.paperHeightMm = height;
  const fs::path out = arguments.out;
  const std::string ending = out.extension().string();
  if (ending == ".png") {
    const Result<Image> image = drawBoardPixels(*board, arguments.squarePx, arguments.squarePx / 2);
    if (!image) return context.fail(image.error());
    if (const Status written = writePng(out, *image); !written) return context.fail(written.error());
    context.console.say("Board to show: --board " + boardText(*board) +
                        worded(" at %d pixels a square", arguments.squarePx));
  } else if (ending == ".svg" || ending == ".pdf") {
    const Result<std::string> drawing =
        ending == ".svg" ? drawBoardSvg(*board, print) : drawBoardPdf(*board, print);
    if (!drawing) return context.fail(drawing.error());
    if (const Status written = writeFileAtomically(out, *drawing); !written)
      return context.fail(written.error());
    context.console.say("Board to print at 100 %: --board " + boardText(*board));
  } else {
    return context.misuse("--out ends in .pdf or .svg (to print) or .png (to show). Try: --out board.pdf.");
  }
  return kDone;
}

}  // namespace

void addCalibrateOptions(CLI::App& verb, CalibrateArguments* arguments, Context& context,
                         const char* photos) {
  verb.set_help_flag("-h,--help", "Print this help");
  if (photos) verb.add_option("PHOTO", arguments->photos, photos)->required()->option_text("...");
  verb.add_option("--out", arguments->out,
                  "File for the calibration (JSON); an earlier one is replaced when this is whole")
      ->required()
      ->option_text("FILE");
  verb.add_option("--device", arguments->device, "Name of the camera or screen, kept in the file")
      ->option_text("NAME");
  addCommonOptions(verb, context);
}

CalibrationRecord recordNow(const CalibrateArguments& arguments, StoredCalibration content, double residual,
                            const char* unit, const std::vector<std::string>& remarks) {
  CalibrationRecord record;
  record.content = std::move(content);
  record.device = arguments.device;
  record.taken = std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now());
  record.residual = residual;
  record.residualUnit = unit;
  record.madeBy = "patina-cli " PATINA_VERSION;
  record.remarks = remarks;
  return record;
}

Status checkCalibrationOut(const std::string& out) {
  std::error_code code;
  const fs::path file = out, folder = file.has_parent_path() ? file.parent_path() : fs::path(".");
  if (fs::is_directory(file, code))
    return Error{ErrorCode::Refused, "a folder stands where the calibration should go", out,
                 (file / "calibration.json").string()};
  if (!fs::is_directory(folder, code) || ::access(folder.c_str(), W_OK) != 0)
    return Error{ErrorCode::WriteFailed, "the calibration can't be written there", folder.string(),
                 "choose a folder that exists"};
  return Done{};
}

int finishCalibration(const CalibrateArguments& arguments, const CalibrationRecord& record,
                      Context& context) {
  if (const Status written = writeCalibration(arguments.out, record); !written)
    return context.fail(written.error());
  context.console.say("Written: " + arguments.out);
  return kDone;
}

Result<Image> readLinearPhoto(const std::string& file, const std::string& encoding) {
  Result<PhotoFile> photo = readPhotoOrRaw(file);
  if (!photo) return photo.error();
  if (photo->linear) {
    if (!encoding.empty() && encoding != "linear")
      return Error{ErrorCode::Invalid, "this photograph is linear already", file, "leave --encoding out"};
    return std::move(photo->image);
  }
  if (encoding.empty() || encoding == "linear")
    return Error{
        ErrorCode::Invalid, "this photograph is not linear", file,
        "--encoding response:FILE with what 'patina-cli calibrate response' wrote, srgb, or gamma:2.2"};
  constexpr std::string_view kResponse = "response:";
  std::span<float> samples = photo->image.samples();
  if (encoding.starts_with(kResponse)) {
    const auto curves = readResponse(encoding.substr(kResponse.size()));
    if (!curves) return curves.error();
    for (std::size_t i = 0; i < samples.size(); ++i)
      samples[i] = static_cast<float>(linearFromResponse((*curves)[i % 3], samples[i]));
    return std::move(photo->image);
  }
  const Result<PhotoEncoding> parsed = parseEncoding(encoding, "--encoding");
  if (!parsed) return parsed.error();
  for (float& v : samples)
    v = static_cast<float>(parsed->kind == PhotoEncoding::Kind::Srgb
                               ? linearFromSrgbPixel(v)
                               : std::pow(static_cast<double>(v), parsed->gamma));
  return std::move(photo->image);
}

bool readNumbers(const std::string& text, std::vector<double>* numbers) {
  numbers->clear();
  const char *at = text.data(), *end = at + text.size();
  while (at < end) {
    double value = 0;
    const auto [next, code] = std::from_chars(at, end, value);
    if (code != std::errc() || !std::isfinite(value)) return false;
    numbers->push_back(value);
    if (next == end) return true;
    if (*next != ',') return false;
    at = next + 1;
  }
  return false;
}

void addCalibrateCamera(CLI::App& parent, Context& context) {
  CLI::App* verb =
      parent.add_subcommand("camera", "The lens, from photographs of a checkerboard or ChArUco board");
  auto arguments = std::make_shared<CameraArguments>();
  addCalibrateOptions(*verb, arguments.get(), context,
                      "10 to 20 photographs of the board (PNG, JPEG, TIFF, RAW, OpenEXR), tilted to all "
                      "sides and in all parts\n"
                      "of the picture, all at one focus and zoom");
  verb->add_option(
          "--board", arguments->board,
          "KIND:COLUMNSxROWS:MM, squares and their side in mm: checkerboard:10x7:25 or charuco:11x8:22,\n"
          "then optionally :MARKERSHARE:DICTIONARY:FIRST [default: " +
              boardText(Board::forCamera()) + "]")
      ->option_text("BOARD");
  verb->add_option("--radial", arguments->options.radialTerms,
                   "Radial terms of the lens, k1 k2 k3 [default: 3]")
      ->check(CLI::Range(0, 3))
      ->option_text("0-3");
  verb->add_flag("--one-focal-length", arguments->options.oneFocalLength,
                 "fx = fy: for pixels known to be square");
  verb->add_option("--leave-out", arguments->leaveOut,
                   "A photograph (its file's name) that is judged but not used; may be given again")
      ->allow_extra_args(false)
      ->option_text("NAME");
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runCamera(*arguments, context); };
  });
}

void addCalibrateBoard(CLI::App& parent, Context& context) {
  CLI::App* verb =
      parent.add_subcommand("board", "Draws a board to true scale, to print (PDF, SVG) or to show (PNG)");
  verb->set_help_flag("-h,--help", "Print this help");
  auto arguments = std::make_shared<BoardArguments>();
  verb->add_option("--out", arguments->out, "board.pdf, board.svg or board.png")
      ->required()
      ->option_text("FILE");
  verb->add_option("--board", arguments->board,
                   "Which, as for 'calibrate camera' [default: " + boardText(Board::forCamera()) + "]")
      ->option_text("BOARD");
  verb->add_option("--paper", arguments->paper, "Width and height of the paper in mm [default: 297x210]")
      ->option_text("WxH");
  verb->add_option("--square-px", arguments->squarePx, "PNG: pixels a square [default: 100]")
      ->check(CLI::Range(10, 2000))
      ->option_text("N");
  addCommonOptions(*verb, context);
  verb->callback([arguments, &context] {
    context.run = [arguments, &context] { return runBoard(*arguments, context); };
  });
}

void addCalibrateVerb(CLI::App& program, Context& context) {
  CLI::App* verb = program.add_subcommand(
      "calibrate", "Calibrates camera, screen, white reference or response from photographs");
  verb->set_help_flag("-h,--help", "Print this help; 'patina-cli calibrate camera --help' says more");
  verb->require_subcommand(1);
  addCalibrateCamera(*verb, context);
  addCalibrateScreen(*verb, context);
  addCalibrateWhite(*verb, context);
  addCalibrateResponse(*verb, context);
  addCalibrateBoard(*verb, context);
  addCalibrateRecheck(*verb, context);
  addCalibrateMerge(*verb, context);
}

}  // namespace patina::cli
