#include "engine/acquire/latency.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "engine/acquire/frame_image.h"

namespace patina {
namespace {

using std::chrono::microseconds;

constexpr auto kSettled = std::chrono::milliseconds(600);  ///< no display is later than that
constexpr double kWhollyNew = 0.97;  ///< of the step from black to white: what noise leaves of "all of it"

double meanOf(const Image& image) {
  double sum = 0;
  for (const float sample : image.samples()) sum += sample;
  return image.samples().empty() ? 0 : sum / static_cast<double>(image.samples().size());
}

}  // namespace

Result<LatencyMeasurement> measureLatency(CameraDevice& camera, PatternDisplay& display, double exposureS,
                                          int flashes, const JobContext& job) {
  const ScreenInfo info = display.screen();
  Screen screen;
  screen.widthPx = info.widthPx;
  screen.heightPx = info.heightPx;
  screen.widthMm = info.widthPx;
  screen.heightMm = info.heightPx;
  PatternSpec flat;
  flat.kind = PatternSpec::Kind::Flat;
  const ShownPicture white = shownPattern(flat, screen, ScreenResponse::linear());
  const ShownPicture black = shownPattern({}, screen, ScreenResponse::linear());
  const microseconds before = display.latency();
  struct Restore {
    PatternDisplay& display;
    microseconds latency;
    ~Restore() { display.setLatency(latency); }
  } restore{display, before};
  display.setLatency(microseconds(0));

  StillRequest request;
  request.exposureS = exposureS;
  const auto level = [&](const ShownPicture& picture) -> Result<double> {
    const Result<OnGlass> shown = display.show(picture, job.stop);
    if (!shown) return shown.error();
    StillRequest settled = request;
    settled.notBefore = shown->swapped + kSettled;
    if (!display.wait(kSettled, job.stop)) return Error{ErrorCode::Cancelled, "cancelled", "", ""};
    const Result<std::vector<Frame>> frames = camera.still(settled, job.stop);
    if (!frames) return frames.error();
    const Result<Image> image = linearImage(frames->front());
    if (!image) return image.error();
    return meanOf(*image);
  };
  std::vector<double> latencies;
  for (int flash = 0; flash < flashes; ++flash) {
    job.progress("latency", flash, flashes, "flashes");
    const bool up = flash % 2 == 0;
    const Result<double> from = level(up ? black : white), first = from ? level(up ? white : black) : from;
    if (!from) return from.error();
    if (!first) return first.error();
    const double to = *first;
    if (std::abs(to - *from) < 0.01 * std::max(std::abs(to), std::abs(*from)) + 1e-4)
      return Error{ErrorCode::Refused, "the camera sees no difference between a black and a white screen",
                   camera.info().name, "point it at the sample or the screen, and raise the exposure"};
    if (const Result<double> again = level(up ? black : white); !again) return again.error();
    const Result<OnGlass> shown = display.show(up ? white : black, job.stop);
    if (!shown) return shown.error();
    StillRequest watch = request;
    watch.notBefore = shown->swapped;
    watch.frames = std::clamp(static_cast<int>(std::ceil(0.6 / std::max(exposureS, 1e-3))), 2, 60);
    const Result<std::vector<Frame>> frames = camera.still(watch, job.stop);
    if (!frames) return frames.error();
    RigTime since = frames->back().metadata.exposureStart;
    for (std::size_t i = frames->size();
         i-- > 0;) {  // from the last one back to the first that isn't new yet
      const Result<Image> image = linearImage((*frames)[i]);
      if (!image) return image.error();
      if ((meanOf(*image) - *from) / (to - *from) < kWhollyNew) break;
      since = (*frames)[i].metadata.exposureStart;
    }
    latencies.push_back(std::chrono::duration<double, std::micro>(since - shown->swapped).count());
  }
  LatencyMeasurement found;
  found.flashes = flashes;
  if (!latencies.empty()) {
    const auto [least, most] = std::ranges::minmax_element(latencies);
    found.latency = microseconds(static_cast<std::int64_t>(std::ceil(*most)));
    found.spread = microseconds(static_cast<std::int64_t>(*most - *least));
  }
  job.progress("latency", flashes, flashes, "flashes");
  return found;
}

}  // namespace patina
