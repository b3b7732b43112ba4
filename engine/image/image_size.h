#pragma once

#include <cstdint>
#include <string>

#include "engine/base/result.h"

namespace patina {

/// Pixels across and down.
struct ImageSize {
  int width = 0, height = 0;
  bool operator==(const ImageSize&) const = default;
};

/// No picture that we read is larger: 2^28 pixels (16384 squared) take 3 GiB as RGB floats.
inline constexpr std::int64_t kMaxImagePixels = std::int64_t{1} << 28;
/// Nor longer on one side.
inline constexpr int kMaxImageSide = 1 << 17;
/// The largest image file that is read: 2^28 pixels of three floats, uncompressed, and some.
inline constexpr std::uint64_t kMaxImageFileBytes = std::uint64_t{4} << 30;

/// The failure of an image that isn't as large as it should be.
inline Error wrongSize(ImageSize found, ImageSize expected, const std::string& where) {
  return {ErrorCode::Invalid,
          "the image is " + std::to_string(found.width) + " x " + std::to_string(found.height) +
              " pixels, and " + std::to_string(expected.width) + " x " + std::to_string(expected.height) +
              " are expected",
          where, "check camera.width and camera.height, or replace the image by one of that size"};
}

}  // namespace patina
