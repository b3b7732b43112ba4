#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "engine/diagnosis/two_shot_candidates.h"
#include "engine/diagnosis/two_shot_model.h"

namespace patina {

/// What became of one way of explaining the photographs.
struct TrialOutcome {
  bool tried = false;
  double score = 0;       ///< chi-squared of the score test at "none of it"; 0 where there is no such test
  double lnEvidence = 0;  ///< ln of the ratio of the fitted photographs' probabilities with and without it
  double lnHeld = 0;      ///< the same of the held-out ones, given the fitted ones
  double lnAround = 0;    ///< the part of lnEvidence that the sample's surroundings have in it
  double reach = 0;       ///< RMS of what it changes in the fitted rows, natural-log units
  Eigen::VectorXd value, sd;
  TwoShotDeviation deviation;
  BasisDeviation basis;
  double lnTotal() const { return lnEvidence + lnHeld; }
};

/// The state of a search: what has been added, and how probable it makes the photographs.
class TwoShotSearch {
 public:
  TwoShotSearch(const TwoShotModel& model, const DiagnosisData& data, const JobContext& job);

  /// Takes a deviation for granted from now on.
  void accept(const TwoShotDeviation& deviation, const BasisDeviation* start = nullptr);
  /// Fits a candidate beside what was accepted, the material as far from the basis as it seemed without it:
  /// quick. Threading: any number of calls at a time.
  TrialOutcome look(const TwoShotCandidate& candidate) const;
  /// Goes on from what `look` found, the material's distance fitted too.
  TrialOutcome refine(const TwoShotCandidate& candidate, const TrialOutcome& from) const;

  /// Factors of held-out photographs, each from that photograph and what the fitted ones let expect of it; 0
  /// where there is nothing to say. At most a third of all photographs may have one: what most of them share
  /// is the material's.
  TrialOutcome heldFactors(const TwoShotCandidate& candidate) const;

  const TwoShotDeviation& accepted() const { return deviation_; }
  const BasisDeviation& basis() const { return basis_; }
  const std::vector<DiagnosisRow>& fitted() const { return fitted_; }
  const std::vector<DiagnosisRow>& held() const { return held_; }
  const MappedRows& mapped() const { return mapped_; }
  const ConditionedRows& conditioned() const { return conditioned_; }
  bool hasHeld() const { return !held_.empty(); }
  /// The score test at "none of it", and what the photographs could not see.
  struct Score {
    double chiSquared = 0, correctedP = 1;  ///< for so many degrees of freedom as parameters; of one test
    Eigen::VectorXd sd;                     ///< of each parameter, as these photographs know it
    Eigen::VectorXd absorbed;  ///< RMS over the fitted rows of what the material would take on, a unit of it
  };
  Score score(const TwoShotCandidate& candidate) const;
  /// Mapped values less the model's own prediction: what is left, n x 3.
  Eigen::MatrixXd residual() const;

 private:
  std::vector<Eigen::MatrixXd> derivatives(const TwoShotCandidate& candidate,
                                           const Eigen::VectorXd& at) const;
  double aroundLn(const TwoShotDeviation& deviation, Eigen::VectorXd* residuals) const;
  double heldLn(const TwoShotDeviation& deviation, const BasisDeviation& basis, double fittedLn) const;
  TrialOutcome from(const TwoShotCandidate& candidate, const Eigen::VectorXd& start, BasisDeviation basis,
                    int rounds) const;

  const TwoShotModel& model_;
  const DiagnosisData& data_;
  const JobContext& job_;
  std::vector<DiagnosisRow> fitted_, held_, all_;
  TwoShotDeviation deviation_;
  BasisDeviation basis_;
  MappedRows mapped_;
  ConditionedRows conditioned_;
  double lnHere_ = 0, lnHeld_ = 0, lnAround_ = 0;
};

/// Probability that a chi-squared variable exceeds `value`.
double chiSquaredTail(double value, int degrees);

}  // namespace patina
