#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "engine/calibration/calibration_file.h"

/// Any bytes as a calibration: a calibration or a sentence, never a crash; and what is accepted is written
/// and accepted again, as the same.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto record = patina::parseCalibration(text, "calibration.json");
  if (!record) {
    if (record.error().what.empty() || record.error().sentence().size() > 4000) std::abort();
    return 0;
  }
  const std::string written = patina::calibrationJson(*record);
  const auto again = patina::parseCalibration(written, "calibration.json", patina::kindOf(record->content));
  if (!again || patina::calibrationJson(*again) != written) std::abort();
  return 0;
}
