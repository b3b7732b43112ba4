#pragma once

#include <vector>

#include "engine/flash/joint.h"

namespace patina {

/// Texels that look alike, by the colour of their darker half of photographs (away from highlights).
struct FlashPalette {
  std::vector<Eigen::Array3d> logColour;  ///< of each material, natural logarithms of a diffuse albedo
  /// The material whose colour is nearest; hue counts more than brightness, which the relief changes too.
  int nearest(const Eigen::Array3d& logColour) const;
};
/// k-means with a number of materials that the colours ask for, or the one that is given (1 to 8). Ordered by
/// share, largest first. The same for the same sample.
FlashPalette findMaterials(const std::vector<Eigen::Array3d>& logColours, int count);

/// The level that shared numbers are fitted on: no wider than 256 texels.
std::size_t sampleLevel(const FlashData& data);
/// About `texels` texels, evenly spread; materials not yet told. Blocks: an 8 x 8 division of the sample.
FlashSample drawSample(const FlashData& data, const FlashLevel& level, int texels);

/// First state of a sample: priors from colours, lobes not yet fitted.
JointState firstState(const FlashData& data, FlashSample& sample, const FlashPalette& palette);

/// Shared numbers from nothing: several lobe widths tried, the best kept for each material, then refined
/// together with `effects`.
JointState fitShared(const FlashData& data, FlashSample& sample, const FlashPalette& palette,
                     const std::vector<FlashEffect>& effects, const std::vector<char>& photos,
                     const JobContext& job);

}  // namespace patina
