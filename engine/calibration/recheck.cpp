#include <algorithm>
#include <cmath>
#include <cstdio>

#include "engine/calibration/calibration_file.h"

namespace patina {
namespace {

constexpr double kLensPx = 0.3, kLensFactor = 2;  // recheckCamera
constexpr double kPosePx = 0.5;                   // recheckScreenPose
constexpr double kLevel = 0.01;                   // recheckWhiteTile
constexpr double kExposures = 0.02;               // recheckResponse
constexpr std::size_t kFewestPixels = 200;

template <typename Content>
Result<const Content*> contentOf(const CalibrationRecord& stored, const char* kind) {
  if (const Content* content = std::get_if<Content>(&stored.content)) return content;
  return Error{ErrorCode::Invalid,
               std::string("a calibration of kind '") + kind + "' is needed, and this one is of kind '" +
                   std::string(kindOf(stored.content)) + "'",
               "", ""};
}

Error notSeen(const std::string& which, const BoardDetection& found) {
  return {ErrorCode::NotFound, which + " is not seen: " + found.whyNot, "", "one more photograph"};
}

template <typename... Values>
std::string words(const char* format, Values... values) {
  char text[320];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

}  // namespace

Result<Recheck> recheckCamera(const CalibrationRecord& stored, const Image& photo) {
  const auto content = contentOf<StoredCamera>(stored, "camera");
  if (!content) return content.error();
  const StoredCamera& camera = **content;
  const BoardDetection found = detectBoard(photo, camera.board);
  if (!found.found) return notSeen("the calibration's " + camera.board.inWords(), found);
  const Result<BoardPose> pose = poseOfBoard(camera.camera, camera.board, found.view);
  if (!pose) return pose.error();
  Recheck check;
  check.unit = "px";
  check.difference = pose->rmsPx;
  const double bound = std::max(kLensPx, kLensFactor * stored.residual);
  check.good = pose->rmsPx <= bound;
  check.sentence =
      check.good
          ? words("the board's corners are %.2f px from where the stored lens puts them: it still holds",
                  pose->rmsPx)
          : words(
                "the board's corners are %.2f px from where the stored lens puts them, and %.2f px would do: "
                "zoom, focus "
                "or lens have changed, or the board is bent; calibrate the camera again",
                pose->rmsPx, bound);
  return check;
}

Result<Recheck> recheckScreenPose(const CalibrationRecord& stored, const Image& photo) {
  const auto content = contentOf<StoredScreenPose>(stored, "screen-pose");
  if (!content) return content.error();
  const StoredScreenPose& pose = **content;
  if (photo.width() != pose.camera.width || photo.height() != pose.camera.height)
    return Error{ErrorCode::Invalid,
                 words("the photograph has %d x %d pixels and the calibration's %d x %d", photo.width(),
                       photo.height(), pose.camera.width, pose.camera.height),
                 "", "photograph at the calibration's resolution"};
  const BoardDetection sample = detectBoard(photo, pose.onSample.board);
  if (!sample.found) return notSeen("the board on the sample plane", sample);
  BoardDetectionOptions look;
  look.side = BoardSide::Mirrored;
  const BoardDetection mirrored = detectBoard(photo, pose.onScreen.board, look);

  double sum = 0;
  std::size_t count = 0;
  const auto compare = [&](const BoardView& view, const auto& world) {
    for (const BoardCorner& corner : view.corners) {
      const auto expected = pose.camera.pixelFromWorld(world(corner.id));
      if (!expected) continue;
      sum += (*expected - corner.pixel).squaredNorm();
      ++count;
    }
  };
  compare(sample.view, [&](int id) { return pose.onSample.cornerMm(id); });
  const double sampleOff = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, count)));
  double screenOff = 0;
  if (mirrored.found) {
    sum = 0, count = 0;
    compare(mirrored.view, [&](int id) {
      const Eigen::Vector3d at =
          pose.screen.worldFromScreen * pose.onScreen.cornerMm(id) + pose.screen.originMm;
      return Eigen::Vector3d(at.x(), at.y(), 2 * pose.mirrorHeightMm - at.z());
    });
    screenOff = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, count)));
  }
  Recheck check;
  check.unit = "px";
  check.difference = std::max(sampleOff, screenOff);
  check.good = check.difference <= kPosePx;
  if (check.good) {
    check.sentence =
        mirrored.found
            ? words("camera and screen are where they were (%.2f and %.2f px)", sampleOff, screenOff)
            : words(
                  "the camera is where it was (%.2f px); the screen was not seen in a mirror and is taken on "
                  "trust",
                  sampleOff);
    return check;
  }
  MirrorCalibrationInput input;
  input.camera = pose.camera;
  input.screen = pose.screen;
  input.onSample = pose.onSample, input.onScreen = pose.onScreen;
  input.mirrorHeightMm = pose.mirrorHeightMm;
  input.sampleView = sample.view;
  if (mirrored.found) input.mirroredView = mirrored.view;
  const Result<ScreenPoseCalibration> now = mirrored.found ? calibrateScreenPose(input) : Error{};
  if (now.ok()) {
    const PoseDifference camera = differenceOf(now->camera, pose.camera),
                         screen = differenceOf(now->screen, pose.screen);
    check.sentence = words(
        "corners are off by %.2f px: since the calibration the camera has moved by %.1f mm and %.2f degrees "
        "and the screen by "
        "%.1f mm and %.2f degrees, seen from the board; repeat the mirror calibration",
        check.difference, camera.distanceMm, camera.angleDeg, screen.distanceMm, screen.angleDeg);
  } else {
    check.sentence = words(
        "corners of the board on the sample plane are off by %.2f px: the camera or the board has moved; "
        "repeat the mirror calibration",
        sampleOff);
  }
  return check;
}

Result<Recheck> recheckWhiteTile(const CalibrationRecord& stored, const Image& photo,
                                 const WhiteTileOptions& options) {
  const auto content = contentOf<StoredWhiteTile>(stored, "white-tile");
  if (!content) return content.error();
  WhiteTileOptions same = options;
  if (same.region.whole()) same.region = (*content)->region;
  const Result<WhiteTileCalibration> now = calibrateWhiteTile(photo, (*content)->reflectance, same);
  if (!now) return now.error();
  if (!((*content)->irradiance.minCoeff() > 0))
    return Error{ErrorCode::Invalid, "the stored tile is black", "", "calibrate the tile again"};
  const Eigen::Vector3d ratio = now->mean.cwiseQuotient((*content)->irradiance);
  const double level = ratio.mean() - 1;
  const Eigen::Vector3d colour = ratio / ratio.mean() - Eigen::Vector3d::Ones();
  Recheck check;
  check.unit = "%";
  check.difference = 100 * std::max(std::abs(level), colour.cwiseAbs().maxCoeff());
  check.good = check.difference <= 100 * kLevel && now->passed();
  check.sentence =
      words("the tile's light is %.2f %% %s than at the calibration, its colour differs by %.2f %%",
            100 * std::abs(level), level >= 0 ? "brighter" : "darker", 100 * colour.cwiseAbs().maxCoeff());
  if (!now->passed()) {
    for (const TileCheck& one : now->checks)
      if (!one.passed) check.sentence += "; " + one.sentence;
  } else if (check.good) {
    check.sentence += ": it still holds";
  } else {
    check.sentence +=
        ": let the light warm up, look whether it or the tile has moved, or photograph the tile again";
  }
  return check;
}

Result<Recheck> recheckResponse(const CalibrationRecord& stored, const std::vector<ExposedPhoto>& photos) {
  const auto content = contentOf<StoredResponse>(stored, "camera-response");
  if (!content) return content.error();
  const StoredResponse& response = **content;
  if (photos.size() < 2)
    return Error{ErrorCode::Invalid, "two exposures of one scene are needed", "",
                 "two photographs, one twice as long"};
  const Image& first = photos[0].image;
  for (const ExposedPhoto& photo : photos)
    if (photo.image.width() != first.width() || photo.image.height() != first.height() ||
        photo.image.channels() != 3 || !(photo.exposureS > 0))
      return Error{ErrorCode::Invalid, "the photographs are not of one size, or an exposure isn't positive",
                   photo.name, ""};
  Recheck check;
  check.unit = "%";
  const std::size_t step = std::max<std::size_t>(1, first.samples().size() / 30000);
  bool any = false;
  for (std::size_t j = 1; j < photos.size(); ++j) {
    std::vector<double> ratios;
    for (std::size_t i = 0; i < first.samples().size(); i += step) {
      const double a = photos[0].image.samples()[i], b = photos[j].image.samples()[i];
      if (a < 0.1 || b < 0.1 || a > 0.95 || b > 0.95) continue;
      const ResponseCurve& curve = response.curves[i % 3];
      const double la = linearFromResponse(curve, a) / photos[0].exposureS,
                   lb = linearFromResponse(curve, b) / photos[j].exposureS;
      if (la > 0) ratios.push_back(lb / la - 1);
    }
    if (ratios.size() < kFewestPixels) continue;
    any = true;
    const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
    std::nth_element(ratios.begin(), middle, ratios.end());
    check.difference = std::max(check.difference, 100 * std::abs(*middle));
  }
  if (!any)
    return Error{ErrorCode::Invalid, "too few pixels are neither dark nor clipped in both exposures", "",
                 "exposures at most four times apart, of a scene of middling brightness"};
  check.good = check.difference <= 100 * kExposures;
  check.sentence =
      check.good
          ? words("linearised exposures agree within %.2f %%: the curve still holds", check.difference)
          : words(
                "linearised exposures differ by %.1f %%: the camera's picture style, gamma or gain has "
                "changed, or the exposure times are not what was said; measure the response again",
                check.difference);
  return check;
}

}  // namespace patina
