#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "engine/capture/capture_json.h"

/// Any bytes as capture.json: a description or a sentence, never a crash; and what is accepted is written and
/// accepted again.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto capture = patina::parseFourierCapture(text, "bundle", "capture.json");
  if (!capture) {
    if (capture.error().what.empty() || capture.error().sentence().size() > 4000) std::abort();
    return 0;
  }
  const std::string written = patina::fourierCaptureJson(*capture);
  const auto again = patina::parseFourierCapture(written, "bundle", "capture.json");
  if (!again || patina::fourierCaptureJson(*again) != written) std::abort();
  for (const double x : {0.0, 0.5, 1.0}) {
    const Eigen::Vector2d pixel(x * capture->camera.width, x * capture->camera.height);
    (void)capture->camera.samplePlaneFromPixel(pixel);
  }
  return 0;
}
