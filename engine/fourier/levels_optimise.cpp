#include "engine/fourier/levels_optimise.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <chrono>
#include <cmath>

namespace patina {
namespace {

using Vector = LevelProblem::Vector;
using Block = LevelProblem::Block;
constexpr int kUnknowns = LevelProblem::kUnknowns;
constexpr std::size_t kChunk = 256;  // texels whose sums are taken together

template <typename Body>
void overTexels(std::size_t count, Body body) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, kChunk), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) body(i);
  });
}

double dot(std::span<const Vector> a, std::span<const Vector> b) {
  std::vector<double> part((a.size() + kChunk - 1) / kChunk, 0.0);
  tbb::parallel_for(std::size_t{0}, part.size(), [&](std::size_t p) {
    for (std::size_t i = p * kChunk; i < std::min(a.size(), (p + 1) * kChunk); ++i) part[p] += a[i].dot(b[i]);
  });
  double sum = 0;
  for (const double p : part) sum += p;
  return sum;
}

// As in the site solver: wider than any material or any camera could show.
constexpr double kLogSigmaRange[2] = {-6.5, 0.7};
constexpr double kLogKurtosisRange[2] = {-7.0, 1.6};
constexpr double kSlopeRange = 1.5;

Vector clamped(Vector v) {
  v[0] = std::clamp(v[0], kLogSigmaRange[0], kLogSigmaRange[1]);
  v[1] = std::clamp(v[1], kLogKurtosisRange[0], kLogKurtosisRange[1]);
  for (int k = 2; k < 4; ++k) v[k] = std::clamp(v[k], -kSlopeRange, kSlopeRange);
  for (int k = 4; k < kUnknowns; ++k) v[k] = std::max(v[k], 0.0);
  return v;
}

/// A step as long as the linear model can be trusted for (the site solver's bounds).
Vector stepped(const Vector& from, const Vector& step) {
  const double longestSlope = std::max(0.04, 1.5 * std::exp(from[0]));
  double scale = std::min(1.0, longestSlope / std::max(std::hypot(step[2], step[3]), 1e-10));
  scale = std::min(scale, 0.7 / std::max(std::abs(step[0]), 1e-6));
  scale = std::min(scale, 1.0 / std::max(std::abs(step[1]), 1e-6));
  return clamped(from + scale * step);
}

LevelSystem makeSystem(const LevelProblem& problem, std::span<const Vector> x,
                       const std::vector<LevelProblem::Local>& local, const std::vector<double>& damping) {
  const std::size_t count = problem.size();
  LevelSystem system{problem, std::vector<Block>(count), std::vector<Vector>(count),
                     std::vector<Vector>(count)};
  std::vector<Vector> coupling(count);
  problem.applyCoupling(x, coupling);
  overTexels(count, [&](std::size_t i) {
    const Vector gradient = local[i].gradient + coupling[i];
    Vector& free = system.free[i];
    free.setOnes();
    for (int k = 4; k < kUnknowns; ++k)
      if (x[i][k] <= 0 && gradient[k] >= 0) free[k] = 0;
    system.negativeGradient[i] = -gradient.cwiseProduct(free);
    Block& block = system.block[i];
    block = local[i].hessian;
    block.diagonal() += damping[i] * (local[i].hessian + problem.couplingBlock(i)).diagonal();
    block = free.asDiagonal() * block * free.asDiagonal();
  });
  return system;
}

}  // namespace

void LevelSystem::apply(std::span<const Vector> x, std::span<Vector> out) const {
  problem.applyCoupling(x, out);
  overTexels(x.size(), [&](std::size_t i) {
    Vector sum = out[i];
    sum += block[i].lazyProduct(x[i]);  // a call into Eigen's general product costs more than the product
    out[i] = sum.cwiseProduct(free[i]);
  });
}

bool solveByConjugateGradients(const LevelSystem& system, std::span<Vector> step, const JobContext& job) {
  constexpr double kResidual = 1e-2;  // a step is corrected by the next; more digits buy nothing
  constexpr int kMostRounds = 200;
  const std::size_t count = step.size();
  std::vector<Block> inverse(count);
  overTexels(count, [&](std::size_t i) {
    Block block = system.block[i] + Block(system.free[i].asDiagonal() * system.problem.couplingBlock(i) *
                                          system.free[i].asDiagonal());
    block.diagonal() += Vector::Ones() - system.free[i];
    inverse[i] = block.llt().solve(Block::Identity());
  });
  std::vector<Vector> residual(system.negativeGradient), preconditioned(count), direction(count),
      product(count);
  auto precondition = [&] {
    overTexels(count, [&](std::size_t i) {
      preconditioned[i] = inverse[i].lazyProduct(residual[i]).cwiseProduct(system.free[i]);
    });
  };
  precondition();
  direction = preconditioned;
  double energy = dot(residual, preconditioned);
  const double enough = kResidual * kResidual * energy;
  for (int round = 0; round < kMostRounds && energy > enough && energy > 0; ++round) {
    if (job.cancelled()) return false;
    system.apply(direction, product);
    const double curvature = dot(direction, product);
    if (!(curvature > 0)) break;
    const double length = energy / curvature;
    overTexels(count, [&](std::size_t i) {
      step[i] += length * direction[i];
      residual[i] -= length * product[i];
    });
    precondition();
    const double next = dot(residual, preconditioned);
    overTexels(count,
               [&](std::size_t i) { direction[i] = preconditioned[i] + next / energy * direction[i]; });
    energy = next;
  }
  return true;
}

LevelReport optimiseLevel(const LevelProblem& problem, const LevelOptions& options,
                          const LevelLinearSolver& solver, std::vector<Vector>& x,
                          std::vector<LevelProblem::Local>& local, const JobContext& job) {
  const auto begin = std::chrono::steady_clock::now();
  const std::size_t count = problem.size();
  LevelReport report;
  for (auto& v : x) v = clamped(v);
  auto totalOf = [&](const std::vector<LevelProblem::Local>& parts, std::span<const Vector> at) {
    double sum = problem.couplingCost(at);
    for (const auto& part : parts) sum += part.cost;
    return sum;
  };
  if (!problem.evaluate(x, local, job)) return report;
  report.startCost = report.cost = totalOf(local, x);
  std::vector<double> damping(count, 1e-3);
  std::vector<LevelProblem::Local> trial;
  std::vector<Vector> step(count), next(count);
  std::vector<char> worse(count);
  while (report.iterations < options.maxIterations && !job.cancelled()) {
    const LevelSystem system = makeSystem(problem, x, local, damping);
    std::ranges::fill(step, Vector::Zero());
    if (!solver(system, step, job)) break;
    overTexels(count, [&](std::size_t i) { next[i] = stepped(x[i], step[i]); });
    if (!problem.evaluate(next, trial, job)) break;
    ++report.iterations;
    overTexels(count, [&](std::size_t i) {
      const double before = local[i].cost + problem.couplingCostAt(next, i, x[i]),
                   after = trial[i].cost + problem.couplingCostAt(next, i, next[i]);
      worse[i] = !(after <= before);  // also where it isn't a number
    });
    overTexels(count, [&](std::size_t i) {
      if (worse[i]) next[i] = x[i], trial[i] = local[i];
      damping[i] = worse[i] ? damping[i] * 5 : std::max(damping[i] * 0.2, 1e-7);
    });
    const double cost = totalOf(trial, next);
    if (cost < report.cost) {
      const double gain = report.cost - cost;
      std::swap(x, next);
      std::swap(local, trial);
      report.cost = cost;
      if (gain < options.tolerance * cost) break;
    } else {
      for (auto& d : damping) d *= 25;
      constexpr double kStuck = 1e6;  // steps of a millionth: there is nothing lower
      if (*std::ranges::min_element(damping) > kStuck) break;
    }
  }
  report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return report;
}

}  // namespace patina
