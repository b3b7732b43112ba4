// The fit as a long job: progress, cancelling, files left behind. On a small capture of the simulated rig.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "devices/simulated/simulated_rig.h"
#include "engine/fourier/fit.h"
#include "engine/image/exr.h"
#include "tests/base/temp_folder.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

/// One capture for all tests of this program; 40 x 40 pixels, eight frequencies held in, one out.
class FitJob : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TempFolder();
    const SimulatedSheet sheet = simulatedScene("laminate");
    SimulatedCaptureOptions options;
    options.samplesPerPixelSide = 1;
    const auto report =
        simulateCapture(folder_->path() / "bundle", SimulatedRig::desk(40, sheet.widthMm, sheet.heightMm),
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
  static inline TempFolder* folder_ = nullptr;
};

/// Keeps what was reported; optionally stops the job at a stage.
class Recorder : public ProgressSink {
 public:
  explicit Recorder(std::string stopAt = "") : stopAt_(std::move(stopAt)) {}
  void progress(std::string_view stage, std::int64_t done, std::int64_t total, std::string_view) override {
    std::scoped_lock lock(mutex_);
    stages.insert(std::string(stage));
    withinTotal &= done >= 0 && done <= total;
    if (stage == stopAt_ && !source.stop_requested()) {
      stoppedAt = Clock::now();
      source.request_stop();
    }
  }
  std::stop_source source;
  std::set<std::string> stages;
  bool withinTotal = true;
  Clock::time_point stoppedAt{};

 private:
  std::mutex mutex_;
  std::string stopAt_;
};

TEST_F(FitJob, ReportsProgressWithinItsTotals) {
  Recorder recorder;
  JobContext job;
  job.progressSink = &recorder;
  const auto fit = fitFourier(capture(), {}, job);
  ASSERT_TRUE(fit.ok()) << fit.error().sentence();
  EXPECT_TRUE(recorder.withinTotal);
  EXPECT_THAT(recorder.stages, testing::IsSupersetOf({"read", "solve", "predict", "holdout"}));
  EXPECT_FALSE((*fit)->stats().cancelled);
  EXPECT_GT((*fit)->stats().peakBytes, 10u << 20);
}

// The engine polls at least every 100 ms; machines that build beside the test get three times that.
constexpr auto kStopWithin = std::chrono::milliseconds(300);

class StopAt : public FitJob, public testing::WithParamInterface<const char*> {};

TEST_P(StopAt, StopsSoonAndKeepsWhatItHas) {
  Recorder recorder(GetParam());
  JobContext job;
  job.progressSink = &recorder;
  job.stop = recorder.source.get_token();
  const auto fit = fitFourier(capture(), {}, job);
  const auto late = Clock::now() - recorder.stoppedAt;
  ASSERT_TRUE(fit.ok()) << fit.error().sentence();
  EXPECT_LT(late, kStopWithin);
  const auto& stats = (*fit)->stats();
  EXPECT_TRUE(stats.cancelled);
  if (std::string(GetParam()) == "solve") {
    EXPECT_GT(stats.statusCounts.at("cancelled"), 0u);
  }
  EXPECT_LT(stats.holdoutRms, 0);  // the error of prediction was not computed to its end
}

INSTANTIATE_TEST_SUITE_P(EveryStage, StopAt, testing::Values("solve", "rescue", "maps", "predict", "holdout"),
                         [](const auto& info) { return std::string(info.param); });

class StopBefore : public FitJob, public testing::WithParamInterface<const char*> {};

TEST_P(StopBefore, AnyTexelIsDoneThereIsNothingToKeep) {
  Recorder recorder(GetParam());
  JobContext job;
  job.progressSink = &recorder;
  job.stop = recorder.source.get_token();
  const auto fit = fitFourier(capture(), {}, job);
  EXPECT_LT(Clock::now() - recorder.stoppedAt, kStopWithin);
  ASSERT_FALSE(fit.ok());
  EXPECT_EQ(fit.error().code, ErrorCode::Cancelled);
}

INSTANTIATE_TEST_SUITE_P(EarlyStages, StopBefore, testing::Values("read", "levels", "upsample"),
                         [](const auto& info) { return std::string(info.param); });

TEST_F(FitJob, ABundleWithBytesThatAreNotUtf8CanBeSaved) {
  const fs::path odd = folder_->path() / "odd-\xff-name";
  fs::copy(folder_->path() / "bundle", odd, fs::copy_options::recursive);
  const auto capture = readFourierCapture(odd);
  ASSERT_TRUE(capture.ok()) << capture.error().sentence();
  const auto fit = fitFourier(*capture, {}, {});
  ASSERT_TRUE(fit.ok());
  EXPECT_TRUE(writeFourierFit(folder_->path() / "odd-fit", **fit).ok());
}

TEST_F(FitJob, StoppedWhileReadingHasNothingToKeep) {
  Recorder recorder("read");
  JobContext job;
  job.progressSink = &recorder;
  job.stop = recorder.source.get_token();
  const auto fit = fitFourier(capture(), {}, job);
  ASSERT_FALSE(fit.ok());
  EXPECT_EQ(fit.error().code, ErrorCode::Cancelled);
  EXPECT_LT(Clock::now() - recorder.stoppedAt, kStopWithin);
}

TEST_F(FitJob, ThreadsDoNotChangeTheResult) {
  JobContext one, all;
  one.threads = 1;
  const auto a = fitFourier(capture(), {}, one), b = fitFourier(capture(), {}, all);
  ASSERT_TRUE(a.ok() && b.ok());
  // sums over photographs are taken in the order in which they arrive: rounding only
  for (std::size_t i = 0; i < (*a)->maps().sigma.samples().size(); ++i)
    ASSERT_NEAR((*a)->maps().sigma.samples()[i] / (*b)->maps().sigma.samples()[i], 1, 1e-2) << i;
}

TEST_F(FitJob, WritesWhatTheContractSaysAndReadsItBack) {
  const auto fit = fitFourier(capture(), {}, {});
  ASSERT_TRUE(fit.ok());
  const fs::path out = folder_->path() / "fit";
  ASSERT_TRUE(writeFourierFit(out, **fit).ok());
  for (const char* map : {"diffuse", "specular", "normal", "sigma", "kurtosis", "residual", "status"})
    EXPECT_TRUE(fs::exists(out / "maps" / (std::string(map) + ".exr"))) << map;
  std::ifstream file(out / "fit.json");
  const auto json = nlohmann::json::parse(file);
  EXPECT_EQ(json["kind"], "fourier");
  for (const char* key :
       {"seconds", "texels", "iterations", "options", "fit_rms", "holdout_rms", "noise_floor"})
    EXPECT_TRUE(json.contains(key)) << key;
  EXPECT_NEAR(json["holdout_rms"].get<double>(), (*fit)->stats().holdoutRms, 1e-12);
  EXPECT_TRUE(json["noise_floor"].is_number());

  const auto loaded = loadFourierFit(out, {});
  ASSERT_TRUE(loaded.ok()) << loaded.error().sentence();
  EXPECT_EQ((*loaded)->maps().width, (*fit)->maps().width);
  EXPECT_EQ((*loaded)->stats().texels, (*fit)->stats().texels);
  const int x = (*fit)->maps().width / 2, y = (*fit)->maps().height / 2;
  EXPECT_NEAR((*loaded)->parametersAt(x, y).sigma / (*fit)->parametersAt(x, y).sigma, 1, 0.2);
  EXPECT_EQ((*loaded)->spectrumAt(x, y).size(), (*fit)->spectrumAt(x, y).size());
}

TEST_F(FitJob, EveryParameterHasAStandardDeviationAsAMap) {
  const auto fit = fitFourier(capture(), {}, {});
  ASSERT_TRUE(fit.ok());
  const fs::path out = folder_->path() / "deviations";
  ASSERT_TRUE(writeFourierFit(out, **fit).ok());
  for (const char* map : {"diffuse_sd", "specular_sd", "normal_sd", "sigma_sd", "kurtosis_sd"})
    EXPECT_TRUE(fs::exists(out / "maps" / (std::string(map) + ".exr"))) << map;
  const SvbrdfMaps& maps = (*fit)->maps();
  int converged = 0;
  for (int y = 0; y < maps.height; ++y) {
    for (int x = 0; x < maps.width; ++x) {
      if (maps.status.at(x, y) != static_cast<float>(TexelStatus::Converged)) continue;
      ++converged;
      for (const float sd : {maps.sigmaSd.at(x, y), maps.kurtosisSd.at(x, y), maps.normalSd.at(x, y)})
        ASSERT_TRUE(sd > 0 && std::isfinite(sd)) << x << " " << y;
      for (int c = 0; c < 3; ++c) {  // an albedo that is held at zero has none
        ASSERT_TRUE(maps.diffuse.pixel(x, y)[c] == 0 || maps.diffuseSd.pixel(x, y)[c] > 0) << x << " " << y;
        ASSERT_TRUE(maps.specular.pixel(x, y)[c] == 0 || maps.specularSd.pixel(x, y)[c] > 0) << x << " " << y;
      }
    }
  }
  EXPECT_GT(converged, 100);
}

TEST_F(FitJob, MapsOfAnySizeCoverTheSheet) {
  for (const int size : {8, 17, 200}) {
    FourierFitOptions options;
    options.size = size;
    const auto fit = fitFourier(capture(), options, {});
    ASSERT_TRUE(fit.ok()) << fit.error().sentence();
    EXPECT_EQ(std::max((*fit)->maps().width, (*fit)->maps().height), size);
    for (int j = 0; j < (*fit)->maps().height; ++j) {
      for (int i = 0; i < (*fit)->maps().width; ++i) {
        ASSERT_GT((*fit)->maps().sigma.at(i, j), 0) << size << ": " << i << ", " << j;
        const auto n = (*fit)->maps().normal.pixel(i, j);
        ASSERT_NEAR(n[0] * n[0] + n[1] * n[1] + n[2] * n[2], 1, 1e-5);
      }
    }
  }
}

TEST_F(FitJob, RefusesOptionsOutOfRange) {
  FourierFitOptions options;
  options.size = -3;
  options.tolerance = 0;
  const auto fit = fitFourier(capture(), options, {});
  ASSERT_FALSE(fit.ok());
  EXPECT_THAT(fit.error().what, testing::AllOf(testing::HasSubstr("size"), testing::HasSubstr("tolerance")));
}

TEST_F(FitJob, SwappedWindowAndBlackAreNamed) {
  auto swapped = capture();
  for (auto& photo : swapped.photos) {
    if (photo.role == PhotoRole::Window)
      photo.role = PhotoRole::Black;
    else if (photo.role == PhotoRole::Black)
      photo.role = PhotoRole::Window;
  }
  const auto fit = fitFourier(swapped, {}, {});
  ASSERT_FALSE(fit.ok());
  EXPECT_THAT(fit.error().what, testing::HasSubstr("not brighter than the black"));
}

TEST_F(FitJob, LoadingNamesWhatIsMissing) {
  EXPECT_EQ(loadFourierFit(folder_->path() / "nowhere", {}).error().code, ErrorCode::NotFound);
  const fs::path broken = folder_->path() / "broken";
  fs::create_directories(broken);
  std::ofstream(broken / "fit.json") << R"({"kind": "fourier"})";
  EXPECT_EQ(loadFourierFit(broken, {}).error().code, ErrorCode::Malformed);
}

}  // namespace
}  // namespace patina::test
