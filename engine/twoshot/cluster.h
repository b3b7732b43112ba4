#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/geometry/camera.h"
#include "engine/twoshot/reflectance_picture.h"

namespace patina {

/// The most materials that are told apart on one sample.
inline constexpr int kMostMaterials = 8;

/// Which material is where, seen by one camera; other cameras look it up through the sample's plane.
struct MaterialMap {
  int count = 1;
  std::size_t picture = 0;           ///< the diffuse picture that it was made from
  Camera camera;                     ///< of that picture
  std::vector<std::int8_t> label;    ///< of its pixels, -1 off the sample; empty for one material
  std::vector<std::int8_t> certain;  ///< the same, -1 also beside another material
  double separation = 0;  ///< of the two most alike: distance of their centres in standard deviations

  /// Labels of another camera's pixels. `certain`: -1 next to a border between materials.
  std::vector<std::int8_t> labelsFor(const SampleView& view, bool certainOnly) const;
};

/// Divides the sample's pixels by colour. Source: two-shot paper, section 8 (clusters of the colour in the
/// diffuse picture); the rest is ours:
///
/// - The picture: of those fitted, the one whose pixels are on the mean farthest from the mirror direction.
/// - Features: natural logarithms of R, G, B (means over 3 x 3 pixels where they are noisy), minus a
/// quadratic surface over the sample
///   that all materials share (what light and view do to a diffuse material), found in turn with the labels.
/// - Centres from the 60 % of the pixels that differ least from their neighbours: others mix two materials.
/// - k-means from the best of five seeded starts, deterministic.
/// - `count` 0: the largest number up to kMostMaterials for which any two centres are at least 3.5 robust
/// standard
///   deviations apart (measured within the two clusters along the line between them) and 5 % in value, each
///   material has 1 % of the sample, and colours step at the borders: pixels three apart on either side
///   differ by half of the centres' distance or more. k-means cuts one Gaussian cloud, grain or noise, at 2.7
///   standard deviations, and a gradient of one material has no steps, so a homogeneous sample stays one.
///
/// Never fails; fewer materials than asked for where there are fewer colours.
MaterialMap clusterMaterials(const TwoShotCapture& capture, const std::vector<ReflectancePicture>& pictures,
                             int count, const JobContext& job);

}  // namespace patina
