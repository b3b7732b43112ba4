#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/brdf/half_diff.h"

namespace patina {

/// How far a material may be from the basis, natural-log units (standard deviations): what is left in single
/// rows (texture, the grid's interpolation), and smooth deviations of two widths. One set for brightness, one
/// for colour.
struct BasisDeviation {
  struct Part {
    double grain = 0.01, fine = 0.02, broad = 0.05;
  };
  Part brightness{}, colour{};
};

/// The coordinates in which deviations of a material from the basis are smooth: thetaH as MERL's cells
/// resolve it, thetaD, and phiD where it matters, in units of the broad deviations' reach.
Eigen::RowVector3d smoothPlace(const HalfDiffAngles& angles);

/// Covariance of the smooth deviations between two sets of places (n x 3 each), for both widths. Cost: an
/// exponential or two for each pair that is near enough. Threading: uses all.
Eigen::MatrixXd smoothCovariance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b,
                                 const BasisDeviation::Part& part);

/// Three combinations of the channels: their mean (times sqrt 3) and two differences. A material's channels
/// deviate from the basis together: counting them as three witnesses would call chance a discovery. Rows are
/// the combinations; orthonormal.
const Eigen::Matrix3d& channelCombinations();

/// A free-form correction of a BRDF: the natural logarithm of a factor for each channel, smooth over
/// half-angle coordinates, and none (0) far from where it was learnt. Tabulated over its places, so that a
/// look-up is cheap.
class SmoothCorrection {
 public:
  /// The process' answer to what was seen: `place` n x 3, `weight` n x 3 (covariance^-1 of the values, in
  /// the combinations of the channels).
  SmoothCorrection(const Eigen::MatrixXd& place, const Eigen::MatrixXd& weight, const BasisDeviation& basis);
  /// ln of the factor, R G B.
  Eigen::Array3d lnFactor(const HalfDiffAngles& angles) const;

 private:
  std::vector<Eigen::Array3f> table_;
};

}  // namespace patina
