// The camera and the display of a live rig, as sessions see them.
#include <algorithm>
#include <cmath>
#include <thread>

#include "devices/simulated/live_rig_state.h"

namespace patina {
namespace {

using std::chrono::microseconds;
using std::chrono::nanoseconds;

constexpr double kRiseEnds = 10;  ///< rise times after which the light of a picture is all there
constexpr auto kPace = std::chrono::milliseconds(4);  ///< of a live stream whose clock isn't real

nanoseconds nanosecondsOf(double seconds) {
  return nanoseconds(std::llround(seconds * 1e9));
}

class LiveCamera : public CameraDevice {
 public:
  LiveCamera(std::shared_ptr<LiveRig> rig, LiveRig::State& state) : rig_(std::move(rig)), state_(state) {
    info_ = state_.info();
    info_.remark.clear();
  }
  ~LiveCamera() override {
    stop();
    const std::lock_guard lock(state_.mutex);
    state_.opened = false;
  }

  const CameraInfo& info() const override { return info_; }
  FrameFormat format() const override {
    const std::lock_guard lock(state_.mutex);
    FrameFormat format;
    format.layout = state_.setup.bayer12 ? PixelLayout::Bayer12 : PixelLayout::Linear;
    format.size = {state_.sceneSetup.camera.width, state_.sceneSetup.camera.height};
    format.framesPerSecond = 1000 / std::max(1.0, state_.setup.readoutMs);
    format.name = state_.setup.bayer12 ? "12-bit Bayer" : "linear";
    return format;
  }
  Result<std::vector<FrameFormat>> formats() override { return std::vector<FrameFormat>{format()}; }
  Status setFormat(const FrameFormat& wanted) override {
    if (wanted == format()) return Done{};
    return Error{ErrorCode::Invalid, "the simulated camera has one format only", info_.name,
                 "choose that one"};
  }
  Result<std::vector<CameraControl>> controls() override {
    const std::lock_guard lock(state_.mutex);
    if (state_.unplugged) return cameraUnplugged(info_.name);
    return std::vector<CameraControl>{
        {CameraControlId::ExposureS, state_.setup.leastExposureS, state_.setup.mostExposureS, 0,
         state_.exposureS, true},
        {CameraControlId::Gain, 1, state_.setup.mostGain, 0, state_.gain, true}};
  }
  Result<double> set(CameraControlId id, double value) override {
    const std::lock_guard lock(state_.mutex);
    if (state_.unplugged) return cameraUnplugged(info_.name);
    const LiveRigSetup& setup = state_.setup;
    double* target = id == CameraControlId::ExposureS ? &state_.exposureS
                     : id == CameraControlId::Gain    ? &state_.gain
                                                      : nullptr;
    if (!target)
      return Error{ErrorCode::Unsupported, "this camera has no " + controlName(id), info_.name,
                   "go on without"};
    const bool exposure = id == CameraControlId::ExposureS;
    const double least = exposure ? setup.leastExposureS : 1,
                 most = exposure ? setup.mostExposureS : setup.mostGain;
    if (!(value >= least && value <= most))
      return Error{
          ErrorCode::Invalid,
          "the " + controlName(id) + " must lie in " + std::to_string(least) + " to " + std::to_string(most),
          info_.name, "choose another value"};
    if (state_.settling == 0) {
      state_.oldExposureS = state_.exposureS;
      state_.oldGain = state_.gain;
    }
    *target = value;
    state_.settling = setup.settleFrames;
    return value;
  }

  Status start(FrameSink sink) override {
    {
      const std::lock_guard lock(state_.mutex);
      if (state_.unplugged) return cameraUnplugged(info_.name);
    }
    stop();
    stream_ = std::jthread([this, sink = std::move(sink)](const std::stop_token& token) {
      while (!token.stop_requested()) {
        std::optional<Result<Frame>> next = nextFrame(token);
        if (!next) continue;
        const bool last = !*next;
        sink(std::move(*next));
        if (last) return;
      }
    });
    return Done{};
  }
  void stop() override { stream_ = {}; }
  bool streaming() const override { return stream_.joinable(); }

  /// In its own clock frames follow each other at once, and nothing depends on how fast threads are.
  Result<std::vector<Frame>> still(const StillRequest& asked, const std::stop_token& stop) override {
    if (state_.setup.realTime) return CameraDevice::still(asked, stop);
    this->stop();
    StillRequest request = asked;
    if (Status applied = apply(request); !applied) return applied.error();
    constexpr int kMostDropped = 2000;
    std::vector<Frame> frames;
    for (int dropped = 0; static_cast<int>(frames.size()) < request.frames;) {
      if (stop.stop_requested()) return Error{ErrorCode::Cancelled, "the photograph was cancelled", "", ""};
      std::unique_lock lock(state_.mutex);
      if (state_.unplugged) return cameraUnplugged(info_.name);
      const auto patience = asked.timeout.count() > 0 ? asked.timeout : std::chrono::milliseconds(3000);
      if (state_.frozen) {
        state_.advance(patience);
        return noFrameInTime(info_.name, patience);
      }
      const bool oldSettings = state_.settling > 0;
      if (oldSettings) --state_.settling;
      const double exposureS = oldSettings ? state_.oldExposureS : state_.exposureS;
      const double gain = oldSettings ? state_.oldGain : state_.gain;
      const RigTime start = state_.clock;
      state_.advance(nanosecondsOf(exposureS + state_.setup.readoutMs / 1000));
      ++state_.sequence;
      if (state_.lost > 0) {
        --state_.lost;
        continue;
      }
      // A frame that won't count isn't worth the work.
      FrameMetadata expected;
      expected.exposureStart = start;
      expected.exposureS = exposureS;
      expected.gain = gain;
      if (!meets(expected, request)) {
        if (++dropped > kMostDropped) return noFrameInTime(info_.name, patience);
        continue;
      }
      if (Status ready = state_.prepareScene(); !ready) return ready.error();
      Frame frame = state_.expose(start, exposureS, gain);
      lock.unlock();
      showPreview(frame);
      if (!meets(frame.metadata, request)) continue;
      frames.push_back(std::move(frame));
    }
    return frames;
  }

 private:
  /// The next frame of a stream; empty where none came.
  std::optional<Result<Frame>> nextFrame(const std::stop_token& token) {
    std::unique_lock lock(state_.mutex);
    if (state_.unplugged) return cameraUnplugged(info_.name);
    const bool oldSettings = state_.settling > 0;
    if (oldSettings) --state_.settling;
    const double exposureS = oldSettings ? state_.oldExposureS : state_.exposureS;
    const double gain = oldSettings ? state_.oldGain : state_.gain;
    const RigTime start = state_.now();
    const nanoseconds length = nanosecondsOf(exposureS + state_.setup.readoutMs / 1000);
    if (state_.setup.realTime) {
      state_.changed.wait_until(lock, token, start + length, [] { return false; });
    } else {
      state_.changed.wait_for(lock, token, kPace, [] { return false; });
      state_.advance(length);
    }
    ++state_.sequence;
    if (token.stop_requested() || state_.frozen) return {};
    if (state_.unplugged) return cameraUnplugged(info_.name);
    if (state_.lost > 0) {
      --state_.lost;
      return {};
    }
    if (Status ready = state_.prepareScene(); !ready) return ready.error();
    return state_.expose(start, exposureS, gain);
  }

  std::shared_ptr<LiveRig> rig_;
  LiveRig::State& state_;
  CameraInfo info_;
  std::jthread stream_;
};

class LiveDisplay : public PatternDisplay {
 public:
  LiveDisplay(std::shared_ptr<LiveRig> rig, LiveRig::State& state) : rig_(std::move(rig)), state_(state) {
    const LiveRigSetup& setup = state_.setup;
    latency_ = microseconds(std::lround(1000 * (setup.latencyMs + kRiseEnds * setup.riseMs)));
  }
  ScreenInfo screen() const override {
    const LiveRigSetup& setup = state_.setup;
    return {"simulated",          "Simulated screen",    setup.screen.widthPx, setup.screen.heightPx,
            setup.screen.widthMm, setup.screen.heightMm, setup.refreshHz,      {}};
  }
  Result<OnGlass> show(const ShownPicture& picture, const std::stop_token& stop) override {
    const LiveRigSetup& setup = state_.setup;
    if (picture.width != setup.screen.widthPx || picture.height != setup.screen.heightPx)
      return Error{ErrorCode::Invalid, "the picture is not as large as the screen", picture.name,
                   "make it as large"};
    OnGlass shown;
    {
      const std::lock_guard lock(state_.mutex);
      // Swaps happen at refreshes.
      const double periodS = 1 / setup.refreshHz;
      const double nowS = std::chrono::duration<double>(state_.now().time_since_epoch()).count();
      const double untilS = (std::floor(nowS / periodS + 1e-6) + 1) * periodS - nowS;
      shown.swapped = state_.now() + nanosecondsOf(untilS);
      if (!setup.realTime) state_.advance(nanosecondsOf(untilS));
    }
    rig_->glassShows("simulated", picture, shown.swapped);
    shown.since = shown.swapped + latency_;
    if (!rig_->waitUntil(shown.since, stop))
      return Error{ErrorCode::Cancelled, "showing a picture was cancelled", "", ""};
    return shown;
  }
  void setLatency(microseconds latency) override { latency_ = latency; }
  microseconds latency() const override { return latency_; }
  bool wait(microseconds time, const std::stop_token& stop) override {
    return rig_->waitUntil(rig_->now() + time, stop);
  }

 private:
  std::shared_ptr<LiveRig> rig_;
  LiveRig::State& state_;
  microseconds latency_{0};
};

}  // namespace

std::unique_ptr<CameraDevice> makeLiveCamera(std::shared_ptr<LiveRig> rig, LiveRig::State& state) {
  return std::make_unique<LiveCamera>(std::move(rig), state);
}

std::unique_ptr<PatternDisplay> makeLiveDisplay(std::shared_ptr<LiveRig> rig, LiveRig::State& state) {
  return std::make_unique<LiveDisplay>(std::move(rig), state);
}

}  // namespace patina
