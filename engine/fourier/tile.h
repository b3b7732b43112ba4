#pragma once

#include <cstdint>
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
/// gain up to a factor of three.
class Tile {
 public:
  Tile(const FourierFitState& state, std::span<const std::uint32_t> sites, bool poolNeighbours);

  std::vector<SiteData> data;

 private:
  std::vector<float> diffuse_, z_, dc_;
};

}  // namespace patina
