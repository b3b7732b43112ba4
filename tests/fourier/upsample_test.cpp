// Section 7.2's upsampling, and the paper's whole schedule, on made-up sheets.
#include "engine/fourier/upsample.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <chrono>
#include <random>

#include "engine/fourier/levels_data.h"
#include "engine/fourier/upsample_window.h"
#include "tests/fourier/made_up_sheet.h"

namespace patina::test {
namespace {

constexpr float kNoise = 1e-4f;
constexpr double kSizeMm = 80;
const Eigen::Array3f kBlue(0.05f, 0.1f, 0.2f), kOrange(0.25f, 0.12f, 0.04f);

SvbrdfParameters twoMaterials(double xMm, double) {
  return xMm < 0 ? madeUpMaterial(0.12f, kOrange) : madeUpMaterial(0.05f, kBlue);
}

/// A window of random columns and its Gram matrix with a small ridge, as `Window` makes it.
struct RandomWindow {
  static constexpr int kDimensions = 40;
  std::vector<float> columns = std::vector<float>(kDimensions * kWindowStride, 0.0f);
  std::vector<float> gram = std::vector<float>(kWindowStride * kWindowStride);

  explicit RandomWindow(unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<float> normal;
    for (int d = 0; d < kDimensions; ++d)
      for (int k = 0; k < kWindowTexels; ++k) columns[d * kWindowStride + k] = 1 + normal(random);
  }
};

TEST(UpsampleWindow, ProductsAreThoseOfPlainLoopsOnEveryTarget) {
  RandomWindow window(1);
  std::vector<float> vector(RandomWindow::kDimensions), out(kWindowStride);
  for (int d = 0; d < RandomWindow::kDimensions; ++d) vector[d] = std::sin(static_cast<float>(d));
  int count = 0;
  for (const auto target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    ++count;
    windowGram(window.columns.data(), RandomWindow::kDimensions, window.gram.data());
    windowProject(window.columns.data(), RandomWindow::kDimensions, vector.data(), out.data());
    for (int i = 0; i < kWindowStride; ++i) {
      double projected = 0;
      for (int d = 0; d < RandomWindow::kDimensions; ++d)
        projected += window.columns[d * kWindowStride + i] * vector[d];
      EXPECT_NEAR(out[i], projected, 1e-4);
      for (int j = 0; j < kWindowStride; ++j) {
        double product = 0;
        for (int d = 0; d < RandomWindow::kDimensions; ++d)
          product += window.columns[d * kWindowStride + i] * window.columns[d * kWindowStride + j];
        EXPECT_NEAR(window.gram[i * kWindowStride + j], product, 1e-3);
      }
    }
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  EXPECT_GE(count, 1);
}

// Karush, Kuhn, Tucker: weights are positive with no slope left, or zero with the slope against them.
TEST(UpsampleWindow, WeightsAreOptimalAndNonNegative) {
  std::mt19937 random(2);
  std::normal_distribution<float> normal;
  std::uniform_real_distribution<float> part(0, 1);
  int zeros = 0;
  for (unsigned seed = 0; seed < 200; ++seed) {
    RandomWindow window(seed);
    windowGram(window.columns.data(), RandomWindow::kDimensions, window.gram.data());
    std::vector<float> b(kWindowTexels);
    for (auto& value : b) value = 30 * (0.3f + normal(random));
    float weight[kWindowStride] = {};
    for (int k = 0; k < kWindowTexels; ++k) weight[k] = seed % 2 ? part(random) : 0;
    ASSERT_TRUE(nonNegativeWeights(window.gram.data(), b.data(), 0, weight)) << seed;
    for (int k = 0; k < kWindowTexels; ++k) {
      double slope = b[k];
      for (int j = 0; j < kWindowTexels; ++j) slope -= window.gram[k * kWindowStride + j] * weight[j];
      ASSERT_GE(weight[k], 0);
      zeros += weight[k] == 0;
      if (weight[k] > 0) {
        ASSERT_NEAR(slope, 0, 0.02) << seed << ", " << k;
      } else {
        ASSERT_LT(slope, 0.02) << seed << ", " << k;
      }
    }
  }
  EXPECT_GT(zeros, 200 * 5);  // the constraint was at work
}

TEST(UpsampleWindow, WeightsThatExplainNothingMoreStayWhereTheyAre) {
  std::vector<float> gram(kWindowStride * kWindowStride, 0.0f), b(kWindowTexels, 1.0f);
  for (int k = 0; k < kWindowTexels; ++k) gram[k * kWindowStride + k] = 1;
  float weight[kWindowStride] = {};
  weight[12] = 0.5f;
  EXPECT_TRUE(nonNegativeWeights(gram.data(), b.data(), 1.5f, weight));
  for (int k = 0; k < kWindowTexels; ++k) EXPECT_FLOAT_EQ(weight[k], k == 12 ? 1 : 0);
  EXPECT_TRUE(nonNegativeWeights(gram.data(), b.data(), 0.5f, weight));
  for (int k = 0; k < kWindowTexels; ++k) EXPECT_FLOAT_EQ(weight[k], 1);
}

/// A low grid over a made-up sheet whose texels carry the sheet's own parameters.
LevelSolution knownLevel(const MadeUpSheet& sheet, int dimension, const SheetAt& at) {
  LevelSolution low;
  low.data = measureLevel(*sheet.state, dimension, dimension, false, {});
  low.texels.resize(low.data.size());
  for (std::size_t t = 0; t < low.data.size(); ++t) {
    const SvbrdfParameters p = at(low.data.pointMm[t].x(), low.data.pointMm[t].y());
    SiteSolution& s = low.texels[t];
    s.lobe = {std::log(p.sigma), std::log(p.kurtosis - 1), p.normal.x() / p.normal.z(),
              p.normal.y() / p.normal.z()};
    for (int c = 0; c < 3; ++c) s.diffuse[c] = p.diffuse[c], s.specular[c] = p.specular[c];
    s.outcome = low.data.siteCount[t] > 0 ? SolveOutcome::Converged : SolveOutcome::Failed;
  }
  return low;
}

/// A material of its own for every texel of a 10 x 10 grid.
SvbrdfParameters patchwork(double xMm, double yMm) {
  const int i = static_cast<int>(xMm / 8 + 5), j = static_cast<int>(yMm / 8 + 5);
  SvbrdfParameters p = madeUpMaterial(0.04f + 0.012f * static_cast<float>((3 * i + 7 * j) % 10), kOrange);
  p.diffuse *= 0.5f + 0.1f * static_cast<float>((7 * i + 3 * j) % 10);
  return p;
}

TEST(Upsample, ReproducesASiteThatIsLikeOneTexel) {
  const MadeUpSheet sheet(10, kSizeMm, kNoise, patchwork);
  const LevelSolution low = knownLevel(sheet, 10, patchwork);
  // Every site is one texel of the grid: its own explains it, and none of the 24 around it may.
  std::vector<SiteSolution> out(100);
  upsampleToSites(*sheet.state, low, out, {});
  // Twice removed: a site with the measurements of the texel two to the right.
  LevelData high = low.data;
  const std::size_t stride = high.zStride(), here = high.index(4, 5), there = high.index(6, 5);
  std::copy_n(low.data.z.data() + there * stride, stride, high.z.data() + here * stride);
  std::copy_n(low.data.dc.data() + there * 3, 3, high.dc.data() + here * 3);
  std::vector<SiteSolution> moved(100);
  upsampleToLevel(*sheet.state, low, high, moved, {});
  // The pull towards bilinear weights and the soft sum leave a thousandth.
  constexpr float kPull = 2e-3f;
  auto expectLike = [&](const SiteSolution& got, const SiteSolution& wanted) {
    EXPECT_NEAR(got.lobe.logSigma, wanted.lobe.logSigma, 2 * kPull);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(got.diffuse[c], wanted.diffuse[c], kPull);
    EXPECT_EQ(got.outcome, SolveOutcome::Converged);
  };
  for (std::size_t s = 0; s < 100; ++s) {
    SCOPED_TRACE(s);
    expectLike(out[s], low.texels[texelOf(low.data, sheet.state->measurements.sites.pointMm[s])]);
  }
  expectLike(moved[here], low.texels[there]);
}

TEST(Upsample, KeepsAnEdge) {
  // The border runs through the middle of a column of low texels: those mix both materials.
  auto border = [](double x, double y) { return twoMaterials(x - 1.25, y); };
  const MadeUpSheet sheet(128, kSizeMm, kNoise, border);
  LevelSolution low = knownLevel(sheet, 32, border);
  for (int y = 0; y < 32; ++y) {  // a mixed texel's solution is neither
    SiteSolution& s = low.texels[low.data.index(16, y)];
    s.lobe.logSigma = std::log(0.08f);
    for (int c = 0; c < 3; ++c) s.diffuse[c] = (kBlue[c] + kOrange[c]) / 2;
  }
  std::vector<SiteSolution> out(sheet.state->measurements.sites.size());
  upsampleToSites(*sheet.state, low, out, {});
  for (int y = 10; y < 118; ++y) {
    for (int x = 58; x < 72; ++x) {
      const Eigen::Vector2f p = sheet.state->measurements.sites.pointMm[y * 128 + x];
      const SvbrdfParameters truth = border(p.x(), p.y());
      const SiteSolution& s = out[y * 128 + x];
      ASSERT_NEAR(std::exp(s.lobe.logSigma), truth.sigma, 0.1f * truth.sigma) << x << ", " << y;
      ASSERT_NEAR(s.diffuse[0], truth.diffuse[0], 0.02f) << x << ", " << y;
    }
  }
}

TEST(Upsample, IsBilinearWhereTheDataCannotChoose) {
  auto plain = [](double, double) { return madeUpMaterial(0.1f, kOrange); };
  const MadeUpSheet sheet(64, kSizeMm, kNoise, plain);
  LevelSolution low = knownLevel(sheet, 16, plain);
  for (std::size_t t = 0; t < low.texels.size(); ++t)
    low.texels[t].lobe.slopeX = 0.01f * static_cast<float>(t % 16);  // nothing in the data says so
  std::vector<SiteSolution> out(64 * 64);
  upsampleToSites(*sheet.state, low, out, {});
  double square = 0;
  int count = 0;
  for (int y = 8; y < 56; ++y) {
    for (int x = 8; x < 56; ++x) {
      const float ramp = 0.01f * ((static_cast<float>(x) + 0.5f) / 4 - 0.5f);
      const float gap = out[y * 64 + x].lobe.slopeX - ramp;
      square += gap * gap;
      ++count;
    }
  }
  EXPECT_LT(std::sqrt(square / count), 0.002);  // a fifth of a texel; nearest neighbours would have 0.0028
}

TEST(Upsample, AShadeOfAMaterialScalesItsAlbedos) {
  // Texture finer than the grid: brighter than every texel around it.
  auto speckled = [](double x, double y) {
    SvbrdfParameters p = madeUpMaterial(0.1f, kOrange);
    if (std::abs(x - 0.625) < 0.3 && std::abs(y - 0.625) < 0.3) p.diffuse *= 1.4f, p.specular *= 1.4f;
    return p;
  };
  const MadeUpSheet sheet(64, kSizeMm, kNoise, speckled);
  const LevelSolution low =
      knownLevel(sheet, 16, [](double, double) { return madeUpMaterial(0.1f, kOrange); });
  std::vector<SiteSolution> out(64 * 64);
  upsampleToSites(*sheet.state, low, out, {});
  const SiteSolution& s = out[31 * 64 + 32];
  // The soft sum holds back a tenth of the excess, and the speckle is a sixteenth of its own texel's mean.
  EXPECT_GT(s.diffuse[0], 1.3f * kOrange[0]);
  EXPECT_LT(s.diffuse[0], 1.4f * kOrange[0]);
  EXPECT_NEAR(std::exp(s.lobe.logSigma), 0.1f, 1e-4f);
}

TEST(Upsample, DroppedRowsDontCount) {
  MadeUpSheet sheet(48, kSizeMm, kNoise, twoMaterials);
  const LevelSolution low = knownLevel(sheet, 12, twoMaterials);
  std::vector<SiteSolution> clean(48 * 48), spoilt(48 * 48);
  upsampleToSites(*sheet.state, low, clean, {});
  const std::uint32_t site = 24 * 48 + 10;
  float* z = sheet.state->measurements.store.zInMemory() + site * 192;
  for (int c = 0; c < 3; ++c) z[4 * 6 + c] = 10;
  sheet.state->measurements.store.setDroppedRows({{site, std::uint16_t{8}}});
  upsampleToSites(*sheet.state, low, spoilt, {});
  EXPECT_NEAR(spoilt[site].diffuse[0], clean[site].diffuse[0], 0.005f);
  EXPECT_NEAR(spoilt[site].lobe.logSigma, clean[site].lobe.logSigma, 0.05f);
}

TEST(Upsample, HolesAndDarkPlacesStayFinite) {
  auto dark = [](double x, double y) {
    SvbrdfParameters p = twoMaterials(x, y);
    if (y > 15) p.diffuse.setZero(), p.specular.setZero();
    return p;
  };
  const MadeUpSheet sheet(48, kSizeMm, kNoise, dark, 21);
  const LevelSolution low = knownLevel(sheet, 12, dark);
  ASSERT_GT(std::ranges::count(low.data.siteCount, 0u), 3);
  std::vector<SiteSolution> out(sheet.state->measurements.sites.size());
  upsampleToSites(*sheet.state, low, out, {});
  for (const auto& s : out) {
    ASSERT_EQ(s.outcome, SolveOutcome::Converged);
    for (const float value : {s.lobe.logSigma, s.lobe.logKurtosis, s.lobe.slopeX, s.lobe.slopeY})
      ASSERT_TRUE(std::isfinite(value));
    for (int c = 0; c < 3; ++c) {
      ASSERT_GE(s.diffuse[c], 0);
      ASSERT_LT(s.diffuse[c], 0.5f);
    }
  }
}

TEST(PaperSchedule, FillsEverySiteNearTheTruth) {
  const MadeUpSheet sheet(80, kSizeMm, kNoise, twoMaterials);
  std::vector<SiteSolution> out(sheet.state->measurements.sites.size());
  const auto done = paperSchedule(*sheet.state, sheet.setup(), out, {});
  ASSERT_TRUE(done.ok()) << done.error().sentence();
  std::vector<float> sigmaError, diffuseError, cost;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Eigen::Vector2f p = sheet.state->measurements.sites.pointMm[i];
    const SvbrdfParameters truth = twoMaterials(p.x(), p.y());
    ASSERT_NE(out[i].outcome, SolveOutcome::Failed);
    sigmaError.push_back(std::abs(out[i].lobe.logSigma - std::log(truth.sigma)));
    diffuseError.push_back(std::abs(out[i].diffuse[0] - truth.diffuse[0]));
    cost.push_back(out[i].dataCost);
  }
  auto median = [](std::vector<float>& v) {
    std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
    return v[v.size() / 2];
  };
  EXPECT_LT(median(sigmaError), 0.03f);
  EXPECT_LT(median(diffuseError), 0.004f);
  // 195 measurements a site; a perfect model has 195 +- 20 under this noise
  EXPECT_GT(median(cost), 150);
  EXPECT_LT(median(cost), 300);
}

class StopAtUpsample : public ProgressSink {
 public:
  void progress(std::string_view stage, std::int64_t, std::int64_t, std::string_view) override {
    if (stage != "upsample" || source.stop_requested()) return;
    stoppedAt = std::chrono::steady_clock::now();
    source.request_stop();
  }
  std::stop_source source;
  std::chrono::steady_clock::time_point stoppedAt{};
};

TEST(PaperSchedule, StopsSoonWhileUpsampling) {
  const MadeUpSheet sheet(160, kSizeMm, kNoise, twoMaterials);
  StopAtUpsample sink;
  JobContext job;
  job.progressSink = &sink;
  job.stop = sink.source.get_token();
  std::vector<SiteSolution> out(sheet.state->measurements.sites.size());
  const auto done = paperSchedule(*sheet.state, sheet.setup(), out, job);
  EXPECT_TRUE(done.ok());
  // polled at least every 100 ms; machines that build beside the test get three times that
  EXPECT_LT(std::chrono::steady_clock::now() - sink.stoppedAt, std::chrono::milliseconds(300));
  const auto failed = std::ranges::count(out, SolveOutcome::Failed, &SiteSolution::outcome);
  EXPECT_GT(failed, 0);  // never reached
  EXPECT_LT(failed, static_cast<std::ptrdiff_t>(out.size()));
}

}  // namespace
}  // namespace patina::test
