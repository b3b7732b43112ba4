#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <string_view>

#include "engine/brdf/brdf_file.h"
#include "engine/brdf/merl_grid.h"
#include "tests/fuzz/brdf_laws.h"

/// Any bytes as a BRDF file of unknown format. And as a MERL file of the right size that the bytes are spread
/// over: 35 MB are too much for the fuzzer to carry around, so the input is the header, then 8 bytes a value
/// that repeat through the planes. Every 256th input only, for the same reason.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  patina::fuzz::checkBrdf(patina::readBrdfBytes(bytes, "material.binary"));

  static unsigned counter = 0;
  constexpr std::size_t kHeader = 12;
  if (size < kHeader + 8 || counter++ % 256 != 0) return 0;
  static std::string whole(kHeader + 3 * patina::MerlGrid::kCells * 8, '\0');
  std::memcpy(whole.data(), data, kHeader);
  const std::size_t period = (size - kHeader) / 8 * 8;
  for (std::size_t at = kHeader; at < whole.size(); at += period) {
    std::memcpy(whole.data() + at, data + kHeader, std::min(period, whole.size() - at));
  }
  patina::fuzz::checkBrdf(patina::readBrdfBytes(whole, "material.binary"));
  return 0;
}
