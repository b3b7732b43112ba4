#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "engine/capture/flash_capture.h"

/// Any bytes as the capture.json of a flash bundle: a description or a sentence, never a crash; and what is
/// accepted is written and accepted again.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto capture = patina::parseFlashCapture(text, "bundle", "capture.json");
  if (!capture) {
    if (capture.error().what.empty() || capture.error().sentence().size() > 4000) std::abort();
    return 0;
  }
  const std::string written = patina::flashCaptureJson(*capture);
  const auto again = patina::parseFlashCapture(written, "bundle", "capture.json");
  if (!again || patina::flashCaptureJson(*again) != written) std::abort();
  for (const patina::FlashPhoto& photo : capture->photos) {
    if (!(photo.cameraPositionMm.z() > 0) || !(photo.lightPositionMm.z() > 0)) std::abort();
    if (!photo.rectified && !photo.camera) std::abort();
  }
  return 0;
}
