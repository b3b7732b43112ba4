#include "engine/diagnosis/two_shot_surface.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "engine/base/dense.h"
#include "engine/twoshot/mapping.h"
#include "engine/twoshot/metric.h"

namespace patina {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// As in the fit: this share of an added lobe is not known.
constexpr double kLobeError = 0.1;
/// Rows that the sensor drowns weigh as little as the fit lets them.
constexpr int kMostEvaluations = 260;

}  // namespace

SurfaceTrial::SurfaceTrial(const Basis& basis, const std::vector<DiagnosisRow>& fitted,
                           const std::vector<DiagnosisRow>& held, const TwoShotDeviation& deviation)
    : basis_(basis), fitted_(fitted), held_(held), deviation_(deviation) {
  std::vector<HalfDiffAngles> angles;
  for (const auto* rows : {&fitted_, &held_})
    for (const DiagnosisRow& row : *rows)
      angles.push_back(deviation_.angles(deviation_.directions(row.point)));
  std::vector<int> kept;
  rows_ = basis_.rows(angles, &kept);
  if (kept.size() != angles.size()) {
    // A tilt took rows across the basis' border: they stay where the bundle says.
    std::size_t at = 0;
    const TwoShotDeviation none;
    for (const auto* rows : {&fitted_, &held_})
      for (const DiagnosisRow& row : *rows) angles[at++] = none.angles(none.directions(row.point));
    rows_ = basis_.rows(angles);
  }
  const auto n = static_cast<Index>(fitted_.size());
  gram_ = product(rows_.components, false, MatrixXd(rows_.components.topRows(n)), true);
}

SurfaceTrial::Errors SurfaceTrial::errors(const TwoShotDeviation& deviation) const {
  const auto n = static_cast<Index>(fitted_.size()), all = rows_.size();
  const double modelVariance = kPaperEta / basis_.columnCount();
  std::size_t shots = 0;
  for (const auto* rows : {&fitted_, &held_})
    for (const DiagnosisRow& row : *rows) shots = std::max(shots, row.point.shot + 1);
  std::vector<double> residual(shots, 0.0), signal(shots, 0.0);
  std::vector<char> isHeld(shots, 0);
  MatrixXd target(n, 3), variance(n, 3);
  for (Index i = 0; i < n; ++i) {
    const DiagnosisRow& row = fitted_[static_cast<std::size_t>(i)];
    const DirectionPair pair = deviation.directions(row.point);
    Eigen::Array3d slope;
    const Eigen::Array3d base = deviation.baseFromSeen(row.seen, row.point, pair, &slope);
    const Eigen::Array3d lobe = kLobeError * deviation.added(pair);
    const double w = rows_.weight[i];
    for (int c = 0; c < 3; ++c) {
      const double f = std::max(base[c], 0.0), mapped = w / (f * w + kMappingEpsilon);
      target(i, c) = mapBrdf(f, w, rows_.lnReference[i]) - rows_.mean[i];
      const double noise = (row.variance[c] * slope[c] * slope[c] + lobe[c] * lobe[c]) * mapped * mapped;
      // Q Q' + eta / weight, the fit's own weights.
      variance(i, c) =
          kPaperEta / std::max(row.weight, 1e-9) * (1 + std::max(row.weight, 1e-9) * noise / modelVariance);
    }
  }
  for (int c = 0; c < 3; ++c) {
    MatrixXd system = gram_.topRows(n);
    system.diagonal() += variance.col(c);
    if (!choleskyInPlace(system)) return {};
    MatrixXd solved = target.col(c);
    solveLowerInPlace(system, false, solved);
    solveLowerInPlace(system, true, solved);
    const VectorXd mapped = gram_ * solved;
    for (Index i = 0; i < all; ++i) {
      const DiagnosisRow& row =
          i < n ? fitted_[static_cast<std::size_t>(i)] : held_[static_cast<std::size_t>(i - n)];
      const DirectionPair pair = deviation.directions(row.point);
      // One channel at a time; the others don't matter where there is no crosstalk.
      const double base = unmapBrdf(mapped[i] + rows_.mean[i], rows_.weight[i], rows_.lnReference[i]);
      Eigen::Array3d whole = Eigen::Array3d::Constant(base);
      const double predicted = deviation.seenFromBase(whole, row.point, pair)[c];
      const double light = row.point.rate[c] * row.point.exposureS;
      const double weight = row.weight * light * light, seen = row.seen[c];
      residual[row.point.shot] += weight * (predicted - seen) * (predicted - seen);
      signal[row.point.shot] += weight * seen * seen;
      isHeld[row.point.shot] = i >= n;
    }
  }
  Errors out;
  double sums[2][2] = {{0, 0}, {0, 0}};
  for (std::size_t s = 0; s < shots; ++s) {
    out.shot.push_back(signal[s] > 0 ? std::sqrt(residual[s] / signal[s]) : -1);
    sums[static_cast<int>(isHeld[s])][0] += residual[s];
    sums[static_cast<int>(isHeld[s])][1] += signal[s];
  }
  if (sums[0][1] > 0) out.fit = std::sqrt(sums[0][0] / sums[0][1]);
  if (sums[1][1] > 0) out.held = std::sqrt(sums[1][0] / sums[1][1]);
  return out;
}

bool SurfaceTrial::heldSees(const TwoShotDeviation& deviation) const {
  constexpr double kOfThePeak = 0.1;
  constexpr std::ptrdiff_t kFewestRows = 12;
  const auto lobe = [&](const DiagnosisRow& row) {
    return deviation.added(deviation.directions(row.point)).sum();
  };
  double peak = 0;
  for (const DiagnosisRow& row : fitted_) peak = std::max(peak, lobe(row));
  return std::count_if(held_.begin(), held_.end(),
                       [&](const DiagnosisRow& row) { return lobe(row) > kOfThePeak * peak; }) >= kFewestRows;
}

SurfaceTrial::Found SurfaceTrial::search(const TwoShotCandidate& candidate, const JobContext& job) const {
  const auto p = static_cast<Index>(candidate.parameters.size());
  // ln of the error, each photograph's and the sum's: the brightest one alone would decide otherwise. A prior
  // of one standard deviation weighs as much as 1 % of the error.
  const auto cost = [&](const VectorXd& at) {
    TwoShotDeviation there = deviation_;
    candidate.apply(at, there);
    const Errors e = errors(there);
    if (!(e.fit >= 0)) return 1e9;
    double prior = 0;
    for (Index i = 0; i < p; ++i) {
      const double z = (at[i] - candidate.parameters[i].middle) / candidate.parameters[i].sd;
      prior += 0.005 * z * z;
    }
    double mean = std::log(std::max(e.fit, 1e-6));
    double count = 1;
    std::vector<char> seen(e.shot.size(), 0);
    for (const DiagnosisRow& row : fitted_) seen[row.point.shot] = 1;
    for (std::size_t s = 0; s < e.shot.size(); ++s)
      if (seen[s] && e.shot[s] > 0) mean += std::log(std::max(e.shot[s], 1e-3)), ++count;
    return mean / count + prior;
  };
  std::vector<std::pair<double, VectorXd>> simplex;
  for (const VectorXd& start : candidate.starts) {
    if (job.cancelled()) break;
    const double value = cost(start);
    if (simplex.empty() || value < simplex.front().first) simplex.assign(1, {value, start});
  }
  Found found;
  if (simplex.empty()) return found;
  for (Index i = 0; i < p; ++i) {
    VectorXd corner = simplex.front().second;
    corner[i] += 0.4 * candidate.parameters[i].sd;
    simplex.emplace_back(cost(corner), corner);
  }
  const auto byValue = [](const auto& a, const auto& b) { return a.first < b.first; };
  for (int evaluations = 0; evaluations < kMostEvaluations && !job.cancelled();) {
    std::sort(simplex.begin(), simplex.end(), byValue);
    if (simplex.back().first - simplex.front().first < 2e-4) break;
    VectorXd centre = VectorXd::Zero(p);
    for (Index i = 0; i < p; ++i)
      centre += simplex[static_cast<std::size_t>(i)].second / static_cast<double>(p);
    const auto tried = [&](double factor) {
      VectorXd at = centre + factor * (simplex.back().second - centre);
      ++evaluations;
      return std::pair<double, VectorXd>{cost(at), at};
    };
    auto reflected = tried(-1);
    if (reflected.first < simplex.front().first) {
      auto expanded = tried(-2);
      simplex.back() = expanded.first < reflected.first ? expanded : reflected;
    } else if (reflected.first < simplex[simplex.size() - 2].first) {
      simplex.back() = reflected;
    } else {
      auto contracted = tried(reflected.first < simplex.back().first ? -0.5 : 0.5);
      if (contracted.first < std::min(reflected.first, simplex.back().first)) {
        simplex.back() = contracted;
      } else {
        for (std::size_t i = 1; i < simplex.size(); ++i) {
          simplex[i].second = (simplex[i].second + simplex.front().second) / 2;
          simplex[i].first = cost(simplex[i].second);
          ++evaluations;
        }
      }
    }
  }
  std::sort(simplex.begin(), simplex.end(), byValue);
  found.value = simplex.front().second;
  found.deviation = deviation_;
  candidate.apply(found.value, found.deviation);
  found.errors = errors(found.deviation);
  return found;
}

}  // namespace patina
