#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/fourier/options.h"
#include "engine/fourier/site_geometry.h"

namespace patina {

/// App. E's Gaussian priors: mean and standard deviation of each unknown.
struct FourierPriors {
  float diffuseSigma = 1.0f, specularSigma = 0.5f;  // mean 0
  float logSigmaMean = -3.0f, logSigmaSigma = 1.0f;
  float logKurtosisMean = -1.0f, logKurtosisSigma = 0.5f;  // of log(gamma - 1)
  float normalSigma = 0.1f;                                // mean 0, each tangential component
};

/// What all sites share.
struct SolverSetup {
  float normalRows[3][3];                       ///< world axis k in screen coordinates
  std::vector<Eigen::Vector2f> frequency;       ///< pattern units, without the zero frequency
  float halfExtent[2] = {3.14159265f, 1.767f};  ///< of the lit area, pattern units
  FourierPriors priors;
  LobeMapping lobe = LobeMapping::ExactMoments;
  LobeVariant variant;  ///< what sites have beyond the standard lobe; what isn't named here is not looked at
  int maxIterations = 40;
  float tolerance = 1e-5f;
  /// One for each frequency: 0 where the diffuse term is too small to be seen at any site, and
  /// SiteData::diffuse is taken for zero. Empty: all count.
  std::vector<char> diffuseCounts;
};

/// The four parameters that a texel's lobe depends on. The six albedos follow from them: they are linear.
struct LobeParameters {
  float logSigma = -3.5f;        ///< log of the slope's standard deviation
  float logKurtosis = -3.5f;     ///< log(gamma - 1)
  float slopeX = 0, slopeY = 0;  ///< n = (slopeX, slopeY, 1) normalised, world frame
};

/// One site's measurements, pointers into the caller's arrays.
struct SiteData {
  SiteGeometry geometry;
  const float* diffuse = nullptr;  ///< DiffuseTransform::at for zero frequency, then `frequency`
  const float* z = nullptr;        ///< [frequency][re R G B, im R G B]
  const float* dc = nullptr;       ///< [R G B]
  float weight[3];                 ///< one over the variance of one component of Z
  float dcWeight[3];
  /// Components that saturated photographs spoilt and that the fit leaves out: 2 * frequency + {0: re, 1:
  /// im}.
  std::span<const std::uint16_t> dropped = {};
};

enum class SolveOutcome : std::uint8_t { Converged, IterationLimit, Failed };

struct SiteSolution {
  LobeParameters lobe;
  float diffuse[3] = {0, 0, 0}, specular[3] = {0, 0, 0};  ///< >= 0; specular at normal incidence
  float cost = 0;                                         ///< sum of squared weighted residuals and priors
  float dataCost = 0;                                     ///< without the priors
  /// Posterior covariance of logSigma, logKurtosis, slopeX, slopeY (upper triangle, row by row) under the
  /// declared weights and priors (Laplace: the inverse of the Gauss-Newton matrix at the optimum).
  float lobeCovariance[10] = {};
  /// Standard deviations of the albedos, the lobe's uncertainty included; filled by `refitAlbedos`. An albedo
  /// that is held at zero has 0.
  float diffuseSd[3] = {0, 0, 0}, specularSd[3] = {0, 0, 0};
  int iterations = 0;
  SolveOutcome outcome = SolveOutcome::Failed;
};

/// Levenberg-Marquardt on the four lobe parameters with the albedos projected out (variable projection,
/// Kaufman's form: the Schur complement of the albedos in the Gauss-Newton matrix), non-negative albedos,
/// steps capped at |d log sigma| 0.7 and |d slope| max(0.04, 1.5 sigma). Sites go through in SIMD lanes of
/// floats, a converged lane takes the next site; the instruction set is chosen at run time. `data`, `start`
/// and `out` have equal length, any. A site's result doesn't depend on the sites beside it. Thread-safe,
/// allocates a workspace for each thread. Source: frequency-domain paper, section 7 and App. E. Cost:
/// `solverOperations` a site and iteration.
void solveSites(const SolverSetup& setup, std::span<const SiteData> data,
                std::span<const LobeParameters> start, std::span<SiteSolution> out);

/// Albedos from other measurements than those that the lobes were fitted to, at the lobes in `fitted`:
/// replaces the albedos, their standard deviations (with the lobe's own uncertainty carried on) and dataCost.
void refitAlbedos(const SolverSetup& setup, std::span<const SiteData> data, std::span<SiteSolution> fitted);

/// Cost and Gauss-Newton gradient (half the derivative of the cost with the albedos at their optimum) at
/// given parameters; for tests.
struct CostAndGradient {
  float cost;
  float gradient[4];  ///< logSigma, logKurtosis, slopeX, slopeY
};
CostAndGradient evaluateSite(const SolverSetup& setup, const SiteData& data, const LobeParameters& at);

/// The model's two parts at every real measurement, with their derivatives, for unit albedos.
/// Rows: real and imaginary part of each frequency, one after the other, then the zero frequency.
/// Columns: diffuse, specular, d diffuse / d slope x, y, d specular / d log sigma, log(gamma - 1), slope x,
/// y.
inline constexpr int kModelColumns = 8;
/// Writes out[site][row][kModelColumns], 2 * frequencies + 1 rows a site. For the regularised levels, which
/// couple texels, and for tests.
void modelColumns(const SolverSetup& setup, std::span<const SiteData> data,
                  std::span<const LobeParameters> at, float* out);

/// Lanes of the instruction set in use, and its name.
int solverLanes();
const char* solverTarget();

}  // namespace patina
