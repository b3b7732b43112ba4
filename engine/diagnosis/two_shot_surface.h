#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/diagnosis/two_shot_candidates.h"
#include "engine/twoshot/basis.h"

namespace patina {

/// How well the reconstruction itself, the ridge of `fitTwoShot` on the diagnosis' rows, reproduces
/// photographs with a term of the surface. A material term is judged by this and not by the Gaussian process:
/// smooth deviations from the basis, which the process allows for, imitate any lobe, and the question is
/// whether the reconstruction that a person gets becomes better by it.
class SurfaceTrial {
 public:
  /// `fitted` and `held`: rows that the basis covers; `deviation`: what is taken for granted.
  SurfaceTrial(const Basis& basis, const std::vector<DiagnosisRow>& fitted,
               const std::vector<DiagnosisRow>& held, const TwoShotDeviation& deviation);

  struct Errors {
    double fit = -1, held = -1;  ///< relative RMS of the rows, as of photographs; -1: no such rows
    std::vector<double> shot;    ///< of each shot; -1: not among the rows
  };
  Errors errors(const TwoShotDeviation& deviation) const;

  /// Whether a dozen held-out rows look where what a deviation adds is a tenth or more of the most that
  /// fitted rows see of it.
  bool heldSees(const TwoShotDeviation& deviation) const;

  struct Found {
    Eigen::VectorXd value;
    TwoShotDeviation deviation;
    Errors errors;
  };
  /// The parameters with the smallest error of the fitted rows, prior included, by the downhill simplex from
  /// the best of the candidate's starts. Cost: some hundred solves of the rows' size.
  Found search(const TwoShotCandidate& candidate, const JobContext& job) const;

 private:
  const Basis& basis_;
  const std::vector<DiagnosisRow>&fitted_, &held_;
  TwoShotDeviation deviation_;
  BasisRows rows_;        ///< fitted rows, then held ones
  Eigen::MatrixXd gram_;  ///< of all rows with the fitted ones
};

}  // namespace patina
