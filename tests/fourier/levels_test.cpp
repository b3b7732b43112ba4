// The regularised coarse levels, on made-up sheets.
#include "engine/fourier/levels.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <chrono>
#include <mutex>

#include "engine/fourier/levels_data.h"
#include "engine/fourier/levels_optimise.h"
#include "engine/fourier/levels_problem.h"
#include "tests/fourier/made_up_sheet.h"

namespace patina::test {
namespace {

using Vector = LevelProblem::Vector;
using Local = LevelProblem::Local;
constexpr int kUnknowns = LevelProblem::kUnknowns;
constexpr float kNoise = 1e-4f;  // of a zero frequency of about 0.05
constexpr double kSizeMm = 80;

const Eigen::Array3f kBlue(0.05f, 0.1f, 0.2f), kOrange(0.25f, 0.12f, 0.04f);

/// Satin orange on the left, glossy blue on the right.
SvbrdfParameters twoMaterials(double xMm, double) {
  return xMm < 0 ? madeUpMaterial(0.12f, kOrange) : madeUpMaterial(0.05f, kBlue);
}

struct Problem {
  MadeUpSheet sheet;
  SolverSetup setup = sheet.setup();
  LevelData data;
  LevelProblem problem;

  Problem(int sites, int dimension, const SheetAt& at, double holeMm = 0)
      : sheet(sites, kSizeMm, kNoise, at, holeMm),
        data([&] {
          LevelData level = measureLevel(*sheet.state, dimension, dimension, true, {});
          finishScatter(level);
          return level;
        }()),
        problem(*sheet.state, setup, data) {}

  double cost(const std::vector<Vector>& x) const {
    std::vector<Local> local;
    EXPECT_TRUE(problem.evaluate(x, local, {}));
    double sum = problem.couplingCost(x);
    for (const auto& l : local) sum += l.cost;
    return sum;
  }
  /// Plausible values that differ from texel to texel, off every optimum.
  std::vector<Vector> unevenPoint() const {
    std::vector<Vector> x(problem.size());
    std::mt19937 random(3);
    std::uniform_real_distribution<double> part(-1, 1);
    for (auto& v : x) {
      v << std::log(0.08) + 0.2 * part(random), -0.9 + 0.3 * part(random), 0.03 * part(random),
          0.03 * part(random), 0, 0, 0, 0, 0, 0;
      for (int k = 4; k < kUnknowns; ++k) v[k] = (k < 7 ? 0.15 : 0.05) * (1 + 0.3 * part(random));
    }
    return x;
  }
};

TEST(LevelProblem, GradientMatchesDifferencesOfTheCost) {
  const Problem p(12, 6, twoMaterials);
  ASSERT_EQ(p.problem.size(), 36u);
  const std::vector<Vector> x = p.unevenPoint();
  std::vector<Local> local;
  ASSERT_TRUE(p.problem.evaluate(x, local, {}));
  std::vector<Vector> gradient(x.size());
  p.problem.applyCoupling(x, gradient);
  for (std::size_t i = 0; i < x.size(); ++i) gradient[i] += local[i].gradient;
  // Wide enough for the model's single precision, narrow enough for a parabola.
  const double steps[kUnknowns] = {4e-3, 1e-2, 3e-4, 3e-4, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3};
  for (const std::size_t texel : {0u, 7u, 8u, 35u}) {  // corners, and both sides of the border
    double scale = 0;
    for (int k = 0; k < kUnknowns; ++k) scale = std::max(scale, std::abs(gradient[texel][k] * steps[k]));
    for (int k = 0; k < kUnknowns; ++k) {
      std::vector<Vector> up = x, down = x;
      up[texel][k] += steps[k];
      down[texel][k] -= steps[k];
      const double difference = (p.cost(up) - p.cost(down)) / 2;
      // 1 % holds the difference's own error and the quadrature's under the lobe's derivatives
      EXPECT_NEAR(2 * gradient[texel][k] * steps[k], difference, 0.01 * 2 * scale) << texel << ", " << k;
    }
  }
}

TEST(LevelProblem, NormalMatrixIsThatOfTheResiduals) {
  const Problem p(12, 6, twoMaterials);
  const std::vector<Vector> x = p.unevenPoint();
  std::vector<Local> local;
  ASSERT_TRUE(p.problem.evaluate(x, local, {}));
  const std::size_t texel = 14;
  const int count = p.problem.measurementCount();
  std::vector<float> columns(static_cast<std::size_t>(p.problem.rows()) * kModelColumns);
  p.problem.columns(x, texel, 1, columns.data());
  Eigen::VectorXd residual(count);
  Eigen::Matrix<double, Eigen::Dynamic, kUnknowns, Eigen::RowMajor> jacobian(count, kUnknowns);
  p.problem.measurementResiduals(texel, x[texel], columns.data(), residual.data(), jacobian.data());
  EXPECT_NEAR(residual.squaredNorm(), local[texel].dataCost, 1e-4 * local[texel].dataCost);
  Eigen::MatrixXd expected = jacobian.transpose() * jacobian;
  for (int k = 0; k < kUnknowns; ++k) expected(k, k) += std::pow(p.problem.priorWeight(k), 2);
  EXPECT_LT((expected - local[texel].hessian).norm(), 1e-4 * expected.norm());
  // The coupling's residuals are linear: moving from zero, their squares are x' C x.
  std::vector<Vector> product(x.size());
  p.problem.applyCoupling(x, product);
  double quadratic = 0;
  for (std::size_t i = 0; i < x.size(); ++i) quadratic += x[i].dot(product[i]);
  EXPECT_NEAR(quadratic, p.problem.couplingCost(x), 1e-9 * quadratic);
  // ... and a texel's own share of them, and of the diagonal, is what moving it alone changes
  std::vector<Vector> unit(x.size(), Vector::Zero());
  for (int k = 0; k < kUnknowns; ++k) {
    unit[texel] = Vector::Unit(k);
    const double whole = p.problem.couplingCost(unit);
    EXPECT_NEAR(p.problem.couplingBlock(texel)(k, k), whole, 1e-9 * (1 + whole));
    EXPECT_NEAR(p.problem.couplingCostAt(unit, texel, unit[texel]), whole, 1e-9 * (1 + whole));
  }
  Vector moved = x[texel] + Vector::Constant(0.01);
  std::vector<Vector> after = x;
  after[texel] = moved;
  EXPECT_NEAR(p.problem.couplingCostAt(x, texel, moved) - p.problem.couplingCostAt(x, texel, x[texel]),
              p.problem.couplingCost(after) - p.problem.couplingCost(x), 1e-9 * quadratic);
}

TEST(LevelProblem, CurlIsZeroForAHeightFieldAndNotForAVortex) {
  const Problem p(24, 12, twoMaterials);
  std::vector<Vector> relief(p.problem.size(), Vector::Zero()), vortex = relief;
  auto height = [](int i, int j) { return 0.1 * std::sin(0.7 * i) * std::cos(0.4 * j) + 0.01 * i * j; };
  for (std::size_t t = 0; t < p.problem.size(); ++t) {
    const int i = static_cast<int>(p.problem.texels()[t]) % 12,
              j = static_cast<int>(p.problem.texels()[t]) / 12;
    relief[t][2] = -(height(i + 1, j) - height(i, j));
    relief[t][3] = -(height(i, j) - height(i, j + 1));  // rows go down, y goes up
    vortex[t][2] = 0.01 * j;
    vortex[t][3] = 0.01 * i;
  }
  int seen = 0;
  for (std::size_t t = 0; t < p.problem.size(); ++t) {
    if (!p.problem.links()[t].curl()) continue;
    ++seen;
    EXPECT_NEAR(p.problem.curl(relief, t), 0, 1e-12);
    // -Dy nx + Dx ny = 0.01 + 0.01, over App. E's 0.01
    EXPECT_NEAR(p.problem.curl(vortex, t), 2, 1e-12);
  }
  EXPECT_EQ(seen, 11 * 11);
}

TEST(LevelProblem, PriorsRelaxWithTheDimension) {
  auto matte = [](double, double) {
    SvbrdfParameters p = madeUpMaterial(0.1f, kOrange);
    p.specular.setZero();
    return p;
  };
  const Problem coarse(64, 32, matte), fine(64, 64, matte);
  EXPECT_DOUBLE_EQ(coarse.problem.curlWeight(), 100);
  EXPECT_DOUBLE_EQ(fine.problem.curlWeight(), 50);
  EXPECT_FLOAT_EQ(coarse.problem.links()[40].right.weight[0], 1);
  EXPECT_FLOAT_EQ(fine.problem.links()[40].right.weight[0], 0.5);
  // the photograph over its diffuse prediction is flat: the bound, 1 / (2 x 0.005), relaxes alike
  EXPECT_NEAR(coarse.problem.links()[40].right.weight[4], 100, 1);
  EXPECT_NEAR(fine.problem.links()[40].right.weight[4], 50, 1);
}

TEST(LevelProblem, AlbedosMayJumpWhereThePhotographDoes) {
  const Problem p(64, 32, twoMaterials);
  const auto& links = p.problem.links();
  const std::size_t row = 10 * 32;
  // orange to blue: red falls by 0.2, so that a jump of 0.4 costs one
  EXPECT_LT(links[row + 15].right.weight[4], 3);
  EXPECT_GT(links[row + 15].right.weight[4], 1);
  EXPECT_GT(links[row + 8].right.weight[4], 20);
  EXPECT_GT(links[row + 24].right.weight[4], 20);
}

TEST(LevelData, HalvingIsAveragingTheSitesAgain) {
  const MadeUpSheet sheet(32, kSizeMm, kNoise, twoMaterials);
  LevelData fine = measureLevel(*sheet.state, 16, 16, true, {}), halves = halved(fine),
            direct = measureLevel(*sheet.state, 8, 8, true, {});
  finishScatter(halves);
  finishScatter(direct);
  ASSERT_EQ(halves.size(), 64u);
  for (std::size_t i = 0; i < direct.z.size(); ++i) {
    ASSERT_NEAR(halves.z[i], direct.z[i], 1e-6f);
    ASSERT_NEAR(halves.scatter[i], direct.scatter[i], 1e-8f + 1e-3f * direct.scatter[i]);
  }
  EXPECT_EQ(direct.siteCount[5], 16u);
  for (std::size_t t = 0; t < 64; ++t)
    for (int k = 0; k < 2; ++k) EXPECT_NEAR(halves.pointMm[t][k], direct.pointMm[t][k], 1e-4f);
}

TEST(LevelData, ATurnAndItsInverseCancel) {
  const MadeUpSheet sheet(4, kSizeMm, kNoise, twoMaterials);
  const MirrorPhase phase(*sheet.state);
  const SiteRows rows(sheet.state->measurements, 0, 16);
  std::vector<float> turned(32 * 6), back(32 * 6);
  const Eigen::Vector2f point = sheet.state->measurements.sites.pointMm[3];
  phase.turn(point, rows.z(3), turned.data());
  phase.inPlace(point, turned.data(), back.data());
  for (std::size_t i = 0; i < back.size(); ++i) EXPECT_NEAR(back[i], rows.z(3)[i], 1e-6f);
}

// A mirror-like sheet: a texel of a coarse level spans more than a radian of phase at frequency 40.
TEST(LevelData, SharpReflectionsSurviveTheMean) {
  const MadeUpSheet sheet(64, kSizeMm, 0, [](double, double) {
    return madeUpMaterial(0.008f, {0.02f, 0.02f, 0.02f});
  });
  const LevelData level = measureLevel(*sheet.state, 16, 16, false, {});
  const SiteRows rows(sheet.state->measurements, 0, 64 * 64);
  const int f = 28;  // (40, 0)
  ASSERT_EQ(sheet.state->measurements.plan.fitted[f].frequency, Eigen::Vector2i(40, 0));
  std::complex<float> plain = 0;
  float magnitude = 0;
  for (int y = 32; y < 36; ++y) {
    for (int x = 32; x < 36; ++x) {
      const float* z = rows.z(y * 64 + x) + f * 6;
      plain += std::complex<float>(z[0], z[3]) / 16.0f;
      magnitude += std::hypot(z[0], z[3]) / 16;
    }
  }
  const float* mean = level.z.data() + level.index(8, 8) * level.zStride() + f * 6;
  EXPECT_LT(std::abs(plain), 0.8f * magnitude);  // what plain averages would leave
  EXPECT_GT(std::hypot(mean[0], mean[3]), 0.99f * magnitude);
}

TEST(Levels, EndBelowIndependentTexels) {
  const Problem p(64, 32, twoMaterials);
  std::vector<SiteSolution> best(p.problem.size()), found(p.problem.size());
  for (const float sigma : {0.03f, 0.1f, 0.01f}) {
    const std::vector<LobeParameters> start(best.size(), {std::log(sigma), std::log(0.03f), 0, 0});
    solveSites(p.setup, p.problem.sites(), start, found);
    for (std::size_t i = 0; i < best.size(); ++i)
      if (best[i].outcome == SolveOutcome::Failed || found[i].cost < best[i].cost) best[i] = found[i];
  }
  std::vector<Vector> x;
  for (const auto& s : best) {
    x.emplace_back();
    x.back() << s.lobe.logSigma, s.lobe.logKurtosis, s.lobe.slopeX, s.lobe.slopeY, s.diffuse[0], s.diffuse[1],
        s.diffuse[2], s.specular[0], s.specular[1], s.specular[2];
  }
  const auto solution = solveLevels(*p.sheet.state, p.setup, {});
  ASSERT_TRUE(solution.ok()) << solution.error().sentence();
  ASSERT_EQ(solution->reports.size(), 1u);  // 64 sites a side: 32 only
  EXPECT_EQ(solution->reports[0].dimension, 32);
  EXPECT_LT(solution->reports[0].cost, solution->reports[0].startCost);
  EXPECT_LT(solution->reports[0].cost, p.cost(x));
}

TEST(Levels, FindTheMaterials) {
  const MadeUpSheet sheet(160, kSizeMm, kNoise, twoMaterials);
  const auto solution = solveLevels(*sheet.state, sheet.setup(), {});
  ASSERT_TRUE(solution.ok()) << solution.error().sentence();
  ASSERT_EQ(solution->data.width, 128);
  ASSERT_EQ(solution->reports.size(), 3u);
  std::vector<float> sigma[2], diffuse[2];
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x) {
      if (std::abs(x - 64) < 3) continue;  // texels beside the border mix two materials at the first level
      const SiteSolution& s = solution->texels[solution->data.index(x, y)];
      ASSERT_NE(s.outcome, SolveOutcome::Failed);
      sigma[x > 64].push_back(std::exp(s.lobe.logSigma));
      diffuse[x > 64].push_back(s.diffuse[0]);
    }
  }
  auto median = [](std::vector<float>& v) {
    std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
    return v[v.size() / 2];
  };
  // A start, not a result: the 160th that a level's weights allow for leaves its priors some say.
  EXPECT_NEAR(median(sigma[0]), 0.12f, 0.012f);
  EXPECT_NEAR(median(sigma[1]), 0.05f, 0.005f);
  EXPECT_NEAR(median(diffuse[0]), 0.25f, 0.01f);
  EXPECT_NEAR(median(diffuse[1]), 0.05f, 0.01f);
}

TEST(Levels, HolesAndDarkPlacesStayFinite) {
  const MadeUpSheet sheet(
      64, kSizeMm, kNoise,
      [](double x, double y) {
        SvbrdfParameters p = twoMaterials(x, y);
        if (y > 20) p.diffuse.setZero(), p.specular.setZero();
        return p;
      },
      15);
  const auto solution = solveLevels(*sheet.state, sheet.setup(), {});
  ASSERT_TRUE(solution.ok()) << solution.error().sentence();
  std::size_t holes = 0;
  for (std::size_t t = 0; t < solution->texels.size(); ++t) {
    const SiteSolution& s = solution->texels[t];
    if (solution->data.siteCount[t] == 0) {
      ++holes;
      EXPECT_EQ(s.outcome, SolveOutcome::Failed);
      continue;
    }
    EXPECT_NE(s.outcome, SolveOutcome::Failed);
    for (const float value : {s.lobe.logSigma, s.lobe.logKurtosis, s.lobe.slopeX, s.lobe.slopeY, s.cost})
      EXPECT_TRUE(std::isfinite(value));
    for (int c = 0; c < 3; ++c) {
      EXPECT_GE(s.diffuse[c], 0);
      EXPECT_GE(s.specular[c], 0);
      EXPECT_LT(s.diffuse[c] + s.specular[c], 1.5f);
    }
  }
  EXPECT_GE(holes, 25u);
}

TEST(Levels, DroppedRowsDontCount) {
  MadeUpSheet sheet(40, kSizeMm, kNoise, twoMaterials);
  const auto clean = solveLevels(*sheet.state, sheet.setup(), {});
  ASSERT_TRUE(clean.ok());
  // Every site of some texels, and every other site of others, lose frequency (1, 0) to saturation.
  std::vector<std::pair<std::uint32_t, std::uint16_t>> dropped;
  for (std::uint32_t site = 0; site < 1600; ++site) {
    if (site % 40 > 20 && site % 2) continue;
    dropped.emplace_back(site, std::uint16_t{0});
    sheet.state->measurements.store.zInMemory()[site * 192] = 10;
  }
  sheet.state->measurements.store.setDroppedRows(dropped);
  const auto spoilt = solveLevels(*sheet.state, sheet.setup(), {});
  ASSERT_TRUE(spoilt.ok());
  for (std::size_t t = 0; t < clean->texels.size(); ++t) {
    EXPECT_NEAR(spoilt->texels[t].lobe.logSigma, clean->texels[t].lobe.logSigma, 0.15f);
    EXPECT_NEAR(spoilt->texels[t].diffuse[1], clean->texels[t].diffuse[1], 0.02f);
    // a row that no site has is what the model says there, not zero and not the garbage
    const std::size_t at = t * spoilt->data.zStride();
    EXPECT_NEAR(spoilt->data.z[at], clean->data.z[at], 0.2f * std::abs(clean->data.z[at]) + 1e-3f);
  }
}

TEST(Levels, DontDependOnTheThreads) {
  const MadeUpSheet sheet(48, kSizeMm, kNoise, twoMaterials);
  std::vector<LevelSolution> found;
  for (const int threads : {1, 2}) {
    tbb::task_arena arena(threads);
    arena.execute([&] { found.push_back(*solveLevels(*sheet.state, sheet.setup(), {})); });
  }
  for (std::size_t t = 0; t < found[0].texels.size(); ++t) {
    EXPECT_EQ(found[0].texels[t].lobe.logSigma, found[1].texels[t].lobe.logSigma);
    EXPECT_EQ(found[0].texels[t].specular[2], found[1].texels[t].specular[2]);
  }
}

class StopAfterFirst : public ProgressSink {
 public:
  void progress(std::string_view stage, std::int64_t done, std::int64_t total, std::string_view) override {
    EXPECT_LE(done, total);
    if (stage != "levels" || source.stop_requested()) return;
    stoppedAt = std::chrono::steady_clock::now();
    source.request_stop();
  }
  std::stop_source source;
  std::chrono::steady_clock::time_point stoppedAt{};
};

// The engine polls at least every 100 ms; machines that build beside the test get three times that.
constexpr auto kStopWithin = std::chrono::milliseconds(300);

TEST(Levels, StopSoonAndKeepTheFinishedLevel) {
  const MadeUpSheet sheet(160, kSizeMm, kNoise, twoMaterials);
  StopAfterFirst sink;
  JobContext job;
  job.progressSink = &sink;
  job.stop = sink.source.get_token();
  const auto solution = solveLevels(*sheet.state, sheet.setup(), job);
  EXPECT_LT(std::chrono::steady_clock::now() - sink.stoppedAt, kStopWithin);
  ASSERT_TRUE(solution.ok());
  EXPECT_EQ(solution->data.width, 32);
  EXPECT_EQ(solution->reports.size(), 1u);

  const auto nothing = solveLevels(*sheet.state, sheet.setup(), job);  // stopped before it began
  ASSERT_FALSE(nothing.ok());
  EXPECT_EQ(nothing.error().code, ErrorCode::Cancelled);
}

TEST(Levels, BytesAreWhatTheArraysTake) {
  const MadeUpSheet sheet(12, kSizeMm, kNoise, twoMaterials);
  const auto bytes = [](const auto&... arrays) { return (... + (arrays.size() * sizeof(*arrays.data()))); };
  for (const bool withScatter : {false, true}) {
    const LevelData l = measureLevel(*sheet.state, 6, 5, withScatter, {});
    EXPECT_EQ(bytes(l.siteCount, l.pointMm, l.z, l.rowCount, l.dc, l.siteVariance, l.siteDcVariance,
                    l.scatter, l.dcScatter),
              levelBytes(l.size(), l.frequencyCount, withScatter));
  }
}

}  // namespace
}  // namespace patina::test
