#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "engine/fourier/fit_state.h"
#include "engine/fourier/solver.h"

namespace patina {

/// The solver's input for a run of sites; owns the arrays that it points to.
///
/// With `poolNeighbours`, a site's measurements are averaged with those of the eight pixels around it as far
/// as noise can't tell them apart: with N measurements and squared distance q in units of the difference's
/// variance, q is N +- sqrt(2 N) for equal material, normal and place. What exceeds that spread is a real
/// difference; it lies in the ten directions of the texel's parameters, so a neighbour's weight is 1 / (1 + 2
/// (q - N - sqrt(2 N)) / 10): one over its variance, bias included, for any of them. Glossy or textured
/// surfaces keep their pixels to themselves; broad lobes, where one pixel's noise is larger than any detail,
/// gain up to a factor of three. Components that a saturated photograph spoilt, at the site or at a
/// neighbour, are left out of the comparison and of the mean.
class Tile {
 public:
  Tile(const FourierFitState& state, std::span<const std::uint32_t> sites, bool poolNeighbours);

  std::vector<SiteData> data;  ///< pooled
  std::vector<SiteData> own;   ///< each site's own measurements: for albedos, which vary from pixel to pixel

 private:
  /// A site's input, its arrays at the given places.
  SiteData describe(const FourierFitState& state, const DiffuseTransform& transform, std::size_t site,
                    const Eigen::Vector2d& point, double varianceShare, const float* z, const float* dc,
                    float* diffuse) const;

  // Filled where they are used; zeroing megabytes beforehand would take as long as some of the steps.
  std::unique_ptr<float[]> diffuse_, ownDiffuse_, z_, ownZ_;
  std::vector<float> dc_;
  std::vector<std::vector<std::uint16_t>> pooledDropped_;
};

}  // namespace patina
