#include <cstdint>
#include <string_view>

#include "engine/brdf/alta_file.h"
#include "tests/fuzz/brdf_laws.h"

/// Any bytes as an ALTA text table.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  patina::fuzz::checkBrdf(patina::readAltaBytes(bytes, "material.file"));
  return 0;
}
