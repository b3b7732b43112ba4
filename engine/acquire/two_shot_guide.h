#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/acquire/two_shot_session.h"
#include "engine/twoshot/metric.h"

namespace patina {

/// The arithmetic behind the guided two-shot capture: directions, and what they are expected to do.
/// Immutable; any number of threads.
class TwoShotGuide {
 public:
  explicit TwoShotGuide(const TwoShotSetup& setup);

  /// What one shot's place is at the moment: where it was decided, else as planned.
  struct Placed {
    std::optional<Camera> camera;
    std::optional<Eigen::Vector3d> toLight;
  };
  CameraGuide camera(std::size_t shot, const std::vector<Placed>& placed, const Camera& now) const;
  LightGuide light(std::size_t shot, const std::vector<Placed>& placed, const Eigen::Vector3d& toLight) const;
  /// Whether all of the sample is in the camera's picture, and in front of it.
  bool sampleInPicture(const Camera& camera) const;

 private:
  /// Training error with these places; negative without a basis.
  double error(const std::vector<Placed>& placed) const;
  RowFactor rows(const Camera& camera, const Eigen::Vector3d& toLight) const;

  TwoShotSetup setup_;
  std::optional<ErrorMetric> metric_;
  std::vector<RowFactor> planned_;  ///< of each shot as planned
  double plannedError_ = -1;
};

/// A pinhole camera at `toCamera * distanceMm` that looks at the sample's centre, wide enough for any sample.
Camera lookingAtCentre(const Eigen::Vector3d& toCamera, double distanceMm);

}  // namespace patina
