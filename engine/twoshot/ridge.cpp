#include "engine/twoshot/ridge.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/base/dense.h"
#include "engine/twoshot/mapping.h"

namespace patina {
namespace {

constexpr double kLowestEta = 0.1, kHighestEta = 1000;
constexpr int kEtaSteps = 16;  // four a decade: finer than the minimum is sharp
/// Directions in which the rows say less than this share of eta are left to the prior.
constexpr double kNegligible = 1e-6;
constexpr Eigen::Index kChunk = 512;  // rows at a time, between looks at the stop token

/// Z^T diag(w) Z and Z^T diag(w) y over the rows for which `use` says so.
struct Normal {
  Eigen::MatrixXd matrix;
  Eigen::VectorXd right;
};

Normal normalEquations(const RidgeProblem& problem, int channel, int fold) {
  const Eigen::Index n = problem.reduced.rows(), r = problem.reduced.cols();
  std::vector<Eigen::Index> used;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (fold < 0 || problem.fold[i] == fold) used.push_back(i);
  }
  Eigen::MatrixXd scaled(static_cast<Eigen::Index>(used.size()), r);
  Eigen::VectorXd target(scaled.rows());
  for (Eigen::Index i = 0; i < scaled.rows(); ++i) {
    const double root = std::sqrt(problem.weight(used[i], channel));
    scaled.row(i) = root * problem.reduced.row(used[i]);
    target[i] = root * problem.target(used[i], channel);
  }
  Normal normal{Eigen::MatrixXd::Zero(r, r), scaled.transpose() * target};
  if (scaled.rows() > 0) addGramOfColumns(scaled, normal.matrix);
  normal.matrix.triangularView<Eigen::StrictlyUpper>() = normal.matrix.transpose();
  return normal;
}

}  // namespace

RowFactor RidgeProblem::factor() const {
  return {eigenvalues.cwiseSqrt().asDiagonal() * directions.transpose()};
}

std::optional<RidgeProblem> makeRidgeProblem(const Basis& basis, const Observations& observations,
                                             bool noiseWeights, double smallestEta, const JobContext& job) {
  std::vector<int> kept;
  const BasisRows rows = basis.rows(observations.angles, &kept);
  const Eigen::Index n = rows.size(), k = basis.componentCount();
  RidgeProblem problem;
  problem.unreached = observations.size() - kept.size();
  problem.target.resize(n, 3), problem.weight.resize(n, 3), problem.noise.resize(n, 3);
  problem.rowWeight.resize(n);
  problem.fold.resize(n);
  const double modelVariance = kPaperEta / basis.columnCount();
  for (Eigen::Index i = 0; i < n; ++i) {
    const int from = kept[i];
    problem.fold[i] = observations.fold[from];
    const double share = observations.weight[from], w = rows.weight[i];
    problem.rowWeight[i] = share;
    for (int c = 0; c < 3; ++c) {
      // A mean below zero is noise around black; its logarithm is black's, and known as badly.
      const double f = std::max(observations.brdf[from][c], 0.0);
      problem.target(i, c) = mapBrdf(f, w, rows.lnReference[i]) - rows.mean[i];
      const double slope = w / (f * w + kMappingEpsilon);
      problem.noise(i, c) = observations.variance[from][c] * slope * slope;
      const double noise = noiseWeights ? share * problem.noise(i, c) : 0.0;
      problem.weight(i, c) = share * modelVariance / (modelVariance + noise);
    }
  }

  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(k, k);
  for (Eigen::Index from = 0; from < n; from += kChunk) {
    if (job.cancelled()) return std::nullopt;
    const Eigen::Index count = std::min(kChunk, n - from);
    const Eigen::VectorXd root = problem.weight.middleRows(from, count).rowwise().mean().cwiseSqrt();
    const Eigen::MatrixXd scaled = root.asDiagonal() * rows.components.middleRows(from, count);
    addGramOfColumns(scaled, gram);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(gram);  // reads the lower triangle
  Eigen::Index rank = 0;
  while (rank < k && eigen.eigenvalues()[k - 1 - rank] > kNegligible * smallestEta) ++rank;
  problem.directions = eigen.eigenvectors().rightCols(rank).rowwise().reverse();
  problem.eigenvalues = eigen.eigenvalues().tail(rank).reverse();
  problem.reduced.resize(n, rank);
  for (Eigen::Index from = 0; from < n; from += kChunk) {
    if (job.cancelled()) return std::nullopt;
    const Eigen::Index count = std::min(kChunk, n - from);
    problem.reduced.middleRows(from, count) =
        product(rows.components.middleRows(from, count), false, problem.directions, false);
  }
  return problem;
}

Eigen::MatrixXd solveRidge(const RidgeProblem& problem, const Eigen::Vector3d& eta) {
  Eigen::MatrixXd coefficients(problem.directions.rows(), 3);
  const Eigen::Index r = problem.reduced.cols();
  for (int c = 0; c < 3; ++c) {
    Normal normal = normalEquations(problem, c, -1);
    normal.matrix.diagonal().array() += eta[c];
    const Eigen::VectorXd solution = r > 0 ? normal.matrix.llt().solve(normal.right).eval() : normal.right;
    coefficients.col(c) = problem.directions * solution;
  }
  return coefficients;
}

double chooseEta(const RidgeProblem& problem) {
  const int folds =
      problem.fold.empty() ? 0 : 1 + *std::max_element(problem.fold.begin(), problem.fold.end());
  std::vector<std::vector<Normal>> parts(3);
  std::vector<Eigen::MatrixXd> whole(3);
  std::vector<Eigen::VectorXd> right(3);
  int filled = 0;
  for (int f = 0; f < folds; ++f) {
    filled += std::find(problem.fold.begin(), problem.fold.end(), f) != problem.fold.end();
  }
  if (filled < 2) return kPaperEta;
  tbb::parallel_for(0, 3, [&](int c) {
    for (int f = 0; f < folds; ++f) parts[c].push_back(normalEquations(problem, c, f));
    whole[c] = parts[c].front().matrix, right[c] = parts[c].front().right;
    for (int f = 1; f < folds; ++f) whole[c] += parts[c][f].matrix, right[c] += parts[c][f].right;
  });
  std::vector<std::array<double, kEtaSteps + 1>> error(3 * folds);
  tbb::parallel_for(0, 3 * folds, [&](int task) {
    const int c = task % 3, f = task / 3;
    const Normal& part = parts[c][f];
    // Held-out squares without their constant part: x^T A x - 2 b^T x.
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(whole[c] - part.matrix);
    const Eigen::VectorXd b = eigen.eigenvectors().transpose() * (right[c] - part.right);
    for (int e = 0; e <= kEtaSteps; ++e) {
      const double eta = kLowestEta * std::pow(kHighestEta / kLowestEta, static_cast<double>(e) / kEtaSteps);
      const Eigen::VectorXd x =
          eigen.eigenvectors() * (b.array() / (eigen.eigenvalues().array().max(0.0) + eta)).matrix();
      error[task][e] = x.dot(part.matrix * x) - 2 * part.right.dot(x);
    }
  });
  double best = std::numeric_limits<double>::infinity(), chosen = kPaperEta;
  for (int e = 0; e <= kEtaSteps; ++e) {
    double sum = 0;
    for (const auto& task : error) sum += task[e];
    // Ties go to the larger eta: the simpler answer.
    if (sum <= best) {
      best = sum;
      chosen = kLowestEta * std::pow(kHighestEta / kLowestEta, static_cast<double>(e) / kEtaSteps);
    }
  }
  return chosen;
}

}  // namespace patina
