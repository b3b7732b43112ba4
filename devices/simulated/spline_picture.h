#pragma once

#include <vector>

#include "engine/image/image.h"
#include "engine/screen/screen.h"

namespace patina {

/// A picture on a screen as sums against the cubic splines of every level: the light that a point of the
/// sample gets from it is then the sum of its kernel's values at the nodes times these (the same mathematics
/// as ScreenIntegrator's, for a picture that is whatever was drawn rather than a pattern known beforehand).
/// Each pixel emits evenly over its area, taken as at its centre: exact to the square of a pixel over the
/// spacing.
class SplinePicture {
 public:
  /// `light`: one channel, linear, a value a pixel, row 0 at the top. Levels 0 to `finest`.
  SplinePicture(const Screen& screen, const Image& light, int finest);

  /// Sum of `values` (row-major, `width` a row, from node (x0, y0) of `level`) times the picture.
  float dot(int level, int x0, int y0, int width, int height, const float* values) const;

 private:
  struct Level {
    double spacing = 0;
    int reachX = 0, reachY = 0;
    std::vector<float> sums;
    std::size_t nodesX() const { return static_cast<std::size_t>(2 * reachX + 1); }
    std::size_t nodesY() const { return static_cast<std::size_t>(2 * reachY + 1); }
    std::size_t index(int kx, int ky) const {
      return static_cast<std::size_t>(ky + reachY) * nodesX() + static_cast<std::size_t>(kx + reachX);
    }
  };
  std::vector<Level> levels_;
};

}  // namespace patina
