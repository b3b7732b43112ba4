#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "engine/brdf/half_diff.h"

namespace patina {

/// Where a BRDF comes from, for people and for provenance.
struct BrdfOrigin {
  std::string name;    ///< of the material
  std::string format;  ///< "merl", "rgl", "alta", "neural", or the analytic model's id
  std::string file;    ///< "" where it was not read from one
  std::string note;    ///< licence, header lines, what a reader changed; may be empty
};

/// A reflectance of three channels. Immutable, may be shared between threads.
class Brdf {
 public:
  virtual ~Brdf() = default;

  /// BRDF in 1/sr, R G B, without the cosine. Unit directions in the sample's frame, z the normal, x the
  /// reference direction of an anisotropic surface. NaN in all channels where nothing is known: a direction
  /// below the surface, a cell that was not measured. Never negative, never infinite.
  virtual Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const = 0;

  /// Whether turning the sample about its normal changes nothing.
  virtual bool isotropic() const { return true; }

  /// The same for many pairs at phiH = 0; `out` has as many entries as `angles`. The default calls
  /// `evaluate`; models that can do better override it. Threading: one call uses one thread.
  virtual void evaluateMany(std::span<const HalfDiffAngles> angles, std::span<Eigen::Array3f> out) const;

  const BrdfOrigin& origin() const { return origin_; }

 protected:
  explicit Brdf(BrdfOrigin origin) : origin_(std::move(origin)) {}

 private:
  BrdfOrigin origin_;
};

using BrdfPtr = std::shared_ptr<const Brdf>;

}  // namespace patina
