// Fits with something else known to act on the photographs, and what lets a diagnosis look into a fit.
#include "engine/fourier/corrections.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

#include "devices/simulated/simulated_rig.h"
#include "engine/fourier/fit_access.h"
#include "tests/base/temp_folder.h"

namespace patina::test {
namespace {

/// One capture for all tests of this program.
class Corrections : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TempFolder();
    const SimulatedSheet sheet = simulatedScene("laminate");
    SimulatedCaptureOptions options;
    options.samplesPerPixelSide = 1;
    const auto report =
        simulateCapture(folder_->path() / "bundle", SimulatedRig::desk(48, sheet.widthMm, sheet.heightMm),
                        sheet, options, {});
    ASSERT_TRUE(report.ok()) << report.error().sentence();
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }
  static FourierCapture capture() {
    auto read = readFourierCapture(folder_->path() / "bundle");
    EXPECT_TRUE(read.ok());
    return *read;
  }
  static std::shared_ptr<const FourierFit> fitted(const FourierFitOptions& options = {}) {
    const auto fit = fitFourier(capture(), options, {});
    EXPECT_TRUE(fit.ok()) << fit.error().sentence();
    return *fit;
  }
  static inline TempFolder* folder_ = nullptr;
};

void expectSameStores(const MeasurementStore& a, const MeasurementStore& b, float tolerance = 0) {
  ASSERT_EQ(a.siteCount(), b.siteCount());
  ASSERT_EQ(a.frequencyCount(), b.frequencyCount());
  ASSERT_FALSE(a.empty());
  const SiteBlock blockA = a.block(0, a.siteCount()), blockB = b.block(0, b.siteCount());
  for (std::size_t s = 0; s < a.siteCount(); ++s) {
    for (int k = 0; k < 6 * a.frequencyCount(); ++k) {
      ASSERT_NEAR(blockA.z(s)[k], blockB.z(s)[k], tolerance) << s << " " << k;
      ASSERT_NEAR(blockA.even(s)[k], blockB.even(s)[k], tolerance) << s << " " << k;
    }
  }
}

TEST_F(Corrections, AFitCanBeLookedInto) {
  const auto fit = fitted();
  const FourierFitState& state = fitState(*fit);
  const FourierMeasurements& m = state.measurements;
  EXPECT_EQ(state.sites.size(), m.sites.size());
  EXPECT_EQ(m.store.siteCount(), m.sites.size());
  EXPECT_EQ(m.heldOut.frequencyCount(), static_cast<int>(m.plan.heldOut.size()));
  ASSERT_TRUE(state.diffuse);
  const SvbrdfParameters here = fit->parametersAt(20, 30);
  EXPECT_EQ(here.sigma, state.sites[static_cast<std::size_t>(state.siteOfTexel(20, 30))].sigma);

  ASSERT_TRUE(writeFourierFit(folder_->path() / "fit", *fit).ok());
  const auto loaded = loadFourierFit(folder_->path() / "fit", {});
  ASSERT_TRUE(loaded.ok()) << loaded.error().sentence();
  const FourierFitState& again = fitState(**loaded);
  expectSameStores(m.store, again.measurements.store);
  expectSameStores(m.heldOut, again.measurements.heldOut);
  ASSERT_TRUE(again.diffuse);
}

TEST_F(Corrections, SomebodyElsesFitIsRefused) {
  class Other final : public FourierFit {
   public:
    const SvbrdfMaps& maps() const override { return maps_; }
    const FourierFitStats& stats() const override { return stats_; }
    const FourierCapture& capture() const override { return capture_; }
    const FourierFitOptions& options() const override { return options_; }
    SvbrdfParameters parametersAt(int, int) const override { return {}; }
    std::vector<SpectrumSample> spectrumAt(int, int) const override { return {}; }
    std::vector<SpectrumCurvePoint> modelSpectrumAt(int, int, Eigen::Vector2d, double, int) const override {
      return {};
    }
    LobeSlice lobeAt(int, int, bool, int) const override { return {}; }

   private:
    SvbrdfMaps maps_;
    FourierFitStats stats_;
    FourierCapture capture_;
    FourierFitOptions options_;
  };
  EXPECT_THROW(static_cast<void>(fitState(Other())), std::invalid_argument);
}

}  // namespace
}  // namespace patina::test
