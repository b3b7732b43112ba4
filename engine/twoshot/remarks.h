#pragma once

#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/twoshot/basis.h"
#include "engine/twoshot/fit.h"
#include "engine/twoshot/near_field.h"
#include "engine/twoshot/posterior.h"

namespace patina {

/// An error in natural-log units as a person says it: "about 22 %" for 0.2; "a factor of 2.7" for 1.
std::string logErrorInWords(double natural);

/// What one more photograph would do for materials like the one that was found.
struct NextShot {
  bool useful = false;  ///< lowers the expected error by 15 % or more, from 0.15 or more
  ShotDirections directions;
  double before = 0, after = 0;  ///< RMS, natural-log units, over the trusted region
  std::vector<int> neighbours;   ///< materials of the basis most like the sample, nearest first
};

/// Tries some directions that are known to complement each other (two-shot plans over what can be trusted) as
/// one more photograph beside `rows`. Judged by the ten materials of the basis nearest to the coefficients,
/// each left out and reconstructed. `disc`: what a picture of the sample sees. Cost: some 0.1 s.
NextShot suggestNextShot(const Basis& basis, const Eigen::MatrixXd& coefficients, const RowFactor& rows,
                         double rowWeight, double eta, const NearFieldDisc& disc, const JobContext& job);

/// Sentences on one material: expected error, its residual, what is measured and what is extrapolated. `name`
/// begins them where there are several ("Material 2: "), else empty.
std::vector<std::string> remarksOn(const TwoShotMaterial& material, const Basis& basis,
                                   const Posterior& posterior, const std::vector<HalfDiffAngles>& rowAngles,
                                   const std::vector<double>& rowWeight, double residual,
                                   const NextShot& next, const std::string& name);

}  // namespace patina
