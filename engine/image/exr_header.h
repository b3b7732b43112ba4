#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "engine/base/result.h"
#include "engine/image/image_size.h"

namespace patina {

/// Walks over an OpenEXR file's header before the library does, which believes every length that it finds
/// there and takes memory for it: lengths must lie inside the file, and attributes of a known type must have
/// that type's length (the library doesn't skip the rest, and would read on somewhere else). Returns the size
/// of the (first part's) data window. Errors: Malformed; Invalid where the picture isn't of the `expected`
/// size. Cost: the header's length. `fileBytes`: the whole file's length where `bytes` is only its beginning.
/// Source: OpenEXR, "File Layout".
Result<ImageSize> checkExrHeader(std::string_view bytes, const std::string& where,
                                 std::optional<ImageSize> expected,
                                 std::optional<std::uint64_t> fileBytes = {});

}  // namespace patina
