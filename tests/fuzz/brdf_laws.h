#pragma once

#include <cmath>
#include <cstdlib>

#include "engine/base/result.h"
#include "engine/brdf/brdf.h"

namespace patina::fuzz {

/// What holds for every BRDF that a reader let in, whatever the file: NaN in all channels or a finite value
/// that isn't negative. And every refusal has a sentence.
inline void checkBrdf(const Result<BrdfPtr>& brdf) {
  if (!brdf) {
    if (brdf.error().what.empty() || brdf.error().tryThis.empty()) std::abort();
    return;
  }
  for (const double light : {0.0, 0.3, 0.9, 1.5, 1.5707}) {
    for (const double view : {0.0, 0.26, 1.2, 1.5707}) {
      for (const double phi : {-3.1, -1.0, 0.0, 2.0}) {
        const Eigen::Vector3d toLight(std::sin(light), 0, std::cos(light));
        const Eigen::Vector3d toView(std::sin(view) * std::cos(phi), std::sin(view) * std::sin(phi),
                                     std::cos(view));
        const Eigen::Array3d value = (*brdf)->evaluate(toLight, toView);
        const bool known = value.allFinite() && (value >= 0).all();
        if (!known && !value.isNaN().all()) std::abort();
      }
    }
  }
}

}  // namespace patina::fuzz
