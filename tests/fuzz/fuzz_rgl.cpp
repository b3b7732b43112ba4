#include <cstdint>
#include <string_view>

#include "engine/brdf/rgl_file.h"
#include "tests/fuzz/brdf_laws.h"

/// Any bytes as an RGL tensor file.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  patina::fuzz::checkBrdf(patina::readRglBytes(bytes, "material.file"));
  return 0;
}
