#include "devices/v4l2/v4l2_camera.h"

#include <gtest/gtest.h>
#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "engine/acquire/frame_image.h"

namespace patina {
namespace {

using std::chrono::milliseconds;

constexpr const char* kId = "v4l2:platform:fake-90";
constexpr double kFull = 0.1;  // s that fill the fake's sensor at gain 1

std::unique_ptr<CameraDevice> opened(const std::string& words, int settleFrames = 4) {
  setenv("PATINA_FAKE_CAMERA", words.c_str(), 1);
  V4l2Provider provider(settleFrames);
  Result<std::unique_ptr<CameraDevice>> camera = provider.open(kId);
  EXPECT_TRUE(camera.ok()) << camera.error().sentence();
  return std::move(camera).value();
}

double valueOf(CameraDevice& camera, CameraControlId id) {
  const Result<std::vector<CameraControl>> controls = camera.controls();
  for (const CameraControl& control : controls.value())
    if (control.id == id) return control.value;
  ADD_FAILURE() << "no " << controlName(id);
  return -1;
}

FrameFormat formatOf(CameraDevice& camera, PixelLayout layout) {
  const Result<std::vector<FrameFormat>> formats = camera.formats();
  for (const FrameFormat& format : formats.value())
    if (format.layout == layout) return format;
  ADD_FAILURE() << "no such format";
  return {};
}

/// What the fake's ramp gives at a column, share of full scale.
double ramp(int x, int width, double exposureS) {
  return std::min(1.0, exposureS / kFull * (0.2 + 0.6 * x / (width - 1)));
}

TEST(V4l2Camera, IsListedByItsBus) {
  setenv("PATINA_FAKE_CAMERA", "", 1);
  V4l2Provider provider;
  const Result<std::vector<CameraInfo>> cameras = provider.list();
  ASSERT_TRUE(cameras.ok());
  const auto found = std::ranges::find(*cameras, kId, &CameraInfo::id);
  ASSERT_NE(found, cameras->end());
  EXPECT_NE(found->name.find("Patina Fake Camera"), std::string::npos);
  EXPECT_TRUE(provider.open("v4l2:/dev/video90").ok());
  EXPECT_EQ(provider.open("v4l2:usb-nowhere").error().code, ErrorCode::NotFound);
}

TEST(V4l2Camera, OffersRawFormatsFirst) {
  const auto camera = opened("");
  const auto formats = camera->formats();
  ASSERT_TRUE(formats.ok());
  EXPECT_EQ(formats->size(), 12u);
  EXPECT_EQ(formats->front().layout, PixelLayout::Bayer16);
  EXPECT_EQ(formats->front().size, (ImageSize{128, 96}));
  EXPECT_EQ(formats->front().framesPerSecond, 100);
  EXPECT_EQ(formats->back().layout, PixelLayout::Yuyv);
  EXPECT_EQ(camera->format(), formats->front());
}

TEST(V4l2Camera, EveryFormatGivesTheLightThatTheExposureCollects) {
  for (const PixelLayout layout : {PixelLayout::Bayer8, PixelLayout::Bayer10, PixelLayout::Bayer12,
                                   PixelLayout::Bayer16, PixelLayout::Grey8}) {
    const auto camera = opened("");
    ASSERT_TRUE(camera->setFormat(formatOf(*camera, layout)).ok());
    for (const double exposureS : {0.02, 0.08}) {
      StillRequest request;
      request.exposureS = exposureS;
      const auto frames = camera->still(request, {});
      ASSERT_TRUE(frames.ok()) << frames.error().sentence();
      const auto image = linearImage(frames->front());
      ASSERT_TRUE(image.ok());
      const double rounding = 1.0 / (1 << bitsOf(layout));
      for (const int x : {5, image->width() / 2, image->width() - 6})
        EXPECT_NEAR(image->at(x, 20, 1), ramp(x, image->width(), exposureS), rounding)
            << static_cast<int>(layout);
    }
  }
}

TEST(V4l2Camera, SwitchesTheAutomaticsOffBeforeItSetsAndReadsBack) {
  const auto camera = opened("");
  EXPECT_EQ(valueOf(*camera, CameraControlId::AutoExposure), 1);
  EXPECT_NEAR(*camera->set(CameraControlId::ExposureS, 0.0321), 0.0321, 1e-9);
  EXPECT_EQ(valueOf(*camera, CameraControlId::AutoExposure), 0);
  EXPECT_NEAR(valueOf(*camera, CameraControlId::ExposureS), 0.0321, 1e-9);
  EXPECT_EQ(*camera->set(CameraControlId::WhiteBalanceK, 5200), 5200);
  EXPECT_EQ(valueOf(*camera, CameraControlId::AutoWhiteBalance), 0);
  EXPECT_EQ(*camera->set(CameraControlId::Focus, 100), 100);
  EXPECT_EQ(valueOf(*camera, CameraControlId::AutoFocus), 0);
  EXPECT_EQ(*camera->set(CameraControlId::PowerLineHz, 60), 60);
  EXPECT_EQ(*camera->set(CameraControlId::Gain, 4), 4);
  EXPECT_FALSE(camera->set(CameraControlId::PowerLineHz, 55).ok());
  EXPECT_EQ(camera->set(CameraControlId::ExposureS, 3).error().code, ErrorCode::Invalid);
  EXPECT_EQ(camera->set(CameraControlId::RedGain, 1).error().code, ErrorCode::Unsupported);
}

TEST(V4l2Camera, KnowsTheOlderExposureControl) {
  const auto camera = opened("old-exposure");
  EXPECT_NEAR(*camera->set(CameraControlId::ExposureS, 0.05), 0.05, 1e-9);
  StillRequest request;
  request.exposureS = 0.05;
  const auto frames = camera->still(request, {});
  ASSERT_TRUE(frames.ok());
  EXPECT_NEAR(linearImage(frames->front())->at(64, 10, 1), ramp(64, 128, 0.05), 1e-3);
}

TEST(V4l2Camera, LateSettingsAreWaitedFor) {
  const auto camera = opened("late=3", 4);
  double expected = 0.02;
  for (int round = 0; round < 3; ++round) {
    StillRequest request;
    request.exposureS = expected;
    const auto frames = camera->still(request, {});
    ASSERT_TRUE(frames.ok());
    EXPECT_NEAR(frames->front().metadata.exposureS.value_or(0), expected, 1e-9);
    EXPECT_NEAR(linearImage(frames->front())->at(100, 10, 1), ramp(100, 128, expected), 1e-3) << round;
    expected *= 1.7;
    expected = std::round(expected * 1e4) / 1e4;
  }
}

TEST(V4l2Camera, FramesBeginAfterTheTimeThatIsAskedFor) {
  for (const char* stamps : {"", "eof-stamps"}) {
    const auto camera = opened(stamps);
    StillRequest request;
    request.exposureS = 0.02;
    ASSERT_TRUE(camera->still(request, {}).ok());
    request.notBefore = std::chrono::steady_clock::now() + milliseconds(150);
    request.frames = 3;
    const auto frames = camera->still(request, {});
    ASSERT_TRUE(frames.ok());
    std::uint64_t last = 0;
    for (const Frame& frame : *frames) {
      EXPECT_GE(frame.metadata.exposureStart, request.notBefore);
      EXPECT_GT(frame.metadata.sequence, last);
      last = frame.metadata.sequence;
    }
    // A stamp of the frame's end must be taken back by the exposure: the frame arrived that much later.
    EXPECT_GE(std::chrono::steady_clock::now() - request.notBefore, milliseconds(*stamps ? 20 : 0));
  }
}

TEST(V4l2Camera, LostAndDamagedFramesAreCountedAndLeftOut) {
  const auto camera = opened("lose=3 damage=4");
  StillRequest request;
  request.frames = 6;
  const auto frames = camera->still(request, {});
  ASSERT_TRUE(frames.ok());
  for (const Frame& frame : *frames) {
    EXPECT_FALSE(frame.metadata.damaged);
    EXPECT_NE(frame.metadata.sequence % 3, 2u);
    EXPECT_NE(frame.metadata.sequence % 4, 3u);
  }
}

TEST(V4l2Camera, ACameraInUseIsASentence) {
  const auto camera = opened("busy");
  const auto frames = camera->still({}, {});
  ASSERT_FALSE(frames.ok());
  EXPECT_NE(frames.error().what.find("another program"), std::string::npos);
  // And so is one that another descriptor streams from.
  const auto first = opened("");
  ASSERT_TRUE(first->still({}, {}).ok());
  V4l2Provider provider;
  auto second = provider.open(kId);
  ASSERT_FALSE(second.ok() && (*second)->still({}, {}).ok());
  first->stop();
}

TEST(V4l2Camera, UnpluggingEndsTheStreamWithASentence) {
  const auto camera = opened("unplug=12");
  StillRequest request;
  request.frames = 100;
  const auto start = std::chrono::steady_clock::now();
  const auto frames = camera->still(request, {});
  ASSERT_FALSE(frames.ok());
  EXPECT_EQ(frames.error().code, ErrorCode::NotFound);
  EXPECT_NE(frames.error().what.find("unplugged"), std::string::npos);
  EXPECT_FALSE(frames.error().tryThis.empty());
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(3));
  EXPECT_FALSE(camera->set(CameraControlId::ExposureS, 0.01).ok());
}

TEST(V4l2Camera, AFrameThatNeverComesIsASentenceInTime) {
  const auto camera = opened("no-frames");
  StillRequest request;
  request.timeout = milliseconds(400);
  const auto frames = camera->still(request, {});
  ASSERT_FALSE(frames.ok());
  EXPECT_NE(frames.error().what.find("no picture came"), std::string::npos);
}

TEST(V4l2Camera, WaitingCanBeCancelled) {
  const auto camera = opened("no-frames");
  std::stop_source stop;
  std::jthread stopper([&] {
    std::this_thread::sleep_for(milliseconds(150));
    stop.request_stop();
  });
  const auto start = std::chrono::steady_clock::now();
  const auto frames = camera->still({}, stop.get_token());
  ASSERT_FALSE(frames.ok());
  EXPECT_EQ(frames.error().code, ErrorCode::Cancelled);
  EXPECT_LT(std::chrono::steady_clock::now() - start, milliseconds(1500));
}

TEST(V4l2Camera, WithoutManualExposureItSaysSoAndStillPhotographs) {
  const auto camera = opened("no-manual");
  const auto set = camera->set(CameraControlId::ExposureS, 0.02);
  ASSERT_FALSE(set.ok());
  EXPECT_NE(set.error().tryThis.find("manual exposure"), std::string::npos);
  EXPECT_TRUE(camera->still({}, {}).ok());
}

TEST(V4l2Camera, ASettingThatIsNotKeptIsRefusedWithBothValues) {
  const auto camera = opened("keeps-exposure");
  const auto set = camera->set(CameraControlId::ExposureS, 0.04);
  ASSERT_FALSE(set.ok());
  EXPECT_EQ(set.error().code, ErrorCode::Refused);
  EXPECT_NE(set.error().what.find("0.01"), std::string::npos);
  EXPECT_NE(set.error().what.find("0.04"), std::string::npos);
}

TEST(V4l2Camera, StartsAndStopsManyTimes) {
  const auto camera = opened("");
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(camera->still({}, {}).ok());
    camera->stop();
    EXPECT_FALSE(camera->streaming());
    ASSERT_TRUE(camera->setFormat(formatOf(*camera, i % 2 ? PixelLayout::Grey8 : PixelLayout::Bayer10)).ok());
  }
  ASSERT_TRUE(camera->still({}, {}).ok());
  EXPECT_FALSE(camera->setFormat(formatOf(*camera, PixelLayout::Yuyv)).ok());  // while pictures come
}

TEST(V4l2Camera, PreviewSeesTheFramesThatPass) {
  const auto camera = opened("");
  std::atomic<int> seen{0};
  camera->preview([&](Result<Frame> frame) { seen += frame.ok(); });
  StillRequest request;
  request.frames = 5;
  ASSERT_TRUE(camera->still(request, {}).ok());
  EXPECT_GE(seen, 5);
  camera->preview(nullptr);
}

}  // namespace
}  // namespace patina

/// Starts again with the fake driver loaded before everything else.
int main(int argc, char** argv) {
  const char* loaded = getenv("LD_PRELOAD");
  if (!loaded || !std::strstr(loaded, PATINA_FAKE_DRIVER)) {
    setenv("LD_PRELOAD", PATINA_FAKE_DRIVER, 1);
    execv("/proc/self/exe", argv);
    return 1;
  }
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
