#pragma once

#include <array>
#include <cstdint>

/// What the writer and the reader of calibration files share. For this folder only.
namespace patina::calibration_format {

inline constexpr const char* kFormat = "patina-calibration";
inline constexpr const char* kResponseFormat = "patina-response";
inline constexpr int kVersion = 1;
inline constexpr std::uint64_t kLargestFile = 16u << 20;
/// In the order of StoredCalibration.
inline constexpr std::array<const char*, 6> kKinds = {"camera",     "screen-pose",     "emission",
                                                      "white-tile", "camera-response", "screen-response"};

}  // namespace patina::calibration_format
