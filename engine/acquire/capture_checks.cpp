#include "engine/acquire/capture_checks.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "engine/acquire/exposure.h"
#include "engine/acquire/picture_shift.h"

namespace patina {
namespace {

using State = CheckItem::State;

constexpr double kPercentile = 0.999;  ///< of the sample's pixels that the fill counts for
constexpr int kExposureRounds = 8;     ///< each a factor of up to four: 1/1000 s to 16 s and back
// What is still good, and what is bad (between: a warning).
constexpr double kAmbientGood = 0.02, kAmbientBad = 0.15;  ///< of the window's light
constexpr double kMovedGood = 0.15, kMovedBad = 0.5;       ///< pixels
constexpr double kFlickerGood = 0.005, kFlickerBad = 0.03;
constexpr double kDriftGood = 0.005, kDriftBad = 0.03;
constexpr double kUnlitGood = 0.005, kUnlitBad = 0.1;  ///< of the sample
constexpr double kUnlit = 0.02;                        ///< of the median: darker is not lit
constexpr double kSharp = 0.2, kBlurred = 0.08;        ///< see `sharpness`

State stateOf(double value, double good, double bad) {
  return value <= good ? State::Good : value <= bad ? State::Warning : State::Bad;
}

std::string text(const char* format, double value) {
  char line[200];
  std::snprintf(line, sizeof line, format, value);
  return line;
}

/// The rig while it is looked at.
struct Looker {
  CameraDevice& camera;
  PatternDisplay& display;
  const RigDescription& rig;
  const JobContext& job;
  Screen screen;
  double exposureS = 0, gain = 1;
  std::optional<double> settableExposure,
      settableGain;  ///< what `still` is asked for; empty: the camera has none

  Result<RigTime> show(const PatternSpec& spec) {
    const Result<OnGlass> shown = display.show(shownPattern(spec, screen, rig.screenResponse), job.stop);
    if (!shown) return shown.error();
    return shown->since;
  }
  Result<std::vector<Frame>> frames(RigTime since, int count) {
    StillRequest request;
    if (settableExposure) request.exposureS = exposureS;
    if (settableGain) request.gain = gain;
    request.notBefore = since;
    request.frames = count;
    return camera.still(request, job.stop);
  }
  Result<std::vector<Image>> pictures(const PatternSpec& spec, int count) {
    const Result<RigTime> since = show(spec);
    if (!since) return since.error();
    const Result<std::vector<Frame>> taken = frames(*since, count);
    if (!taken) return taken.error();
    std::vector<Image> images;
    for (const Frame& frame : *taken) {
      Result<Image> image = linearImage(frame, rig.conversion);
      if (!image) return image.error();
      images.push_back(std::move(*image));
    }
    return images;
  }
};

Image sampleMask(const RigDescription& rig, int width, int height) {
  Image mask(width, height, 1);
  Camera camera = rig.camera;
  if (width != camera.width || height != camera.height) {
    std::ranges::fill(mask.samples(), 1.0f);  // another resolution than calibrated: said elsewhere
    return mask;
  }
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (const auto at = camera.samplePlaneFromPixel({x, y}))
        mask.at(x, y) =
            std::abs(at->x()) <= rig.sampleWidthMm / 2 && std::abs(at->y()) <= rig.sampleHeightMm / 2 ? 1.0f
                                                                                                      : 0.0f;
  return mask;
}

double meanOn(const Image& image, const Image& mask) {
  double sum = 0, count = 0;
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x)
      if (mask.at(x, y) > 0)
        for (const float sample : image.pixel(x, y)) sum += sample, ++count;
  return count > 0 ? sum / count : 0;
}

/// Chooses the exposure under the window; false where the camera can't be told.
Result<bool> chooseExposure(Looker& look, const CheckOptions& options, Image& mask) {
  PatternSpec window;
  window.kind = PatternSpec::Kind::Window;
  const Result<std::vector<CameraControl>> controls = look.camera.controls();
  if (!controls) return controls.error();
  const auto find = [&](CameraControlId id) { return std::ranges::find(*controls, id, &CameraControl::id); };
  const auto exposure = find(CameraControlId::ExposureS);
  if (const auto gain = find(CameraControlId::Gain); gain != controls->end() && gain->writable) {
    look.gain = std::clamp(1.0, gain->least, gain->most);
    look.settableGain = look.gain;
  }
  const bool settable = exposure != controls->end();
  if (settable) {
    const double refresh = look.display.screen().refreshHz;
    const double most = std::min(exposure->most, options.longestS);
    look.exposureS = wholeRefreshes(0.05, refresh, exposure->least, most);
    look.settableExposure = look.exposureS;
    const Result<RigTime> since = look.show(window);
    if (!since) return since.error();
    for (int round = 0; round < kExposureRounds; ++round) {
      const Result<std::vector<Frame>> taken = look.frames(*since, 1);
      if (!taken) return taken.error();
      const Result<Image> image = linearImage(taken->front(), look.rig.conversion);
      if (!image) return image.error();
      if (mask.empty()) mask = sampleMask(look.rig, image->width(), image->height());
      const double wanted =
          exposureFor(*image, mask, look.exposureS, options.fill, kPercentile, exposure->least, most);
      double next = wholeRefreshes(wanted, refresh, exposure->least, most);
      // Rounding to whole periods must not bring clipping back.
      if (next > 1.15 * wanted && refresh > 0 && next - 1 / refresh >= exposure->least) next -= 1 / refresh;
      if (std::abs(next - look.exposureS) < 1e-6) break;
      look.exposureS = next;
    }
    return true;
  }
  const Result<std::vector<Image>> image = look.pictures(window, 1);
  if (!image) return image.error();
  mask = sampleMask(look.rig, image->front().width(), image->front().height());
  return false;
}

}  // namespace

bool Checklist::good() const {
  return std::ranges::none_of(items, [](const CheckItem& item) { return item.state == State::Bad; });
}

Result<Checklist> checkRig(CameraDevice& camera, PatternDisplay& display, const RigDescription& rig,
                           const CheckOptions& options, const JobContext& job) {
  constexpr int kSteps = 8;
  int step = 0;
  const auto progress = [&] { job.progress("check", step++, kSteps, "checks"); };
  Checklist list;
  Looker look{camera, display, rig, job, rig.screen, 0, 1, {}, {}};
  look.screen.widthPx = display.screen().widthPx;
  look.screen.heightPx = display.screen().heightPx;
  const auto add = [&](CheckId id, State state, double value, const char* unit, const char* title,
                       std::string sentence, const char* tryThis) {
    list.items.push_back(
        {id, state, value, unit, title, std::move(sentence), state == State::Good ? "" : tryThis});
  };
  PatternSpec window, black;
  window.kind = PatternSpec::Kind::Window;

  progress();
  Image mask;
  const Result<bool> settable = chooseExposure(look, options, mask);
  if (!settable) return settable.error();
  add(CheckId::Controls, *settable ? State::Good : State::Warning, 0, "", "Camera settings",
      *settable ? "Exposure and gain are set by the program."
                : "This camera's exposure can't be set by the program.",
      "set the camera itself to manual: exposure, sensitivity, white balance and focus, and leave them");

  progress();
  const Result<RigTime> since = look.show(window);
  if (!since) return since.error();
  const Result<std::vector<Frame>> two = look.frames(*since, 2);
  if (!two) return two.error();
  const Result<Image> one = linearImage((*two)[0], rig.conversion),
                      other = linearImage((*two)[1], rig.conversion);
  if (!one) return one.error();
  if (!other) return other.error();
  const Result<Image> clipped = clippedMask((*two)[0]);
  if (!clipped) return clipped.error();
  list.exposureS = *settable ? look.exposureS : 0;
  list.gain = look.gain;
  if (one->width() != rig.camera.width || one->height() != rig.camera.height)
    return Error{ErrorCode::Invalid,
                 "the camera's pictures are " + std::to_string(one->width()) + " x " +
                     std::to_string(one->height()) + " pixels, and it was calibrated with " +
                     std::to_string(rig.camera.width) + " x " + std::to_string(rig.camera.height),
                 camera.info().name, "choose the format that it was calibrated with, or calibrate it again"};
  double hit = 0, all = 0;
  std::vector<float> levels, greys;
  const Image grey = greyOf(*one);
  for (int y = 0; y < one->height(); ++y)
    for (int x = 0; x < one->width(); ++x) {
      if (!(mask.at(x, y) > 0)) continue;
      ++all;
      hit += clipped->at(x, y) > 0 ? 1 : 0;
      levels.push_back(*std::ranges::max_element(one->pixel(x, y)));
      greys.push_back(grey.at(x, y));
    }
  if (levels.empty())
    return Error{ErrorCode::Invalid, "the camera doesn't see the sample where calibration says that it lies",
                 camera.info().name,
                 "check that the camera stands where it was calibrated, or calibrate its pose again"};
  std::ranges::sort(levels);
  list.brightest = levels[static_cast<std::size_t>(kPercentile * static_cast<double>(levels.size() - 1))];
  add(CheckId::Exposure,
      list.brightest >= 0.25   ? State::Good
      : list.brightest >= 0.05 ? State::Warning
                               : State::Bad,
      100 * list.brightest, "% of full scale", "Exposure",
      text("The brightest places reach %.0f %% of what the camera can hold.", 100 * list.brightest),
      "open the aperture, raise the gain, or bring the screen nearer");
  add(CheckId::Clipping, stateOf(hit / all, 1e-3, 0.02), 100 * hit / all, "% of the sample", "Clipping",
      text("%.2f %% of the sample is brighter than the camera can hold.", 100 * hit / all),
      "shorten the exposure or close the aperture");

  progress();
  const Result<std::vector<Image>> dark = look.pictures(black, 1);
  if (!dark) return dark.error();
  const double lit = meanOn(*one, mask), room = meanOn(dark->front(), mask);
  const double ambient = lit > 0 ? std::max(0.0, room) / lit : 1;
  add(CheckId::Ambient, stateOf(ambient, kAmbientGood, kAmbientBad), 100 * ambient, "% of the screen's light",
      "Ambient light", text("With the screen black there is %.1f %% of the light left.", 100 * ambient),
      "darken the room: lamps off, curtains closed, other screens away");

  progress();
  // The same window again, after a while.
  if (!display.wait(std::chrono::microseconds(static_cast<std::int64_t>(1e6 * options.warmUpSeconds)),
                    job.stop))
    return Error{ErrorCode::Cancelled, "the checks were cancelled", "", ""};
  const Result<std::vector<Image>> later = look.pictures(window, 1);
  if (!later) return later.error();
  const PictureShift shift = pictureShift(*one, later->front(), mask);
  if (shift.uncertaintyPx < kMovedGood) {
    add(CheckId::Movement, stateOf(shift.px.norm(), kMovedGood, kMovedBad), shift.px.norm(), "px", "Movement",
        text("Between two photographs the picture moved by %.2f pixels.", shift.px.norm()),
        "put the camera on a stand, and don't touch the table");
  } else {
    add(CheckId::Movement, State::NotKnown, 0, "px", "Movement",
        "The sample is too plain to tell whether anything moves.",
        "lay a printed sheet beside the sample to make sure");
  }

  progress();
  const double sharp = sharpness(*one, *other, mask);
  if (sharp < 0) {
    add(CheckId::Focus, State::NotKnown, 0, "", "Focus",
        "The sample is too plain to tell whether it is sharp.",
        "lay a printed sheet on the sample, focus on it, and take it away");
  } else {
    add(CheckId::Focus,
        sharp >= kSharp     ? State::Good
        : sharp >= kBlurred ? State::Warning
                            : State::Bad,
        sharp, "", "Focus",
        sharp >= kSharp     ? "The sample is sharp."
        : sharp >= kBlurred ? "The sample may not be sharp."
                            : "The sample is out of focus.",
        "focus on the sample by hand, and leave the lens alone from then on");
  }

  progress();
  const Result<std::vector<Image>> run = look.pictures(window, std::max(2, options.flickerFrames));
  if (!run) return run.error();
  double mean = 0, squares = 0;
  for (const Image& image : *run) {
    const double level = meanOn(image, mask);
    mean += level / static_cast<double>(run->size());
    squares += level * level / static_cast<double>(run->size());
  }
  const double flicker = mean > 0 ? std::sqrt(std::max(0.0, squares - mean * mean)) / mean : 0;
  add(CheckId::Flicker, stateOf(flicker, kFlickerGood, kFlickerBad), 100 * flicker, "%", "Flicker",
      text("From photograph to photograph the brightness changes by %.2f %%.", 100 * flicker),
      "set the screen to full brightness, switch lamps off that flicker, or use a longer exposure");

  progress();
  std::vector<float> sorted = greys;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                   sorted.end());
  const double median = sorted[sorted.size() / 2] - room;
  double unlit = 0;
  for (const float level : greys) unlit += level - room < kUnlit * median ? 1 : 0;
  unlit /= static_cast<double>(greys.size());
  add(CheckId::Lighting, stateOf(unlit, kUnlitGood, kUnlitBad), 100 * unlit, "% of the sample", "Lighting",
      text("%.1f %% of the sample gets no light of the screen.", 100 * unlit),
      "turn the screen towards the sample, and take away what casts a shadow");

  progress();
  const double drift = lit > 0 ? std::abs(meanOn(later->front(), mask) / lit - 1) : 0;
  add(CheckId::WarmUp, stateOf(drift, kDriftGood, kDriftBad), 100 * drift, "%", "Warm-up",
      text("The screen's brightness changed by %.2f %% while it was looked at.", 100 * drift),
      "leave the screen on, bright, for twenty minutes before the capture");
  job.progress("check", kSteps, kSteps, "checks");
  return list;
}

}  // namespace patina
