#pragma once

#include <Eigen/Core>

#include "engine/fourier/point_model.h"
#include "engine/fourier/site_geometry.h"

namespace patina::test {

/// A 345 x 194 mm panel leaning over the sample as in the paper's Fig. 1, and a camera opposite; made up for
/// these tests.
struct Rig {
  Screen screen;
  Eigen::Vector3d cameraMm{10, -300, 310};
  ScreenFrame frame;

  Rig() {
    screen.widthMm = 345;
    screen.heightMm = 345 * 9.0 / 16.0;
    screen.widthPx = 1920;
    screen.heightPx = 1080;
    const double tilt = 48 * std::numbers::pi / 180;
    screen.worldFromScreen << 1, 0, 0, 0, -std::cos(tilt), -std::sin(tilt), 0, std::sin(tilt),
        -std::cos(tilt);
    screen.originMm = {5, 185, 170};
    screen.emission = ScreenEmission{{0.05, -0.1}, {1.6, 1.3}, 0.9};
    frame = ScreenFrame(screen);
  }
  SiteGeometry site(double xMm, double yMm) const { return siteGeometry(frame, {xMm, yMm, 0}, cameraMm); }
};

}  // namespace patina::test
