#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/fourier/levels_data.h"

namespace patina {

/// One regularised level as a least-squares problem: the sum of squares of
///  - each texel's measurements against the model (195 for 32 frequencies) and its ten point-wise priors,
///  - differences of log sigma, log(gamma - 1) and albedos between neighbouring texels,
///  - the curl of the slopes.
/// Source: frequency-domain paper, section 7.1 and App. E. Texels that no photograph sees are left out, and
/// so is what couples them.
class LevelProblem {
 public:
  /// Unknowns of a texel, in this order: log sigma, log(gamma - 1), slope x, slope y, diffuse and specular
  /// albedo R G B.
  static constexpr int kUnknowns = 10;
  using Vector = Eigen::Matrix<double, kUnknowns, 1>;
  using Block = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  /// Weights of the differences from a texel to its neighbour; zero where there is none.
  struct Edge {
    int neighbour = -1;  ///< into `texels()`
    float weight[kUnknowns] = {};
  };
  /// A texel's neighbours: right and below with the differences' weights, left and above to find theirs.
  struct Links {
    Edge right, below;
    int left = -1, above = -1;
    bool curl() const { return right.neighbour >= 0 && below.neighbour >= 0; }
  };
  /// What depends on one texel's unknowns alone, with derivatives (of half the sum of squares).
  struct Local {
    double cost = 0;      ///< measurements and point-wise priors
    double dataCost = 0;  ///< measurements alone
    Vector gradient;
    Block hessian;  ///< Gauss-Newton
  };

  /// `data` must outlive the problem. The priors' relaxation follows from the level's longest side.
  LevelProblem(const FourierFitState& state, const SolverSetup& setup, const LevelData& data);

  std::size_t size() const { return texels_.size(); }
  /// Grid indices of the texels that take part.
  const std::vector<std::uint32_t>& texels() const { return texels_; }
  const std::vector<Links>& links() const { return links_; }
  /// Factor of the curl's residual.
  double curlWeight() const { return curlWeight_; }
  const std::vector<SiteData>& sites() const { return tile_.data; }
  /// Real measurements of a texel: channels times (2 * frequencies + 1).
  int measurementCount() const { return rows_ * 3; }
  double priorMean(int unknown) const { return priorMean_[unknown]; }
  double priorWeight(int unknown) const { return priorWeight_[unknown]; }

  /// App. D: albedos from the measurement nearest to frequency (6, 6) and from the zero frequency, for a lobe
  /// of sigma 0.03 and gamma 1.03 and a flat normal.
  std::vector<Vector> initialGuess() const;

  /// Columns of the model (`modelColumns`) of the texels first .. first + count at x: rows() * 8 floats each.
  void columns(std::span<const Vector> x, std::size_t first, std::size_t count, float* out) const;
  int rows() const { return rows_; }
  /// Weighted residuals of a texel's measurements, [channel][row], and their derivatives [residual][unknown]
  /// where asked for, given its columns.
  void measurementResiduals(std::size_t texel, const Vector& x, const float* columns, double* residual,
                            double* jacobian) const;

  /// Every texel's own part at x. Parallel; incomplete (and false) where the job is cancelled.
  bool evaluate(std::span<const Vector> x, std::vector<Local>& out, const JobContext& job) const;
  /// Sum of squares of what couples texels.
  double couplingCost(std::span<const Vector> x) const;
  /// The same as far as it depends on one texel, were that texel at `own` and all others at x.
  double couplingCostAt(std::span<const Vector> x, std::size_t texel, const Vector& own) const;
  /// out = C x for the coupling's Gauss-Newton matrix C (its residuals are linear: also half its gradient).
  void applyCoupling(std::span<const Vector> x, std::span<Vector> out) const;
  /// Diagonal block of C.
  Block couplingBlock(std::size_t texel) const;
  /// The curl's residual at a texel with neighbours to the right and below; 0 at others.
  double curl(std::span<const Vector> x, std::size_t texel) const;

 private:
  void buildLinks(const FourierFitState& state);

  const SolverSetup& setup_;
  const LevelData& level_;
  std::vector<std::uint32_t> texels_;
  LevelTile tile_;
  int rows_;
  double relaxation_, curlWeight_;
  double priorMean_[kUnknowns], priorWeight_[kUnknowns];
  std::vector<float> scale_;  ///< [texel][channel][row]: roots of the weights
  std::vector<Links> links_;
};

}  // namespace patina
