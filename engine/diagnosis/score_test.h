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

/// Moves the sites' own parameters towards their optimum under the model: `steps` Gauss-Newton steps,
/// parallel.
/// `mayDrop`: sites whose lobe is found to leave the screen become unusable.
void refineSites(DiagnosisCapture& capture, const FourierDiagnosisModel& model, int steps,
                 const JobContext& job, bool mayDrop = true);
/// Moves a site's own parameters by a step, each as far as makes sense at once.
void stepSite(DiagnosisSite& site, const Eigen::VectorXd& delta);

/// Sites whose residual is beyond three times the median's get less weight, so that a few that are far from
/// any linear regime don't decide for all. To be called between rounds, never between things that are
/// compared.
void setRobustWeights(DiagnosisCapture& capture, const FourierDiagnosisModel& model, const JobContext& job);

/// Lowers the assumed noise where it can't be so large: the difference of neighbouring sites' residuals in
/// one photograph holds noise, and hardly anything of an effect that acts on whole photographs (whose scatter
/// is taken for noise when it is estimated from the photographs). One factor for all weights. Returns the
/// ratio of true to assumed variance, at most 1.
double correctNoise(DiagnosisCapture& capture, const FourierDiagnosisModel& model, const JobContext& job);

/// What a state leaves: mean squares in units of noise, and relative RMS over the tested sites.
struct ModelError {
  double chi2 = 0, count = 0, heldChi2 = 0, heldCount = 0;
  double rms = 0, heldRms = 0, floor = 0, heldFloor = 0;
  std::vector<double> heldPatch;  ///< held-out chi2 by groups of neighbouring sites, for its own uncertainty
  std::vector<double> rowChi2, rowCount, rowNoise;  ///< by row; noise: relative to the photograph's signal
};
ModelError modelError(const DiagnosisCapture& capture, const FourierDiagnosisModel& model,
                      const JobContext& job);

}  // namespace patina
