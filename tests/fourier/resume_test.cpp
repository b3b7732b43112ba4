// A fit that was cancelled or killed goes on where it was, and ends as if nothing had happened.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <ostream>

#include "devices/simulated/simulated_rig.h"
#include "engine/fourier/finished_tiles.h"
#include "engine/fourier/fit.h"
#include "tests/base/temp_folder.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFolder = "PATINA_RESUME_TEST_FOLDER";

/// A capture made once; a process that is started to be killed is told by the environment where it lies.
class Resume : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    GTEST_FLAG_SET(death_test_style, "threadsafe");
    if (const char* known = std::getenv(kFolder)) {
      root_ = known;
      return;
    }
    folder_ = new TempFolder();
    root_ = folder_->path();
    ::setenv(kFolder, root_.c_str(), 1);
    const SimulatedSheet sheet = simulatedScene("laminate");
    SimulatedCaptureOptions options;
    options.samplesPerPixelSide = 1;
    const auto report = simulateCapture(
        root_ / "bundle", SimulatedRig::desk(80, sheet.widthMm, sheet.heightMm), sheet, options, {});
    ASSERT_TRUE(report.ok()) << report.error().sentence();
  }
  static void TearDownTestSuite() {
    if (folder_) ::unsetenv(kFolder);
    delete folder_;
    folder_ = nullptr;
  }
  static FourierCapture capture() {
    auto read = readFourierCapture(root_ / "bundle");
    EXPECT_TRUE(read.ok());
    return *read;
  }
  static FourierFitStorage storage(const std::string& name) { return {root_ / name, {}}; }

  static std::shared_ptr<const FourierFit> fit(const FourierFitStorage& storage,
                                               const FourierFitOptions& options = {},
                                               const JobContext& job = {}) {
    auto fit = fitFourier(capture(), options, job, storage);
    EXPECT_TRUE(fit.ok()) << fit.error().sentence();
    return fit ? *fit : nullptr;
  }

  static void expectSame(const FourierFit& a, const FourierFit& b) {
    const SvbrdfMaps &x = a.maps(), &y = b.maps();
    for (const auto map :
         {&SvbrdfMaps::diffuse, &SvbrdfMaps::specular, &SvbrdfMaps::normal, &SvbrdfMaps::sigma,
          &SvbrdfMaps::kurtosis, &SvbrdfMaps::residual, &SvbrdfMaps::status})
      EXPECT_TRUE(std::ranges::equal((x.*map).samples(), (y.*map).samples()));
    EXPECT_EQ(a.stats().texels, b.stats().texels);
    EXPECT_EQ(a.stats().holdoutRms, b.stats().holdoutRms);
  }
  static inline TempFolder* folder_ = nullptr;
  static inline fs::path root_;
};

/// Ends the job, or the process, when a stage has come so far.
class EndAt : public ProgressSink {
 public:
  EndAt(std::string stage, double share, bool kill) : stage_(std::move(stage)), share_(share), kill_(kill) {}
  void progress(std::string_view stage, std::int64_t done, std::int64_t total, std::string_view) override {
    if (stage != stage_ || static_cast<double>(done) < share_ * static_cast<double>(total)) return;
    if (kill_) std::raise(SIGKILL);
    source.request_stop();
  }
  std::stop_source source;

 private:
  std::string stage_;
  double share_;
  bool kill_;
};

TEST_F(Resume, ACancelledFitGoesOn) {
  const auto whole = fit({});
  ASSERT_TRUE(whole);
  EXPECT_EQ(whole->stats().resumedTexels, 0u);
  EndAt end("solve", 0.5, false);
  JobContext job;
  job.progressSink = &end;
  job.stop = end.source.get_token();
  const auto kept = storage("cancelled");
  const auto stopped = fit(kept, {}, job);
  ASSERT_TRUE(stopped && stopped->stats().cancelled);
  const auto resumed = fit(kept);
  ASSERT_TRUE(resumed);
  EXPECT_GT(resumed->stats().resumedTexels, resumed->stats().texels / 4);
  EXPECT_LT(resumed->stats().resumedTexels, resumed->stats().texels);
  EXPECT_EQ(resumed->stats().threads, whole->stats().threads);
  expectSame(*resumed, *whole);
  const auto again = fit(kept);  // everything is there by now
  ASSERT_TRUE(again);
  EXPECT_GT(again->stats().resumedTexels, resumed->stats().resumedTexels);
  expectSame(*again, *whole);
  removeUnfinished(kept.keepFolder);
  EXPECT_FALSE(fs::exists(kept.keepFolder));
}

struct Moment {  // when a process ends, and whether anything was finished by then
  const char* name;
  const char* stage;
  double share;
  bool keptSomething;
};
void PrintTo(const Moment& moment, std::ostream* out) {
  *out << moment.name;
}

class Killed : public Resume, public testing::WithParamInterface<Moment> {
 protected:
  /// Fits in a process of its own, which kills itself when `stage` has come so far. The first thing that a
  /// test does: the process runs the test up to here again.
  static void killAt(const char* stage, double share, const FourierFitStorage& kept) {
    EndAt end(stage, share, true);
    JobContext job;
    job.progressSink = &end;
    static_cast<void>(fitFourier(capture(), {}, job, kept));
  }
};

TEST_P(Killed, GoesOnWhereItWas) {
  const auto kept = storage(std::string("killed-") + GetParam().name);
  EXPECT_EXIT(killAt(GetParam().stage, GetParam().share, kept), testing::KilledBySignal(SIGKILL), "");
  const auto resumed = fit(kept), whole = fit({});
  ASSERT_TRUE(resumed && whole);
  if (GetParam().keptSomething) {
    EXPECT_GT(resumed->stats().resumedTexels, 0u);
  } else {
    EXPECT_EQ(resumed->stats().resumedTexels, 0u);
  }
  expectSame(*resumed, *whole);
}

INSTANTIATE_TEST_SUITE_P(AtSeveralMoments, Killed,
                         testing::Values(Moment{"read", "read", 0.5, false},
                                         Moment{"early", "solve", 0.1, true},
                                         Moment{"half", "solve", 0.5, true},
                                         Moment{"late", "solve", 0.95, true},
                                         Moment{"predict", "predict", 0.5, true}),
                         [](const auto& info) { return std::string(info.param.name); });

TEST_F(Resume, AFitThatIsKilledTwiceKeepsBothParts) {
  const auto kept = storage("twice");
  const auto kill = [&](double share) {
    EndAt end("solve", share, true);
    JobContext job;
    job.progressSink = &end;
    static_cast<void>(fitFourier(capture(), {}, job, kept));
  };
  EXPECT_EXIT(kill(0.3), testing::KilledBySignal(SIGKILL), "");
  EXPECT_EXIT(kill(0.8), testing::KilledBySignal(SIGKILL), "");
  const auto resumed = fit(kept), whole = fit({});
  ASSERT_TRUE(resumed && whole);
  EXPECT_GT(resumed->stats().resumedTexels, whole->stats().texels / 2);
  expectSame(*resumed, *whole);
}

TEST_F(Resume, OtherOptionsAndOtherPhotographsStartAfresh) {
  const auto kept = storage("other");
  ASSERT_TRUE(fit(kept));
  EXPECT_GT(fit(kept)->stats().resumedTexels, 0u);
  FourierFitOptions options;
  options.tolerance = 2e-5;
  EXPECT_EQ(fit(kept, options)->stats().resumedTexels, 0u);
  EXPECT_EQ(fit(kept)->stats().resumedTexels, 0u);  // the options' fit replaced what was there
  EXPECT_GT(fit(kept)->stats().resumedTexels, 0u);
  const fs::path photo = root_ / "bundle" / capture().photos[3].file;
  fs::last_write_time(photo, fs::last_write_time(photo) + std::chrono::seconds(2));
  EXPECT_EQ(fit(kept)->stats().resumedTexels, 0u);
}

TEST_F(Resume, AFolderThatCantBeWrittenIsAWarningOnly) {
  std::ofstream(root_ / "file") << "in the way";
  const auto done = fit({root_ / "file" / "kept", {}});
  ASSERT_TRUE(done);
  EXPECT_EQ(done->stats().resumedTexels, 0u);
}

}  // namespace
}  // namespace patina::test
