#include <algorithm>
#include <cmath>

#include "devices/simulated/screen_integrator.h"
#include "devices/simulated/spline_levels.h"

namespace patina {

ScreenIntegrator::NodeKernel ScreenIntegrator::kernelOf(const Query& query, const SurfacePart& part) const {
  const PointFrame frame = pointFrame(screen_, effects_, query.pointMm, query.toView, query.material.normal);
  NodeKernel kernel;
  if (frame.normal.dot(frame.view) <= 0 || frame.distance <= 0) return kernel;
  const Patch patch = patchOf(frame, part);
  kernel.level = patch.level;
  kernel.resolved = patch.resolved;
  if (patch.x1 < patch.x0 || patch.y1 < patch.y0) return kernel;
  kernel.x0 = patch.x0;
  kernel.y0 = patch.y0;
  kernel.width = patch.x1 - patch.x0 + 1;
  kernel.height = patch.y1 - patch.y0 + 1;
  kernel.values.assign(static_cast<std::size_t>(kernel.width) * static_cast<std::size_t>(kernel.height),
                       0.0f);
  LightKernel rows(screen_, effects_, quality_.lobeReach, frame, part, patch.x0, patch.x1,
                   spacingOf(patch.level));
  Eigen::ArrayXf row;
  for (int ky = patch.y0; ky <= patch.y1; ++ky) {
    int first = 0, last = 0;
    rows.evaluate(ky, row, first, last);
    float* to = kernel.values.data() +
                static_cast<std::size_t>(ky - patch.y0) * static_cast<std::size_t>(kernel.width);
    for (int i = first; i < last; ++i) to[i] = row[i];
  }
  return kernel;
}

ScreenIntegrator::NodeKernel ScreenIntegrator::nodesFor(const Query& query, double smoothRad) const {
  const PointFrame frame = pointFrame(screen_, effects_, query.pointMm, query.toView, query.material.normal);
  NodeKernel kernel;
  if (frame.normal.dot(frame.view) <= 0 || frame.distance <= 0) return kernel;
  const Eigen::Vector2d half = screen_.halfExtent();
  double steepest = 0;
  for (int i = 0; i <= 4; ++i)
    for (int j = 0; j <= 4; ++j)
      steepest =
          std::max(steepest, slopePerUnit(frame, {half.x() * (i / 2.0 - 1), half.y() * (j / 2.0 - 1)}));
  double scale = std::abs(frame.distance) / nodesPerDistance(1) * quality_.nodesPerSigma;
  if (steepest > 0) scale = std::min(scale, smoothRad / steepest);
  const Patch patch = wholeScreen(scale, quality_.nodesPerSigma);
  kernel.level = patch.level;
  kernel.resolved = patch.resolved;
  kernel.x0 = patch.x0;
  kernel.y0 = patch.y0;
  kernel.width = patch.x1 - patch.x0 + 1;
  kernel.height = patch.y1 - patch.y0 + 1;
  return kernel;
}

}  // namespace patina
