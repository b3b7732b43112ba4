#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "engine/brdf/half_diff.h"
#include "engine/twoshot/reflectance_picture.h"

namespace patina {

/// Measurements of one material: means over blocks of neighbouring pixels. n rows.
struct Observations {
  std::vector<HalfDiffAngles> angles;       ///< at the block's mean position on the sample
  std::vector<Eigen::Vector2d> positionMm;  ///< that position
  std::vector<Eigen::Array3d> brdf;      ///< R G B, 1/sr, mean over the block (of values, not of logarithms)
  std::vector<Eigen::Array3d> variance;  ///< of brdf: sensor noise, white photograph included
  std::vector<double> weight;            ///< how many of a picture's kEtaRows rows this row stands for
  std::vector<int> fold;                 ///< contiguous part of the pictures, for cross-validation
  std::vector<int> picture;              ///< index into the pictures
  std::size_t pixels = 0;                ///< that went into the rows
  std::vector<std::size_t> picturePixels;  ///< the same for each picture

  std::size_t size() const { return angles.size(); }
};

/// Means over blocks, about `rowsPerPicture` a picture for the whole sample.
///
/// Blocks are squares of pixels of one material, chosen by a quadtree: it begins with a quarter of the rows
/// and splits, while rows are left, the block whose mapped values vary most beyond their noise (times its
/// weight); blocks that vary by less than 2 % stay whole. So a highlight that is narrower than a block is
/// resolved, down to single pixels, and nothing is averaged over a steep slope.
///
/// Weights don't follow the blocks: as in the paper a pixel is a pixel, kEtaRows a picture in all. Where some
/// pixels are not used, their neighbours stand for them: the sample is divided into about kEtaRows cells,
/// each weighs what its pixels are of the picture's, and shares that among the material's usable pixels in it
/// (a cell with less than 5 % of them weighs less). Neither resolution, nor the quadtree, nor a material that
/// is scattered over the sample changes how a picture counts.
///
/// `materialOf`: for each picture the material of every pixel, -1 where it is not to be used; empty: all
/// pixels are of material 0. Folds: whole pictures where there are three or more, else six sectors of each.
Observations observe(const std::vector<ReflectancePicture>& pictures,
                     const std::vector<std::vector<std::int8_t>>& materialOf, int material,
                     int rowsPerPicture);

}  // namespace patina
