#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "engine/capture/two_shot_capture.h"

/// Any bytes as the capture.json of a two-shot bundle: a description or a sentence, never a crash; and what
/// is accepted is written and accepted again.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto capture = patina::parseTwoShotCapture(text, "bundle", "capture.json");
  if (!capture) {
    if (capture.error().what.empty() || capture.error().sentence().size() > 4000) std::abort();
    return 0;
  }
  const std::string written = patina::twoShotCaptureJson(*capture);
  const auto again = patina::parseTwoShotCapture(written, "bundle", "capture.json");
  if (!again || patina::twoShotCaptureJson(*again) != written) std::abort();
  for (const patina::TwoShotPhoto& shot : capture->shots) {
    const Eigen::Vector2d centre(0.5 * shot.camera.width, 0.5 * shot.camera.height);
    (void)shot.camera.samplePlaneFromPixel(centre);
  }
  return 0;
}
