#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/fourier/solver.h"

namespace patina {

struct FourierFitState;

/// What the sites say about the texels of a grid over the sample rectangle: row 0 at +y, column 0 at -x.
///
/// Z is kept *turned*: multiplied by exp(i w . m(p)), m(p) where a mirror lying at the point p shows on the
/// screen. A sharp reflection's phase at frequency 40 turns by radians from one texel to the next for no
/// other reason than place; turned, it is comparable, and can be averaged and combined. `MirrorPhase` of
/// levels_data.h does it.
struct LevelData {
  int width = 0, height = 0;
  double widthMm = 0, heightMm = 0;
  int frequencyCount = 0;

  std::vector<std::uint32_t> siteCount;  ///< of a texel; 0: no photograph sees it, and all else is zero
  std::vector<Eigen::Vector2f> pointMm;  ///< centroid of its sites
  std::vector<float> z;                  ///< [texel][frequency][re R G B, im R G B], turned; mean over sites
  std::vector<std::uint32_t> rowCount;  ///< [texel][2 * frequency + {re, im}]: sites whose row is not dropped
  std::vector<float> dc;                ///< [texel][R G B]
  std::vector<float> siteVariance;    ///< [texel][R G B]: noise of one site's component of Z, mean over sites
  std::vector<float> siteDcVariance;  ///< [texel][R G B]
  std::vector<float> scatter;  ///< as z: variance of a site's value about the mean beyond noise; may be empty
  std::vector<float> dcScatter;  ///< as dc; may be empty

  std::size_t size() const { return static_cast<std::size_t>(width) * height; }
  std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * width + x; }
  std::size_t zStride() const { return static_cast<std::size_t>(frequencyCount) * 6; }
};

/// One level's course, for statistics and tests. Costs are sums of squares over the whole level.
struct LevelReport {
  int dimension = 0;  ///< longest side, texels
  int iterations = 0;
  double startCost = 0, cost = 0;
  double seconds = 0;
};

/// A solved grid. `texels` has one solution for each texel; outcome Failed where no photograph sees it.
struct LevelSolution {
  LevelData data;
  std::vector<SiteSolution> texels;
  std::vector<LevelReport> reports;  ///< of this level and those before it
};

/// Solves the sheet at 32, 64 and 128 texels on the longest side (those below the sites' own resolution, at
/// least one), each level started from the one before, and returns the last.
/// Source: frequency-domain paper, sections 7 and 7.1, App. D and E; docs/fourier_fit.md says where we
/// depart. Each level is one sparse problem: all ten parameters of all texels, coupled by smoothness of
/// albedos (with weights from the data), log sigma and log(gamma - 1), and by the curl of the normals; the
/// priors relax with 32 / dimension. Progress stage: "levels". Cancelled: the last finished level, else
/// ErrorCode::Cancelled. Deterministic for one instruction set; runs on the cores of the caller's TBB arena.
/// Cost: about a second for a 1024 x 1024 sheet.
Result<LevelSolution> solveLevels(const FourierFitState& state, const SolverSetup& setup,
                                  const JobContext& job);

/// What the half resolution of `paperSchedule` takes while it is solved, for sites that resolve
/// `longestTexels` on the longest side of a sheet whose other side is `aspect` times as long.
std::uint64_t paperScheduleBytes(int longestTexels, double aspect, int frequencyCount);

/// The paper's own schedule: levels, then independent texels at half of the sites' resolution started from
/// the last level, then 7.2's upsampling to every site. Fills `out`, one a site, with lobes, albedos and the
/// cost of the site's own measurements; no site is solved by itself.
/// Progress stages: "levels", "solve", "upsample". Errors: Cancelled before the levels were
/// finished; a later stop leaves outcome Failed where nothing is known yet. Memory:
/// `paperScheduleBytes`, and the last level.
Status paperSchedule(const FourierFitState& state, const SolverSetup& setup, std::span<SiteSolution> out,
                     const JobContext& job);

}  // namespace patina
