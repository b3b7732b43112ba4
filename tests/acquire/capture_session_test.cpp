#include "engine/acquire/capture_session.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <filesystem>
#include <map>
#include <thread>

#include "engine/acquire/exposure.h"
#include "engine/capture/capture.h"
#include "engine/image/exr.h"
#include "tests/acquire/live_session.h"
#include "tests/base/temp_folder.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using test::Doing;
using test::LiveSession;
using test::smallCapture;
using test::TempFolder;

constexpr int kPixels = 24;

/// Content of every photograph and of the description.
std::map<std::string, std::string> contentOf(const fs::path& bundle) {
  std::map<std::string, std::string> content;
  for (const auto& entry : fs::recursive_directory_iterator(bundle))
    if (entry.is_regular_file() && entry.path().filename() != "journal.jsonl")
      content[entry.path().lexically_relative(bundle).string()] = test::readText(entry.path());
  return content;
}

CaptureSession::Outcome capture(LiveSession& live, const fs::path& folder, const CaptureOptions& options,
                                bool resume = false, CaptureObserver* observer = nullptr,
                                const JobContext& job = {}) {
  auto session = CaptureSession::open(folder, live.rig->description(), options, resume);
  EXPECT_TRUE(session.ok()) << session.error().sentence();
  auto outcome = (*session)->run(*live.camera, *live.display, job, observer);
  EXPECT_TRUE(outcome.ok()) << outcome.error().sentence();
  return outcome.ok() ? *outcome : CaptureSession::Outcome{};
}

TEST(CaptureSession, WritesABundleThatReadersAcceptAndWhosePixelsAreRadiance) {
  const TempFolder folder;
  LiveRigSetup setup = LiveRig::desk("laminate", kPixels);
  setup.noise = {0, 0};
  setup.ambient = 0;
  LiveSession live(setup);
  const auto outcome = capture(live, folder / "bundle", smallCapture());
  EXPECT_TRUE(outcome.complete);
  EXPECT_EQ(outcome.flawed, 0);
  EXPECT_EQ(outcome.taken, 4 * 4 + 3);
  const Result<FourierCapture> bundle = readFourierCapture(folder / "bundle");
  ASSERT_TRUE(bundle.ok()) << bundle.error().sentence();
  EXPECT_EQ(bundle->photos.size(), 19u);
  EXPECT_EQ(bundle->madeBy, "patina capture");
  EXPECT_GT(bundle->saturation, 0);
  int heldOut = 0;
  for (const FourierPhoto& photo : bundle->photos) {
    heldOut += photo.holdout;
    // Whole refresh periods.
    const double periods = photo.exposureS * setup.refreshHz;
    EXPECT_NEAR(periods, std::round(periods), 1e-6);
    const Result<Image> image = readPhoto(*bundle, photo);
    ASSERT_TRUE(image.ok()) << image.error().sentence();
    // The scene itself, without any camera.
    LiveSceneSetup sceneSetup;
    sceneSetup.camera = setup.camera;
    sceneSetup.screen = setup.screen;
    sceneSetup.sheet = setup.sheet;
    static const Result<LiveScene> scene = LiveScene::create(sceneSetup, {});
    ASSERT_TRUE(scene.ok());
    const Image truth = scene->radiance(patternImage(patternOf(photo), setup.screen));
    double difference = 0, level = 0;
    for (std::size_t i = 0; i < truth.samples().size(); ++i) {
      difference += std::pow(truth.samples()[i] - image->samples()[i], 2);
      level += std::pow(truth.samples()[i], 2);
    }
    // Half floats are good to 5e-4, dithered patterns of 960 pixels to 1e-3.
    EXPECT_LT(std::sqrt(difference), 2e-3 * std::sqrt(level) + 1e-4) << patternName(patternOf(photo));
  }
  EXPECT_EQ(heldOut, 4 + 1);
}

TEST(CaptureSession, HidesNothingOfTheChecklist) {
  const TempFolder folder;
  LiveSession live(LiveRig::desk("laminate", kPixels));
  Doing observer([](int, const PhotoState&, bool) {});
  capture(live, folder / "bundle", smallCapture(), false, &observer);
  EXPECT_TRUE(observer.checklist.good());
  EXPECT_EQ(observer.checklist.items.size(), 9u);
}

TEST(CaptureSession, CancelledKeepsWhatIsFinishedAndGoesOnToTheSameBundle) {
  const TempFolder folder;
  const LiveRigSetup setup = LiveRig::desk("laminate", kPixels);
  {
    LiveSession whole(setup);
    EXPECT_TRUE(capture(whole, folder / "whole", smallCapture()).complete);
  }
  for (const int after : {0, 1, 3, 9, 17}) {
    const fs::path bundle = folder / ("bundle" + std::to_string(after));
    LiveSession live(setup);
    std::stop_source stop;
    JobContext job;
    job.stop = stop.get_token();
    Doing canceller([&](int photo, const PhotoState&, bool kept) {
      if (kept && photo == after) stop.request_stop();
    });
    const auto first = capture(live, bundle, smallCapture(), false, &canceller, job);
    EXPECT_TRUE(first.cancelled);
    EXPECT_FALSE(first.complete);
    EXPECT_EQ(first.taken, after + 1);
    if (after >= 1) {
      const Result<FourierCapture> partial = readFourierCapture(bundle);
      ASSERT_TRUE(partial.ok()) << partial.error().sentence();
      // Window and black, and frequencies with all their phases.
      EXPECT_EQ(static_cast<int>(partial->photos.size()), 2 + (after - 1) / 4 * 4);
    } else {
      EXPECT_FALSE(fs::exists(bundle / "capture.json"));
    }
    LiveSession again(setup);
    int anew = 0;
    Doing counter([&](int, const PhotoState&, bool kept) { anew += kept; });
    EXPECT_TRUE(capture(again, bundle, smallCapture(), true, &counter).complete);
    EXPECT_EQ(anew, 19 - (after + 1));
    EXPECT_EQ(contentOf(bundle), contentOf(folder / "whole"));
  }
}

TEST(CaptureSession, RefusesAFolderInUseAnotherPlanAndAnotherRig) {
  const TempFolder folder;
  const LiveRigSetup setup = LiveRig::desk("laminate", kPixels);
  LiveSession live(setup);
  const RigDescription rig = live.rig->description();
  capture(live, folder / "bundle", smallCapture());
  EXPECT_EQ(CaptureSession::open(folder / "bundle", rig, smallCapture(), false).error().code,
            ErrorCode::Refused);
  CaptureOptions other = smallCapture();
  other.plan.fitted.pop_back();
  EXPECT_EQ(CaptureSession::open(folder / "bundle", rig, other, true).error().code, ErrorCode::Refused);
  RigDescription moved = rig;
  moved.camera.translationMm.x() += 1;
  EXPECT_EQ(CaptureSession::open(folder / "bundle", moved, smallCapture(), true).error().code,
            ErrorCode::Refused);
  EXPECT_TRUE(CaptureSession::open(folder / "bundle", rig, smallCapture(), true).ok());
  test::writeText(folder / "note.txt", "mine");
  EXPECT_EQ(CaptureSession::open(folder.path(), rig, smallCapture(), true).error().code, ErrorCode::Refused);
  RigDescription nothing;
  EXPECT_EQ(CaptureSession::open(folder / "new", nothing, smallCapture(), false).error().code,
            ErrorCode::Invalid);
}

TEST(CaptureSession, APhotographWhoseFileWasHarmedIsTakenAgain) {
  const TempFolder folder;
  const LiveRigSetup setup = LiveRig::desk("laminate", kPixels);
  LiveSession live(setup);
  capture(live, folder / "bundle", smallCapture());
  const auto before = contentOf(folder / "bundle");
  fs::remove(folder / "bundle" / "photos" / "photo_004.exr");
  test::writeText(folder / "bundle" / "photos" / ".photo_005.exr.partial-12-34-5",
                  "what a killed process leaves");
  std::string bytes = test::readText(folder / "bundle" / "photos" / "photo_007.exr");
  bytes[bytes.size() / 2] ^= 1;
  test::writeText(folder / "bundle" / "photos" / "photo_007.exr", bytes);
  std::vector<int> anew;
  Doing counter([&](int photo, const PhotoState&, bool kept) {
    if (kept) anew.push_back(photo);
  });
  const auto outcome = capture(live, folder / "bundle", smallCapture(), true, &counter);
  EXPECT_EQ(anew, (std::vector<int>{4, 7}));
  EXPECT_EQ(contentOf(folder / "bundle"), before);
  ASSERT_FALSE(outcome.remarks.empty());
  EXPECT_NE(outcome.remarks[0].find("2 photographs"), std::string::npos);
}

TEST(CaptureSession, RetakesOnePhotographIntoANewFileAndTheOldOneCountsUntilThen) {
  const TempFolder folder;
  const LiveRigSetup setup = LiveRig::desk("laminate", kPixels);
  LiveSession live(setup);
  auto session = CaptureSession::open(folder / "bundle", live.rig->description(), smallCapture(), false);
  ASSERT_TRUE(session.ok());
  ASSERT_TRUE((*session)->run(*live.camera, *live.display, {}).ok());
  ASSERT_TRUE((*session)->retake(5).ok());
  EXPECT_FALSE((*session)->retake(100).ok());
  EXPECT_EQ((*session)->taken(), 19);
  // Asked for, and then the power goes: the wish is in the journal.
  auto resumed = CaptureSession::open(folder / "bundle", live.rig->description(), smallCapture(), true);
  ASSERT_TRUE(resumed.ok());
  EXPECT_EQ((*resumed)->taken(), 19);
  std::vector<int> anew;
  Doing counter([&](int photo, const PhotoState&, bool kept) {
    if (kept) anew.push_back(photo);
  });
  ASSERT_TRUE((*resumed)->run(*live.camera, *live.display, {}, &counter).ok());
  EXPECT_EQ(anew, std::vector<int>{5});
  EXPECT_FALSE(fs::exists(folder / "bundle" / "photos" / "photo_005.exr"));
  const Result<FourierCapture> bundle = readFourierCapture(folder / "bundle");
  ASSERT_TRUE(bundle.ok());
  EXPECT_EQ(bundle->photos[5].file, "photos/photo_005_r1.exr");
  EXPECT_TRUE(readPhoto(*bundle, bundle->photos[5]).ok());
}

TEST(CaptureSession, PauseHoldsAndResumes) {
  const TempFolder folder;
  LiveSession live(LiveRig::desk("laminate", kPixels));
  auto session = CaptureSession::open(folder / "bundle", live.rig->description(), smallCapture(), false);
  ASSERT_TRUE(session.ok());
  CaptureSession& capturing = **session;
  std::mutex mutex;
  std::condition_variable changed;
  bool held = false;
  class Pausing : public CaptureObserver {
   public:
    std::function<void(bool)> then;
    std::function<void(int)> taken;
    void paused(bool isPaused) override { then(isPaused); }
    void photographed(int photo, const Image&, const PhotoState&, bool) override { taken(photo); }
  } observer;
  observer.taken = [&](int photo) {
    if (photo == 3) capturing.pause(true);
  };
  observer.then = [&](bool isPaused) {
    const std::lock_guard lock(mutex);
    held = isPaused;
    changed.notify_all();
  };
  std::jthread running([&] { EXPECT_TRUE(capturing.run(*live.camera, *live.display, {}, &observer).ok()); });
  {
    std::unique_lock lock(mutex);
    ASSERT_TRUE(changed.wait_for(lock, std::chrono::seconds(30), [&] { return held; }));
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(capturing.taken(), 4);
  EXPECT_TRUE(capturing.isPaused());
  capturing.pause(false);
  running.join();
  EXPECT_EQ(capturing.taken(), 19);
}

TEST(CaptureSession, APausedCaptureCanBeCancelled) {
  const TempFolder folder;
  LiveSession live(LiveRig::desk("laminate", kPixels));
  auto session = CaptureSession::open(folder / "bundle", live.rig->description(), smallCapture(), false);
  ASSERT_TRUE(session.ok());
  (*session)->pause(true);
  std::stop_source stop;
  JobContext job;
  job.stop = stop.get_token();
  std::jthread stopper([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    stop.request_stop();
  });
  const auto outcome = (*session)->run(*live.camera, *live.display, job);
  ASSERT_TRUE(outcome.ok());
  EXPECT_TRUE(outcome->cancelled);
}

TEST(CaptureSession, AnUnpluggedCameraLosesNothingAndAnotherGoesOn) {
  const TempFolder folder;
  const LiveRigSetup setup = LiveRig::desk("laminate", kPixels);
  LiveSession live(setup);
  auto session = CaptureSession::open(folder / "bundle", live.rig->description(), smallCapture(), false);
  ASSERT_TRUE(session.ok());
  Doing puller([&](int photo, const PhotoState&, bool) {
    if (photo == 8) live.rig->unplug();
  });
  const auto failed = (*session)->run(*live.camera, *live.display, {}, &puller);
  ASSERT_FALSE(failed.ok());
  EXPECT_EQ(failed.error().code, ErrorCode::NotFound);
  EXPECT_NE(failed.error().what.find("unplugged"), std::string::npos);
  EXPECT_FALSE(failed.error().tryThis.empty());
  EXPECT_EQ((*session)->taken(), 9);
  live.camera.reset();
  live.rig->plugIn();
  live.camera = live.rig->openCamera().value();
  const auto outcome = (*session)->run(*live.camera, *live.display, {});
  ASSERT_TRUE(outcome.ok()) << outcome.error().sentence();
  EXPECT_TRUE(outcome->complete);
  LiveSession other(setup);
  capture(other, folder / "undisturbed", smallCapture());
  EXPECT_EQ(contentOf(folder / "bundle"), contentOf(folder / "undisturbed"));
}

TEST(CaptureSession, AFrameThatNeverComesIsASentenceAndAWayOn) {
  const TempFolder folder;
  LiveSession live(LiveRig::desk("laminate", kPixels));
  auto session = CaptureSession::open(folder / "bundle", live.rig->description(), smallCapture(), false);
  ASSERT_TRUE(session.ok());
  Doing freezer([&](int photo, const PhotoState&, bool) {
    if (photo == 4) live.rig->freeze();
  });
  const auto failed = (*session)->run(*live.camera, *live.display, {}, &freezer);
  ASSERT_FALSE(failed.ok());
  EXPECT_NE(failed.error().what.find("no picture came"), std::string::npos);
  live.rig->plugIn();
  EXPECT_TRUE((*session)->run(*live.camera, *live.display, {}).ok());
}

TEST(CaptureSession, LostAndDamagedFramesAreReplacedByLaterOnes) {
  const TempFolder folder;
  LiveSession live(LiveRig::desk("laminate", kPixels));
  Doing trouble([&](int photo, const PhotoState&, bool) {
    if (photo == 3) live.rig->loseFrames(4);
    if (photo == 6) live.rig->damageFrames(2);
  });
  const auto outcome = capture(live, folder / "bundle", smallCapture(), false, &trouble);
  EXPECT_TRUE(outcome.complete);
  EXPECT_EQ(outcome.flawed, 0);
}

TEST(CaptureSession, AScreenThatKeepsShowingTheOldPictureIsNoticedAndThePhotographTakenAgain) {
  const TempFolder folder;
  LiveSession live(LiveRig::desk("laminate", kPixels));
  std::map<int, int> attempts;
  Doing lateScreen([&](int photo, const PhotoState& state, bool kept) {
    if (!kept) {
      ++attempts[photo];
      EXPECT_EQ(state.quality.faults, std::vector<PhotoFault>{PhotoFault::WrongPattern})
          << state.quality.sentence;
    } else if (photo == 5 || photo == 9) {
      live.rig->missPictures(1);
    }
  });
  const auto outcome = capture(live, folder / "bundle", smallCapture(), false, &lateScreen);
  EXPECT_TRUE(outcome.complete);
  EXPECT_EQ(outcome.flawed, 0);
  EXPECT_EQ(attempts, (std::map<int, int>{{6, 1}, {10, 1}}));
}

CaptureOptions sixFrequencies() {
  CaptureOptions options = smallCapture();
  options.plan.fitted = {{1, 0}, {0, 1}, {2, 0}, {0, 2}, {3, -3}};
  return options;
}

TEST(CaptureSession, BrightnessThatChangesIsNoticedAndKeptMarkedWhenItStays) {
  const TempFolder folder;
  LiveSession live(LiveRig::desk("laminate", kPixels));
  Doing dimmer([&](int photo, const PhotoState&, bool) {
    if (photo == 17) live.rig->dim(0.9);
  });
  const auto outcome = capture(live, folder / "bundle", sixFrequencies(), false, &dimmer);
  EXPECT_TRUE(outcome.complete);
  EXPECT_EQ(outcome.flawed, 3);  // two sets of four, by their last, and the window again
  const std::string journal = test::readText(folder / "bundle" / "journal.jsonl");
  EXPECT_NE(journal.find("darker than they must be"), std::string::npos);
  EXPECT_TRUE(readFourierCapture(folder / "bundle").ok());
}

TEST(CaptureSession, BrightnessThatComesBackCostsTheFourPhotographsOfThatFrequencyOnly) {
  const TempFolder folder;
  LiveSession live(LiveRig::desk("laminate", kPixels));
  std::vector<int> kept;
  Doing cloud([&](int photo, const PhotoState&, bool isKept) {
    if (isKept) kept.push_back(photo);
    if (photo == 11 && std::ranges::count(kept, 11) == 1 && isKept) live.rig->dim(0.85);
    if (photo == 13 && !isKept) live.rig->dim(1);
  });
  const auto outcome = capture(live, folder / "bundle", sixFrequencies(), false, &cloud);
  EXPECT_TRUE(outcome.complete);
  EXPECT_EQ(outcome.flawed, 0);
  // 10, 11, 12 were kept at first, 13 not; then all four again.
  EXPECT_EQ(kept.size(), 27u + 3);
  EXPECT_EQ(std::ranges::count(kept, 12), 2);
  EXPECT_EQ(std::ranges::count(kept, 14), 1);
  const Result<FourierCapture> bundle = readFourierCapture(folder / "bundle");
  ASSERT_TRUE(bundle.ok());
  EXPECT_EQ(bundle->photos[12].file, "photos/photo_012_r1.exr");
}

TEST(CaptureSession, AMovedSampleIsNoticed) {
  const TempFolder folder;
  LiveRigSetup setup = LiveRig::desk("laminate", 64);  // texture needs pixels
  LiveSession live(setup);
  int moved = 0;
  Doing pusher([&](int photo, const PhotoState& state, bool kept) {
    if (kept && photo == 8) live.rig->moveSample({2.5, 0}, 0);  // of 120 mm on 60 pixels: more than a pixel
    if (kept) return;
    for (const PhotoFault fault : state.quality.faults) moved += fault == PhotoFault::Shaken;
    live.rig->moveSample({0, 0}, 0);  // put back
  });
  const auto outcome = capture(live, folder / "bundle", smallCapture(), false, &pusher);
  EXPECT_TRUE(outcome.complete);
  EXPECT_EQ(moved, 1);
  EXPECT_EQ(outcome.flawed, 0);
}

TEST(CaptureSession, BracketHoldsWhatOneExposureClips) {
  const TempFolder folder;
  LiveRigSetup setup = LiveRig::desk("laminate", kPixels);
  setup.noise = {0, 0};
  LiveSession live(setup);
  CaptureOptions options = smallCapture();
  options.check = false;
  options.exposureS =
      20.0 / 60;  // three times what fills the sensor; whole refreshes, and so is a fourth of it
  options.bracket = 2;
  const auto outcome = capture(live, folder / "bracket", options);
  EXPECT_EQ(outcome.flawed, 0);
  options.bracket = 1;
  options.attempts = 1;
  EXPECT_GT(capture(live, folder / "single", options).flawed, 0);
  options.exposureS = 5.0 / 60;
  EXPECT_EQ(capture(live, folder / "short", options).flawed, 0);
  const auto a = readFourierCapture(folder / "bracket"), b = readFourierCapture(folder / "short");
  ASSERT_TRUE(a.ok() && b.ok());
  const auto merged = readPhoto(*a, a->photos[0]), plain = readPhoto(*b, b->photos[0]);
  for (std::size_t i = 0; i < plain->samples().size(); ++i)
    EXPECT_NEAR(merged->samples()[i], plain->samples()[i], 2e-3 * plain->samples()[i] + 1e-5);
}

TEST(CaptureSession, AFullDiskIsASentenceAndThePhotographsSoFarAreKept) {
  const TempFolder folder;
  LiveSession live(LiveRig::desk("laminate", kPixels));
  auto session = CaptureSession::open(folder / "bundle", live.rig->description(), smallCapture(), false);
  ASSERT_TRUE(session.ok());
  Doing breaker([&](int photo, const PhotoState&, bool) {
    if (photo != 6) return;
    fs::rename(folder / "bundle" / "photos",
               folder / "bundle" / "elsewhere");  // as good as a disk that is gone
  });
  const auto failed = (*session)->run(*live.camera, *live.display, {}, &breaker);
  ASSERT_FALSE(failed.ok());
  EXPECT_EQ(failed.error().code, ErrorCode::WriteFailed);
  fs::rename(folder / "bundle" / "elsewhere", folder / "bundle" / "photos");
  EXPECT_EQ((*session)->taken(), 7);
  EXPECT_TRUE((*session)->run(*live.camera, *live.display, {}).ok());
}

}  // namespace
}  // namespace patina
