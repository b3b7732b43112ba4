#include "engine/flash/solve_sheet.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <atomic>
#include <cmath>

namespace patina {
namespace {

constexpr int kTexelIterations = 14;
/// Texels that a level's spread is learned from.
constexpr int kLearnTexels = 1500;
constexpr int kLearnRounds = 4;
/// Specular albedos that photographs told less than this share of the prior's spread are not measured.
constexpr double kUnmeasured = 0.9;

/// A coarser level's solution around a point of the finer one, of one material; weight 0: none there.
struct Neighbourhood {
  TexelVector mean = TexelVector::Zero();
  double weight = 0;
};
Neighbourhood around(const FlashSolved& coarse, const FlashGrid& grid, const Eigen::Vector2d& pointMm,
                     int material) {
  const double x = (pointMm.x() - grid.originXMm) / grid.texelXMm - 0.5,
               y = (grid.originYMm - pointMm.y()) / grid.texelYMm - 0.5;
  const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
  Neighbourhood n;
  for (int d = 0; d < 4; ++d) {
    const int i = std::clamp(x0 + d % 2, 0, grid.width - 1), j = std::clamp(y0 + d / 2, 0, grid.height - 1);
    const std::size_t index = static_cast<std::size_t>(j) * grid.width + i;
    if (coarse.material[index] != material || coarse.status[index] == TexelStatus::NotMeasured ||
        coarse.status[index] == TexelStatus::Failed)
      continue;
    const double weight = (d % 2 ? x - x0 : 1 - (x - x0)) * (d / 2 ? y - y0 : 1 - (y - y0));
    n.mean += weight * coarse.x[index].cast<double>();
    n.weight += weight;
  }
  if (n.weight > 0) n.mean /= n.weight;
  return n;
}

int materialOf(const FlashSite& site, const FlashPalette& palette, const FlashSolved* coarse,
               const FlashGrid* grid) {
  const Eigen::Array3d colour = darkColour(site);
  if (!coarse) return palette.nearest(colour);
  // Fine texels are noisy and sparkle: only materials of the coarse neighbourhood are at choice.
  const double x = (site.pointMm.x() - grid->originXMm) / grid->texelXMm,
               y = (grid->originYMm - site.pointMm.y()) / grid->texelYMm;
  FlashPalette here;
  std::vector<int> index;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      const int i = std::clamp(static_cast<int>(x) + dx, 0, grid->width - 1),
                j = std::clamp(static_cast<int>(y) + dy, 0, grid->height - 1);
      const int m = coarse->material[static_cast<std::size_t>(j) * grid->width + i];
      if (std::find(index.begin(), index.end(), m) != index.end()) continue;
      index.push_back(m);
      here.logColour.push_back(palette.logColour[static_cast<std::size_t>(m)]);
    }
  }
  return index[static_cast<std::size_t>(here.nearest(colour))];
}

/// The spread of this level's texels about the coarser level's, and what the model lacks at this resolution.
void learnSpread(const FlashData& data, const FlashLevel& level, const FlashPalette& palette,
                 const FlashSolved& coarse, const FlashGrid& coarseGrid, FlashModel& model,
                 std::vector<TexelMatrix>& spread, const JobContext& job) {
  FlashSample sample = drawSample(data, level, kLearnTexels);
  std::vector<char> photos(data.capture.photos.size(), 1);
  std::vector<FlashSite> sites;
  std::vector<TexelVector> centres;
  for (FlashSite& site : sample.sites) {
    site.material = materialOf(site, palette, &coarse, &coarseGrid);
    const Neighbourhood n = around(coarse, coarseGrid, site.pointMm, site.material);
    if (!(n.weight > 0)) continue;
    sites.push_back(site), centres.push_back(n.mean);
  }
  JointState state;
  for (int round = 0; round < kLearnRounds && !job.cancelled(); ++round) {
    std::vector<TexelPrior> priors;
    for (const TexelMatrix& one : spread) priors.push_back({{}, one.llt().solve(TexelMatrix::Identity())});
    std::vector<TexelSolution> solved(sites.size());
    tbb::parallel_for(std::size_t{0}, sites.size(), [&](std::size_t s) {
      TexelPrior prior = priors[static_cast<std::size_t>(sites[s].material)];
      prior.mean = centres[s];
      solved[s] = solveTexel(model, sites[s], prior, centres[s], kTexelIterations);
    });
    for (std::size_t m = 0; m < spread.size(); ++m) {
      // A tenth of the material's own spread counts as ten texels, so that few texels don't make it zero.
      constexpr double kOwn = 10;
      TexelMatrix sum = 0.1 * kOwn * model.materials[m].covariance, uncertain = TexelMatrix::Zero();
      double count = 0, observations = 0;
      std::vector<std::array<double, 3>> misfits;
      for (std::size_t s = 0; s < sites.size(); ++s) {
        if (sites[s].material != static_cast<int>(m) || !solved[s].finite) continue;
        const TexelVector d = solved[s].x - centres[s];
        sum += d * d.transpose();
        uncertain += solved[s].information.llt().solve(TexelMatrix::Identity());
        count += 1;
        for (const FlashObservation& seen : sites[s].seen) {
          const SeenPrediction p = predictSeen(model, static_cast<int>(m), seen, solved[s].x, false);
          for (int c = 0; c < 3; ++c) {
            if ((seen.clipped >> c) & 1) continue;
            const double middle = 0.5 * (seen.value[c] + std::max(p.value[c], 0.0));
            misfits.push_back({(p.value[c] - seen.value[c]) * (p.value[c] - seen.value[c]), seen.variance[c],
                               middle * middle});
            observations += 1;
          }
        }
      }
      if (count < 20 || misfits.size() < 50) continue;
      const TexelMatrix precision = spread[m].llt().solve(TexelMatrix::Identity());
      const double taken = FlashTexel::kParameters - (precision * uncertain).trace() / count;
      spread[m] = (sum + uncertain) / (count + kOwn);
      model.materials[m].discrepancy =
          std::sqrt(model.materials[m].discrepancy *
                    discrepancyOf(misfits, std::clamp(1 - taken * count / observations, 0.15, 1.0)));
    }
  }
}

float relativeResidual(const FlashModel& model, const FlashSite& site, const TexelVector& x) {
  double squares = 0, values = 1e-30;
  for (const FlashObservation& seen : site.seen) {
    const SeenPrediction p = predictSeen(model, site.material, seen, x, false);
    for (int c = 0; c < 3; ++c) {
      double d = p.value[c] - seen.value[c];
      if (((seen.clipped >> c) & 1) && d > 0) d = 0;
      squares += d * d, values += seen.value[c] * seen.value[c];
    }
  }
  return static_cast<float>(std::sqrt(squares / values));
}

TexelStatus statusOf(const FlashSite& site, const TexelSolution& solution, const TexelMatrix& covariance,
                     const TexelMatrix& unknown) {
  if (!solution.finite) return TexelStatus::Failed;
  std::size_t open = 0;
  for (const FlashObservation& seen : site.seen) open += seen.clipped != 7;
  if (open < 2 || 2 * open < site.seen.size()) return TexelStatus::Clipped;
  const double told = covariance.diagonal().tail<3>().sum(), before = unknown.diagonal().tail<3>().sum();
  if (told > kUnmeasured * kUnmeasured * before) return TexelStatus::MirrorOffScreen;
  return solution.converged ? TexelStatus::Converged : TexelStatus::IterationLimit;
}

}  // namespace

FlashSolved solveSheet(const FlashData& data, const FlashPalette& palette, const FlashModel& shared,
                       const JobContext& job) {
  FlashSolved coarse;
  FlashModel model = shared;
  std::int64_t total = 0, before = 0;
  for (const FlashLevel& level : data.levels) total += static_cast<std::int64_t>(level.grid.size());
  for (std::size_t l = data.levels.size(); l-- > 0;) {
    const FlashLevel& level = data.levels[l];
    const bool first = l + 1 == data.levels.size();
    const FlashGrid* coarseGrid = first ? nullptr : &data.levels[l + 1].grid;
    std::vector<TexelMatrix> whole, spread;
    for (const FlashMaterial& material : shared.materials) whole.push_back(material.covariance);
    spread = whole;
    if (!first) {
      for (TexelMatrix& one : spread) one *= 0.25;  // where to begin
      learnSpread(data, level, palette, coarse, *coarseGrid, model, spread, job);
    }
    std::vector<TexelPrior> about, anywhere;
    for (std::size_t m = 0; m < whole.size(); ++m) {
      anywhere.push_back({shared.materials[m].mean, whole[m].llt().solve(TexelMatrix::Identity())});
      about.push_back({{}, spread[m].llt().solve(TexelMatrix::Identity())});
    }
    FlashSolved fine;
    const std::size_t count = level.grid.size();
    fine.x.resize(count), fine.sd.resize(count);
    fine.material.resize(count), fine.status.resize(count), fine.residual.resize(count);
    std::atomic<std::int64_t> iterations{coarse.iterations}, rows{0};
    tbb::parallel_for(0, level.grid.height, [&](int j) {
      for (int i = 0; i < level.grid.width; ++i) {
        const std::size_t index = static_cast<std::size_t>(j) * level.grid.width + i;
        fine.status[index] = TexelStatus::NotMeasured;
        FlashSite site = siteOf(data, level, i, j);
        site.material =
            site.seen.empty() ? 0 : materialOf(site, palette, first ? nullptr : &coarse, coarseGrid);
        fine.material[index] = static_cast<std::uint8_t>(site.material);
        const auto m = static_cast<std::size_t>(site.material);
        TexelPrior prior = anywhere[m];
        bool known = false;
        if (!first) {
          const Neighbourhood n = around(coarse, *coarseGrid, site.pointMm, site.material);
          if (n.weight > 0) prior = about[m], prior.mean = n.mean, known = true;
        }
        fine.x[index] = prior.mean.cast<float>();
        fine.sd[index] = whole[m].diagonal().cwiseSqrt().cast<float>();
        if (site.seen.empty()) continue;
        if (job.cancelled()) {
          fine.status[index] = TexelStatus::Cancelled;
          continue;
        }
        TexelSolution best;
        if (known) {
          best = solveTexel(model, site, prior, prior.mean, kTexelIterations);
        } else {
          bool any = false;
          for (const TexelVector& start : startsOf(site, prior)) {
            TexelSolution solution = solveTexel(model, site, prior, start, kTexelIterations + 10);
            if (!any || (solution.finite && solution.cost < best.cost))
              best = std::move(solution), any = true;
          }
        }
        iterations += best.iterations;
        const TexelMatrix covariance = best.information.llt().solve(TexelMatrix::Identity());
        fine.status[index] = statusOf(site, best, covariance, known ? spread[m] + 0.5 * whole[m] : whole[m]);
        if (!best.finite || !covariance.allFinite()) {
          fine.status[index] = TexelStatus::Failed;
          continue;
        }
        fine.x[index] = best.x.cast<float>();
        fine.sd[index] = covariance.diagonal().cwiseMax(0).cwiseSqrt().cast<float>();
        fine.residual[index] = relativeResidual(model, site, best.x);
      }
      const std::int64_t done = before + ++rows * level.grid.width;
      job.progress("texels", done, total, "texels");
    });
    before += static_cast<std::int64_t>(count);
    fine.iterations = iterations;
    coarse = std::move(fine);
  }
  coarse.materials = model.materials;
  return coarse;
}

}  // namespace patina
