#pragma once

#include "engine/flash/joint.h"
#include "engine/flash/materials.h"
#include "engine/surface/svbrdf_maps.h"

namespace patina {

/// Every texel of one level.
struct FlashSolved {
  std::vector<Eigen::Matrix<float, FlashTexel::kParameters, 1>> x, sd;
  std::vector<std::uint8_t> material;
  std::vector<TexelStatus> status;
  std::vector<float> residual;           ///< relative RMS over fitted photographs
  std::vector<FlashMaterial> materials;  ///< as at this level: spread about the coarser level, discrepancy
  std::int64_t iterations = 0;
};

/// Fits all texels with shared numbers given, coarse levels first: a texel's prior is its coarser
/// neighbourhood of the same material, with the spread that this level's texels show about theirs. Cancelled:
/// as far as it came, the rest from the coarser level and marked.
FlashSolved solveSheet(const FlashData& data, const FlashPalette& palette, const FlashModel& model,
                       const JobContext& job);

}  // namespace patina
