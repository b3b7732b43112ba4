#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/job.h"
#include "engine/diagnosis/fourier_columns.h"

namespace patina {

/// Normal equations of all effects' strengths, every site's own parameters eliminated: what the photographs
/// of one capture say about every effect at once, to first order. Rows and columns: EffectColumns' dense
/// ones, then a factor, then an offset for each fitted photograph.
struct ScoreSums {
  Eigen::MatrixXd a;  ///< curvature: sum over sites of T' P T, T in units of noise
  Eigen::VectorXd b;  ///< sum of T' P (photograph - prediction)
  Eigen::MatrixXd
      held;  ///< the same of the held-out photographs, dense columns only, sites solved on the fitted ones
  Eigen::VectorXd heldB;
  double chi2 = 0,
         heldChi2 = 0;  ///< residuals' sums of squares after the sites' own parameters were refitted
  double count = 0, heldCount = 0;  ///< measurements minus parameters; measurements
  ScoreSums& operator+=(const ScoreSums& other);
};

/// How an effect, or several together, would do.
struct ScoreResult {
  Eigen::VectorXd estimate, sd;  ///< of every number, in the order of `ScoreTest::numbers`
  double gain = 0;               ///< fall of chi2
  double heldGain =
      0;              ///< fall of the held-out chi2 with these numbers; 0 for flicker and ambient-drift alone
  double heldSd = 0;  ///< of heldGain, from noise
  int numbers = 0;
  double logEvidence = 0;  ///< log Bayes factor against none of it, with the columns' priors
};

/// The score test over one or several captures.
class ScoreTest {
 public:
  /// Evaluates all columns at all sites (twice the sites' own parameters are refined first where `refine`),
  /// parallel. The sites' parameters in `capture` are updated.
  void add(DiagnosisCapture& capture, const FourierDiagnosisModel& model, const EffectColumns& columns,
           const JobContext& job, const WantedColumns& wanted = {}, int materialOffset = 0);

  /// Solves for the numbers of `effects` jointly, given that those of `given` are free too; gain is over
  /// `given` alone.
  ScoreResult solve(const std::vector<std::string>& effects,
                    const std::vector<std::string>& given = {}) const;
  /// Correlation of two effects' explained signal after all else is projected out: largest canonical
  /// correlation.
  double correlation(std::string_view a, std::string_view b) const;

  const std::vector<ScoreSums>& perMaterial() const { return perMaterial_; }
  ScoreSums total() const;
  double chi2PerCount() const;
  const EffectColumns& columns() const { return *columns_; }
  /// For each number of a joint solve: column, material (-1: all).
  struct Number {
    int column;
    int material;
    double prior;
  };
  /// First-order move of a site's own parameters (kOwnCount) that makes room for a step of the numbers. Site
  /// in the order in which they were added; empty where it was left out.
  Eigen::VectorXd ownStep(std::size_t site, const std::vector<Number>& numbers,
                          const Eigen::VectorXd& estimate) const;
  std::vector<Number> numbers(const std::vector<std::string>& effects) const;
  int fittedRows() const { return fittedRows_; }
  /// Median over sites of how far one prior-sized step of a column moves a site's own parameters: for the
  /// budget.
  const Eigen::MatrixXd& shifts() const { return shifts_; }  ///< kOwnCount x dense

 private:
  void assemble(const std::vector<Number>& numbers, Eigen::MatrixXd& a, Eigen::VectorXd& b) const;

  const EffectColumns* columns_ = nullptr;
  int fittedRows_ = 0;
  std::vector<ScoreSums> perMaterial_;
  Eigen::MatrixXd shifts_;
  struct OwnMove {
    int material = -1;
    Eigen::MatrixXf absorbed;  ///< kOwnCount x columns, sparse ones too
  };
  std::vector<OwnMove> moves_;
};

}  // namespace patina
