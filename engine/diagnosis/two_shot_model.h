#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/diagnosis/two_shot_data.h"
#include "engine/twoshot/basis.h"

namespace patina {

/// Rows mapped to logarithms under an assumed deviation of the set-up, ready for the linear model, in the
/// channels' combinations (`channelCombinations`).
struct MappedRows {
  Eigen::MatrixXd value;       ///< n x 3, basis' mean taken off
  Eigen::MatrixXd noise;       ///< n x 3, variance by the sensor
  Eigen::MatrixXd lobe;        ///< n x 3, what an added lobe's relative error does to `value`; empty: no lobe
  Eigen::MatrixXd place;       ///< n x 3, coordinates in which deviations are smooth
  Eigen::MatrixXd brightness;  ///< n x (materials), square root of the basis' covariance of brightness
  Eigen::MatrixXd colour;      ///< n x (2 materials), of colour
  Eigen::MatrixXd unlike;      ///< n x 2, how much more than elsewhere materials deviate from the basis here
  double lnJacobian = 0;       ///< of the mapping, so that likelihoods of different deviations compare
  std::vector<HalfDiffAngles> angles;
  bool anglesTakenOver = false;    ///< from `like`: nothing moved
  Eigen::VectorXd weight, offset;  ///< n: the mapping's weight; lnReference + mean
  Eigen::Index size() const { return value.rows(); }
};

/// A model that was conditioned on rows: their covariance factored.
struct ConditionedRows {
  Eigen::MatrixXd factorBrightness, factorColour;  ///< lower triangles
  Eigen::MatrixXd solved;                          ///< n x 3, covariance^-1 value
  double lnLikelihood = 0;
  bool ok = false;
};

/// What the diagnosis takes for the probability of photographs: mapped values are a Gaussian process whose
/// covariance is that of the basis' own materials, plus continuous deviations of materials from the basis,
/// plus noise. Where deviations are large is what the basis' own materials do when each is predicted by the
/// others from all directions (largest on highlights and towards grazing); how large they are for this sample
/// is found from the photographs themselves. They are rough on every scale (a Matern process of order 3/2
/// with a broad reach, one of order 1/2 with a fine one): a process of smooth functions would be sure of what
/// lies between and beside its rows, and call every steep flank a discovery. Effects of the set-up act on
/// where the process is looked up and on the values. This is the paper's ridge (its eta being white
/// deviations of 0.36) with the deviations' reach taken into account, without which thousands of neighbouring
/// rows would count as independent.
class TwoShotModel {
 public:
  explicit TwoShotModel(BasisPtr basis);

  /// Rows that lie so far from the basis' border that small deviations don't take them across.
  std::vector<DiagnosisRow> usable(const std::vector<DiagnosisRow>& rows) const;
  /// `like`: rows mapped before; their products with the basis are taken over where no angle has changed.
  MappedRows map(const std::vector<DiagnosisRow>& rows, const TwoShotDeviation& deviation,
                 const MappedRows* like = nullptr) const;
  ConditionedRows condition(const MappedRows& rows, const BasisDeviation& basis) const;
  /// The material's part of `there`, given what was seen at `seen`: n x 3 like MappedRows::value.
  Eigen::MatrixXd predict(const MappedRows& seen, const ConditionedRows& conditioned, const MappedRows& there,
                          const BasisDeviation& basis) const;
  /// Covariance of what `predict` says of the brightness, noise included: n x n.
  Eigen::MatrixXd predictedCovariance(const MappedRows& seen, const ConditionedRows& conditioned,
                                      const MappedRows& there, const BasisDeviation& basis) const;
  /// How far from the basis the material is, by the largest posterior probability; `start` is where the
  /// search begins, `firstStep` (of logarithms) how far it looks at first. Cost: some 30 factorisations.
  BasisDeviation fitDeviation(const MappedRows& rows, const BasisDeviation& start, const JobContext& job,
                              double firstStep = 1.2) const;
  /// ln of the prior density that `fitDeviation` maximises beside the likelihood.
  static double lnPrior(const BasisDeviation& basis);

  /// The smooth deviation from the basis that the photographs let expect; null where it can't be found.
  std::shared_ptr<const SmoothCorrection> correction(const MappedRows& seen,
                                                     const BasisDeviation& basis) const;

  const Basis& basis() const { return *basis_; }

 private:
  BasisPtr basis_;
  Eigen::MatrixXd brightness_, colour_;  ///< k x materials, k x 2 materials
  /// The same shapes: what the other materials miss of each, all directions known; in units of its RMS over
  /// the grid.
  Eigen::MatrixXd missedBrightness_, missedColour_;
};

}  // namespace patina
