#include "engine/acquire/camera_device.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <thread>

namespace patina {
namespace {

using std::chrono::milliseconds;

/// A camera whose frames are what a script says.
class Scripted : public CameraDevice {
 public:
  std::vector<CameraControl> known{{CameraControlId::ExposureS, 0.001, 1, 0, 0.01, true}};
  std::function<void(const FrameSink&, const std::stop_token&)> script;
  int starts = 0;

  ~Scripted() override { stop(); }
  const CameraInfo& info() const override { return info_; }
  Result<std::vector<FrameFormat>> formats() override { return std::vector<FrameFormat>{}; }
  FrameFormat format() const override { return {}; }
  Status setFormat(const FrameFormat&) override { return Done{}; }
  Result<std::vector<CameraControl>> controls() override { return known; }
  Result<double> set(CameraControlId id, double value) override {
    for (CameraControl& control : known)
      if (control.id == id) control.value = value;
    return value;
  }
  Status start(FrameSink sink) override {
    ++starts;
    thread_ = std::jthread([this, sink](const std::stop_token& token) { script(sink, token); });
    return Done{};
  }
  void stop() override { thread_ = {}; }
  bool streaming() const override { return thread_.joinable(); }

 private:
  CameraInfo info_{"scripted", "Scripted camera", "test", ""};
  std::jthread thread_;
};

Frame frameOf(std::uint64_t sequence, std::optional<double> exposureS,
              RigTime start = std::chrono::steady_clock::now()) {
  Frame frame;
  frame.metadata.sequence = sequence;
  frame.metadata.exposureS = exposureS;
  frame.metadata.exposureStart = start;
  return frame;
}

TEST(CameraDevice, StillTakesTheFirstFrameWithTheSetting) {
  Scripted camera;
  camera.script = [](const FrameSink& sink, const std::stop_token& token) {
    std::uint64_t n = 0;
    for (const std::optional<double> exposure :
         {std::optional<double>{}, std::optional(0.01), std::optional(0.01)})
      sink(frameOf(n++, exposure));
    Frame damaged = frameOf(n++, 0.02);
    damaged.metadata.damaged = true;
    sink(damaged);
    while (!token.stop_requested()) {
      sink(frameOf(n++, 0.0201));  // devices round
      std::this_thread::sleep_for(milliseconds(5));
    }
  };
  StillRequest request;
  request.exposureS = 0.02;
  const auto frames = camera.still(request, {});
  ASSERT_TRUE(frames.ok());
  EXPECT_GE(frames->front().metadata.sequence, 4u);
  EXPECT_EQ(frames->front().metadata.exposureS, 0.0201);
  ASSERT_TRUE(camera.still(request, {}).ok());
  EXPECT_EQ(camera.starts, 1);  // the stream stays on
}

TEST(CameraDevice, StillGivesUpOnACameraThatNeverTakesTheSetting) {
  Scripted camera;
  camera.script = [](const FrameSink& sink, const std::stop_token& token) {
    for (std::uint64_t n = 0; !token.stop_requested(); ++n) {
      sink(frameOf(n, 0.5));
      std::this_thread::sleep_for(milliseconds(1));
    }
  };
  StillRequest request;
  request.exposureS = 0.02;
  const auto frames = camera.still(request, {});
  ASSERT_FALSE(frames.ok());
  EXPECT_NE(frames.error().what.find("does not take the exposure"), std::string::npos);
}

TEST(CameraDevice, StillWithoutTheControlIsASentenceAndGainOfOneIsNone) {
  Scripted camera;
  camera.script = [](const FrameSink& sink, const std::stop_token&) { sink(frameOf(1, 0.01)); };
  StillRequest request;
  request.gain = 2;
  EXPECT_EQ(camera.still(request, {}).error().code, ErrorCode::Unsupported);
  request.gain = 1;
  EXPECT_TRUE(camera.still(request, {}).ok());
}

TEST(CameraDevice, TheStreamsLastErrorIsTheStills) {
  Scripted camera;
  camera.script = [](const FrameSink& sink, const std::stop_token&) { sink(cameraUnplugged("it")); };
  const auto frames = camera.still({}, {});
  ASSERT_FALSE(frames.ok());
  EXPECT_EQ(frames.error().code, ErrorCode::NotFound);
  camera.script = [](const FrameSink& sink, const std::stop_token&) { sink(frameOf(1, 0.01)); };
  EXPECT_TRUE(camera.still({}, {}).ok());  // plugged in again
}

TEST(FrameQueue, KeepsTheNewestAndWakesForTheStop) {
  FrameQueue queue(2);
  for (std::uint64_t n = 1; n <= 5; ++n) queue.push(frameOf(n, {}));
  EXPECT_EQ((*queue.next(milliseconds(0)))->metadata.sequence, 4u);
  EXPECT_EQ((*queue.next(milliseconds(0)))->metadata.sequence, 5u);
  EXPECT_FALSE(queue.next(milliseconds(10)));
  std::stop_source stop;
  std::jthread stopper([&] {
    std::this_thread::sleep_for(milliseconds(50));
    stop.request_stop();
  });
  const auto start = std::chrono::steady_clock::now();
  EXPECT_FALSE(queue.next(std::chrono::seconds(30), stop.get_token()));
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(5));
}

}  // namespace
}  // namespace patina
