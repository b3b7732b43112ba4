// The regularised coarse levels: the same coupled problem of a made-up sheet solved by our
// Levenberg-Marquardt with conjugate gradients (what the engine uses), by the same with Eigen's sparse LDL^T,
// and by Ceres with its sparse Cholesky (its conjugate gradients stop above the others' cost and are left
// out). All start alike and must end at the same cost.
//
// patina-bench --benchmark_filter=Level
#include <benchmark/benchmark.h>
#include <ceres/ceres.h>
#include <tbb/parallel_for.h>

#include <Eigen/SparseCholesky>
#include <cmath>
#include <map>
#include <memory>
#include <thread>

#include "engine/fourier/levels.h"
#include "engine/fourier/levels_optimise.h"
#include "engine/fourier/upsample.h"
#include "tests/fourier/made_up_sheet.h"

namespace patina::bench {
namespace {

using Vector = LevelProblem::Vector;
constexpr int kUnknowns = LevelProblem::kUnknowns;

// Four sites a texel of the finest level: more would be slower to make up, and the same to solve.
constexpr int kSites = 256;
// Relative decrease at which all of them stop, and by how far their ends may then lie apart.
constexpr double kTolerance = 1e-5, kSameCost = 2e-3;
constexpr int kMostIterations = 60;

/// Wavy stripes of two materials, textured, with a little relief.
SvbrdfParameters stripes(double x, double y) {
  const bool orange = std::fmod(std::abs(x) + 4 * std::sin(y * 0.2), 20) < 10;
  SvbrdfParameters p = orange ? test::madeUpMaterial(0.12f, {0.25f, 0.12f, 0.04f})
                              : test::madeUpMaterial(0.05f, {0.05f, 0.1f, 0.2f});
  p.normal = Eigen::Vector3f(0.03f * static_cast<float>(std::sin(x * 0.9)),
                             0.03f * static_cast<float>(std::cos(y * 0.7)), 1)
                 .normalized();
  p.diffuse *= 1 + 0.2f * static_cast<float>(std::sin(x * 2) * std::cos(y * 2.3));
  return p;
}

const test::MadeUpSheet& benchSheet() {
  static const test::MadeUpSheet sheet(kSites, 80, 1e-4f, stripes);
  return sheet;
}

struct Level {
  SolverSetup setup = benchSheet().setup();
  LevelData data;
  LevelProblem problem;
  std::vector<Vector> start;

  explicit Level(int dimension)
      : data([&] {
          LevelData level = measureLevel(*benchSheet().state, dimension, dimension, true, {});
          finishScatter(level);
          return level;
        }()),
        problem(*benchSheet().state, setup, data) {
    // Near enough for all of them to walk into the same minimum: three steps from App. D's guess.
    start = problem.initialGuess();
    std::vector<LevelProblem::Local> local;
    optimiseLevel(problem, {3, 0}, solveByConjugateGradients, start, local, {});
  }
};

const Level& level(int dimension) {
  static std::map<int, std::unique_ptr<Level>> levels;
  auto& made = levels[dimension];
  if (!made) made = std::make_unique<Level>(dimension);
  return *made;
}

/// The system as a sparse matrix, factorised by Eigen.
bool solveByFactorisation(const LevelSystem& system, std::span<Vector> step, const JobContext&) {
  const LevelProblem& problem = system.problem;
  const int count = static_cast<int>(problem.size());
  std::vector<Eigen::Triplet<double>> entries;
  auto add = [&](int i, int k, int j, int l, double value) {
    if (value != 0 && system.free[i][k] > 0 && system.free[j][l] > 0)
      entries.emplace_back(i * kUnknowns + k, j * kUnknowns + l, value);
  };
  for (int i = 0; i < count; ++i) {
    const LevelProblem::Block block = system.block[i] + problem.couplingBlock(i);
    for (int k = 0; k < kUnknowns; ++k) {
      for (int l = 0; l < kUnknowns; ++l) add(i, k, i, l, block(k, l));
      if (system.free[i][k] == 0) entries.emplace_back(i * kUnknowns + k, i * kUnknowns + k, 1.0);
    }
    const auto& links = problem.links()[i];
    for (const auto* edge : {&links.right, &links.below}) {
      if (edge->neighbour < 0) continue;
      for (int k = 0; k < kUnknowns; ++k) {
        const double square = -static_cast<double>(edge->weight[k]) * edge->weight[k];
        add(i, k, edge->neighbour, k, square);
        add(edge->neighbour, k, i, k, square);
      }
    }
    if (!links.curl()) continue;
    // derivatives of the curl by slope x, slope y: here (-1, -1), right (0, 1), below (1, 0)
    const int right = links.right.neighbour, below = links.below.neighbour;
    const double square = problem.curlWeight() * problem.curlWeight();
    auto pair = [&](int a, int k, int b, int l, double value) {
      add(a, k, b, l, value * square);
      add(b, l, a, k, value * square);
    };
    pair(i, 2, right, 3, -1);
    pair(i, 3, right, 3, -1);
    pair(i, 2, below, 2, -1);
    pair(i, 3, below, 2, -1);
    pair(right, 3, below, 2, 1);
  }
  Eigen::SparseMatrix<double> matrix(count * kUnknowns, count * kUnknowns);
  matrix.setFromTriplets(entries.begin(), entries.end());
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(matrix);
  Eigen::VectorXd right(count * kUnknowns);
  for (int i = 0; i < count; ++i) right.segment<kUnknowns>(i * kUnknowns) = system.negativeGradient[i];
  const Eigen::VectorXd solution = solver.solve(right);
  for (int i = 0; i < count; ++i) step[i] = solution.segment<kUnknowns>(i * kUnknowns);
  return solver.info() == Eigen::Success;
}

/// All texels' model columns at once, in SIMD batches, whenever Ceres moves.
class AllColumns : public ceres::EvaluationCallback {
 public:
  AllColumns(const LevelProblem& problem, const std::vector<Vector>& x)
      : problem_(problem), x_(x), stride_(static_cast<std::size_t>(problem.rows()) * kModelColumns) {
    columns_.resize(x.size() * stride_);
  }
  void PrepareForEvaluation(bool, bool newPoint) override {
    if (!newPoint) return;
    constexpr std::size_t kBatch = 64;
    tbb::parallel_for(std::size_t{0}, (x_.size() + kBatch - 1) / kBatch, [&](std::size_t batch) {
      const std::size_t first = batch * kBatch;
      problem_.columns(x_, first, std::min(kBatch, x_.size() - first), columns_.data() + first * stride_);
    });
  }
  const float* of(std::size_t texel) const { return columns_.data() + texel * stride_; }

 private:
  const LevelProblem& problem_;
  const std::vector<Vector>& x_;
  std::size_t stride_;
  std::vector<float> columns_;
};

class TexelCost : public ceres::CostFunction {
 public:
  TexelCost(const LevelProblem& problem, const AllColumns& columns, std::size_t texel)
      : problem_(problem), columns_(columns), texel_(texel) {
    set_num_residuals(problem.measurementCount() + kUnknowns);
    mutable_parameter_block_sizes()->push_back(kUnknowns);
  }
  bool Evaluate(const double* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Map<const Vector> x(parameters[0]);
    double* jacobian = jacobians ? jacobians[0] : nullptr;
    problem_.measurementResiduals(texel_, x, columns_.of(texel_), residuals, jacobian);
    const int count = problem_.measurementCount();
    for (int k = 0; k < kUnknowns; ++k) {
      residuals[count + k] = problem_.priorWeight(k) * (x[k] - problem_.priorMean(k));
      if (!jacobian) continue;
      double* row = jacobian + (count + k) * kUnknowns;
      std::fill_n(row, kUnknowns, 0.0);
      row[k] = problem_.priorWeight(k);
    }
    return true;
  }

 private:
  const LevelProblem& problem_;
  const AllColumns& columns_;
  std::size_t texel_;
};

/// A linear residual: rows of coefficients for each block.
class LinearCost : public ceres::CostFunction {
 public:
  LinearCost(int rows, std::vector<std::vector<double>> blocks) : blocks_(std::move(blocks)) {
    set_num_residuals(rows);
    mutable_parameter_block_sizes()->assign(blocks_.size(), kUnknowns);
  }
  bool Evaluate(const double* const* parameters, double* residuals, double** jacobians) const override {
    const int rows = num_residuals();
    std::fill_n(residuals, rows, 0.0);
    for (std::size_t b = 0; b < blocks_.size(); ++b) {
      for (int r = 0; r < rows; ++r)
        for (int k = 0; k < kUnknowns; ++k) residuals[r] += blocks_[b][r * kUnknowns + k] * parameters[b][k];
      if (jacobians && jacobians[b]) std::ranges::copy(blocks_[b], jacobians[b]);
    }
    return true;
  }

 private:
  std::vector<std::vector<double>> blocks_;
};

double totalCost(const LevelProblem& problem, const std::vector<Vector>& x) {
  std::vector<LevelProblem::Local> local;
  problem.evaluate(x, local, {});
  double sum = problem.couplingCost(x);
  for (const auto& part : local) sum += part.cost;
  return sum;
}

int solveByCeres(const LevelProblem& problem, std::vector<Vector>& x) {
  AllColumns columns(problem, x);
  ceres::Problem::Options problemOptions;
  problemOptions.evaluation_callback = &columns;
  ceres::Problem ceresProblem(problemOptions);
  for (std::size_t i = 0; i < x.size(); ++i) {
    ceresProblem.AddResidualBlock(new TexelCost(problem, columns, i), nullptr, x[i].data());
    for (int k = 4; k < kUnknowns; ++k) ceresProblem.SetParameterLowerBound(x[i].data(), k, 0);
  }
  for (std::size_t i = 0; i < x.size(); ++i) {
    const auto& links = problem.links()[i];
    for (const auto* edge : {&links.right, &links.below}) {
      if (edge->neighbour < 0) continue;
      std::vector<double> here(kUnknowns * kUnknowns, 0.0), there = here;
      for (int k = 0; k < kUnknowns; ++k)
        here[k * kUnknowns + k] = edge->weight[k], there[k * kUnknowns + k] = -edge->weight[k];
      ceresProblem.AddResidualBlock(new LinearCost(kUnknowns, {here, there}), nullptr, x[i].data(),
                                    x[edge->neighbour].data());
    }
    if (!links.curl()) continue;
    std::vector<double> here(kUnknowns, 0.0), right = here, below = here;
    here[2] = here[3] = -problem.curlWeight();
    right[3] = below[2] = problem.curlWeight();
    ceresProblem.AddResidualBlock(new LinearCost(1, {here, right, below}), nullptr, x[i].data(),
                                  x[links.right.neighbour].data(), x[links.below.neighbour].data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = kMostIterations;
  options.function_tolerance = kTolerance;
  options.num_threads = static_cast<int>(std::thread::hardware_concurrency());
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &ceresProblem, &summary);
  return static_cast<int>(summary.iterations.size()) - 1;
}

/// What all of them have to reach: ours, run until nothing moves.
double referenceCost(int dimension) {
  static std::map<int, double> costs;
  auto [at, fresh] = costs.try_emplace(dimension, 0.0);
  if (fresh) {
    std::vector<Vector> x = level(dimension).start;
    std::vector<LevelProblem::Local> local;
    at->second =
        optimiseLevel(level(dimension).problem, {200, 1e-8}, solveByConjugateGradients, x, local, {}).cost;
  }
  return at->second;
}

template <typename Solve>
void measureSolver(benchmark::State& state, Solve solve) {
  const int dimension = static_cast<int>(state.range(0));
  const Level& at = level(dimension);
  const double reference = referenceCost(dimension);
  double cost = 0;
  int iterations = 0;
  for (auto _ : state) {
    std::vector<Vector> x = at.start;
    iterations = solve(at.problem, x);
    state.PauseTiming();
    cost = totalCost(at.problem, x);
    state.ResumeTiming();
  }
  state.counters["iterations"] = iterations;
  state.counters["cost"] = cost;
  state.counters["over_reference"] = cost / reference;
  if (!(cost < reference * (1 + kSameCost))) state.SkipWithError("ends at another cost than the reference");
}

int ours(const LevelProblem& problem, std::vector<Vector>& x, const LevelLinearSolver& solver) {
  std::vector<LevelProblem::Local> local;
  return optimiseLevel(problem, {kMostIterations, kTolerance}, solver, x, local, {}).iterations;
}

void BM_LevelConjugateGradients(benchmark::State& state) {
  measureSolver(state, [](const LevelProblem& problem, std::vector<Vector>& x) {
    return ours(problem, x, solveByConjugateGradients);
  });
}
void BM_LevelSparseCholesky(benchmark::State& state) {
  measureSolver(state, [](const LevelProblem& problem, std::vector<Vector>& x) {
    return ours(problem, x, solveByFactorisation);
  });
}
void BM_LevelCeresCholesky(benchmark::State& state) {
  measureSolver(state,
                [](const LevelProblem& problem, std::vector<Vector>& x) { return solveByCeres(problem, x); });
}
BENCHMARK(BM_LevelConjugateGradients)
    ->Arg(32)
    ->Arg(64)
    ->Arg(128)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
// A factorisation's time grows with the power 1.5 of the texels: at 64 it is minutes.
BENCHMARK(BM_LevelSparseCholesky)
    ->Arg(32)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();
BENCHMARK(BM_LevelCeresCholesky)
    ->Arg(32)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

/// What a fit does: measuring, 32, 64 and 128.
void BM_LevelsOfAFit(benchmark::State& state) {
  const test::MadeUpSheet& sheet = benchSheet();
  const SolverSetup setup = sheet.setup();
  for (auto _ : state) {
    const auto solution = solveLevels(*sheet.state, setup, {});
    if (!solution) state.SkipWithError(solution.error().sentence().c_str());
  }
}
BENCHMARK(BM_LevelsOfAFit)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime();

/// Section 7.2 from 128 texels to every site.
void BM_LevelUpsampling(benchmark::State& state) {
  const test::MadeUpSheet& sheet = benchSheet();
  static const auto solution = solveLevels(*sheet.state, sheet.setup(), {});
  if (!solution) return state.SkipWithError(solution.error().sentence().c_str());
  std::vector<SiteSolution> out(sheet.state->measurements.sites.size());
  for (auto _ : state) upsampleToSites(*sheet.state, *solution, out, {});
  state.counters["sites_per_second"] =
      benchmark::Counter(static_cast<double>(out.size()), benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(BM_LevelUpsampling)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime();

}  // namespace
}  // namespace patina::bench
