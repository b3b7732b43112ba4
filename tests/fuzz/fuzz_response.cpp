#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "engine/capture/encoding.h"

/// Any bytes as a response file, and as the text of an encoding. An accepted curve never falls.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  (void)patina::parseEncoding(std::string(text), "photos[0].encoding");
  const auto curves = patina::parseResponse(text, "response.json");
  if (!curves) return 0;
  for (const patina::ResponseCurve& curve : *curves) {
    double last = 0;
    for (int i = -1; i <= 33; ++i) {
      const double value = patina::linearFromResponse(curve, i / 32.0);
      if (!(value >= last)) std::abort();
      last = value;
    }
  }
  return 0;
}
