#pragma once

#include <Eigen/Core>
#include <vector>

#include "devices/simulated/simulated_effects.h"
#include "devices/simulated/simulated_sheet.h"
#include "engine/screen/screen.h"

namespace patina {

/// A point of the sheet seen from the screen: everything in pattern units, screen frame (x right, y up, z the
/// emitting side).
struct PointFrame {
  Eigen::Vector3d point, view, normal;
  Eigen::Vector3d tangent, bitangent;  ///< tangent: where an anisotropic lobe's sigma along is measured
  Eigen::Vector3d east, north, up;     ///< the sample's x, y, z
  double distance = 0;
};
PointFrame pointFrame(const Screen& screen, const SimulatedEffects& effects, const Eigen::Vector3d& pointMm,
                      const Eigen::Vector3d& toView, const Eigen::Vector3d& normal);

/// One term of a surface's reflectance.
struct SurfacePart {
  enum class Kind { Nothing, Lambert, Gaussian, Sheen, Grazing, Retro };
  Kind kind = Kind::Nothing;
  double weight = 1;
  double sigmaAlong = 0,
         sigmaAcross = 0;              ///< Gaussian: slope's standard deviations along tangent and bitangent
  double f0 = 0.06, fresnelPower = 5;  ///< Gaussian: Schlick's, over its value at normal incidence
  double width = 0;                    ///< Sheen: spread; Retro: radians
  double coat = 0;                     ///< weight of the coat that lies over it
};

/// The terms of a material with the effects that act on it.
struct SurfaceParts {
  SurfacePart lambert;                ///< times diffuse albedo
  std::vector<SurfacePart> specular;  ///< times specular albedo; the standard model has two Gaussians
  std::vector<SurfacePart> white;     ///< times nothing: coat, sheen, retroreflection
};
/// Source of the two Gaussians: frequency-domain paper, App. C. GGX is a continuous mixture of Gaussians (a
/// bivariate Student's t of two degrees of freedom): twelve of them, 0.8 apart in the logarithm of the
/// precision, give its density within 1e-3 of the peak out to twenty standard deviations.
SurfaceParts surfaceParts(const SheetPoint& material, const SimulatedEffects& effects);

/// What multiplies the pattern along one row of nodes, for one point and one term: reflectance, cosines,
/// inverse square distance, emission by angle, the sample's horizon. Per pattern unit squared.
class LightKernel {
 public:
  /// Nodes x0 to x1, `spacing` apart. `lobeReach`: a Gaussian is cut off after so many standard deviations.
  LightKernel(const Screen& screen, const SimulatedEffects& effects, double lobeReach,
              const PointFrame& frame, const SurfacePart& part, int x0, int x1, double spacing);

  /// Writes the kernel at nodes x0 + first to x0 + last - 1 of row `ky` to `to`; the rest is zero.
  void evaluate(int ky, Eigen::ArrayXf& kernel, int& first, int& last);

 private:
  void gaussian(float ly, Eigen::ArrayXf& kernel, int& first, int& last);
  void emissionByAngle(float ly, int first, int last, Eigen::ArrayXf& kernel) const;
  void horizon(float ly, int first, int last, Eigen::ArrayXf& kernel) const;

  const Screen& screen_;
  const SimulatedEffects& effects_;
  double lobeReach_;
  const PointFrame& frame_;
  const SurfacePart& part_;
  double spacing_;
  bool ownEmission_, hasHorizon_;
  Eigen::ArrayXf lx_, emission_, invD_, nl_, a_, b_, c_;
};

}  // namespace patina
