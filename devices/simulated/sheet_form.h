#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "devices/simulated/simulated_effects.h"
#include "devices/simulated/simulated_sheet.h"
#include "engine/geometry/camera.h"
#include "engine/screen/screen.h"

namespace patina {

/// Where the sheet's surface truly is: bent, wavy, tilted or lifted over the plane z = 0 by the effects
/// sample-height and sample-tilt. A point keeps its x and y: what bending shortens is below a thousandth.
/// Immutable; may be used from several threads.
class SheetForm {
 public:
  SheetForm(const SimulatedEffects& effects, const SimulatedSheet& sheet);
  bool flat() const { return flat_; }
  double heightMm(double xMm, double yMm) const;
  Eigen::Vector2d gradient(double xMm, double yMm) const;
  /// The point of the surface that a place of the picture shows, mm; empty where its ray doesn't meet it.
  std::optional<Eigen::Vector3d> seenAt(const Camera& camera, const Eigen::Vector2d& pixel) const;
  /// A normal of the flat sheet (unit), turned with the surface there.
  Eigen::Vector3d turned(const Eigen::Vector3d& normal, double xMm, double yMm) const;

 private:
  struct Wave {
    Eigen::Vector2d perMm;
    double phase, amplitudeMm;
  };
  bool flat_ = true;
  double liftMm_ = 0, curvaturePerMm_ = 0;
  Eigen::Vector2d slope_ = Eigen::Vector2d::Zero(), bendAlong_ = Eigen::Vector2d::UnitX();
  std::vector<Wave> waves_;
};

/// The screen where it truly stands, turned about its centre and shifted along its declared axes.
Screen trueScreen(const Screen& declared, const SimulatedEffects& effects);

}  // namespace patina
