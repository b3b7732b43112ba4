#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "engine/base/job.h"
#include "engine/flash/noise.h"
#include "engine/flash/rig.h"

namespace patina {

/// Texels over the sample rectangle, row 0 at +y, column 0 at -x.
struct FlashGrid {
  int width = 0, height = 0;
  double originXMm = 0, originYMm = 0;  ///< corner at -x, +y
  double texelXMm = 1, texelYMm = 1;
  Eigen::Vector2d pointMm(int i, int j) const {
    return {originXMm + (i + 0.5) * texelXMm, originYMm - (j + 0.5) * texelYMm};
  }
  std::size_t size() const { return static_cast<std::size_t>(width) * height; }
};

/// One photograph averaged over each texel: the mean of pixels is linear in light, and clipped ones make it a
/// lower bound.
struct FlashSheet {
  Image value;                      ///< R G B, decoded; empty: not read
  std::vector<std::uint8_t> flags;  ///< bit c: channel c holds a clipped pixel; bit 3: not seen
  static constexpr std::uint8_t kUnseen = 8;
};

/// All photographs over one grid.
struct FlashLevel {
  FlashGrid grid;
  std::vector<FlashSheet> sheets;  ///< by photograph; held-out ones are empty in a fit
  double pixelsPerTexel = 1;  ///< of photographs, averaged in one value: their noise is that much smaller
};

/// What a photograph says about one texel.
struct FlashObservation {
  int photo = 0;
  FlashRay ray;
  Eigen::Array3d irradiance;  ///< declared intensity / distance^2
  Eigen::Array3d value, variance;
  std::uint8_t clipped = 0;  ///< bit c: at least `value`
};

/// One texel with all that is seen of it.
struct FlashSite {
  Eigen::Vector2d pointMm = Eigen::Vector2d::Zero();
  int material = 0;
  int block = 0;  ///< part of the sample, for errors that neighbours share
  std::vector<FlashObservation> seen;
};

/// The photographs of a capture, read.
struct FlashData {
  FlashCapture capture;
  FlashNoise noise;
  std::array<float, 3> clip{0, 0, 0};  ///< decoded values from here on are lower bounds; 0: none is
  std::vector<FlashLevel> levels;      ///< finest first, each next half as wide
  std::size_t clippedSamples = 0;
};

/// Reads the photographs that may be fitted, one after the other, and averages them over texels. size:
/// longest side of the finest grid; 0: what the photographs resolve. Errors: those of reading; Invalid (no
/// photograph sees the sample); Cancelled.
Result<FlashData> readFlashData(const FlashCapture& capture, int size, const JobContext& job);
/// One more photograph over a grid (a held-out one, to compare with).
FlashSheet sheetOf(const FlashCapture& capture, int photo, const FlashPixels& pixels, const FlashGrid& grid,
                   const std::array<float, 3>& clip);
/// A texel's observations at one level, of the photographs that the level holds.
FlashSite siteOf(const FlashData& data, const FlashLevel& level, int i, int j);
/// Where a point of the sample is in a photograph; pixel centres at integers.
Eigen::Vector2d pixelOf(const FlashCapture& capture, int photo, int width, int height,
                        const Eigen::Vector2d& pointMm);

}  // namespace patina
