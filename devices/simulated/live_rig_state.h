#pragma once

#include <condition_variable>
#include <deque>
#include <list>
#include <mutex>
#include <optional>

#include "devices/simulated/live_rig.h"

namespace patina {

/// Inside of the live rig; for its own files only. All members under `mutex`.
struct LiveRig::State {
  mutable std::mutex mutex;
  std::condition_variable_any changed;
  LiveRigSetup setup;
  ScreenResponse panel;  ///< light of the screen's values, its effects included
  double fullScaleSecond = 1;

  // Clock. A rig that doesn't run in real time moves it when somebody waits.
  RigTime clock{};
  RigTime now() const { return setup.realTime ? std::chrono::steady_clock::now() : clock; }
  void advance(std::chrono::nanoseconds by) { clock += by; }

  // What is on the glass, the newest last.
  struct Shown {
    ShownPicture picture;
    std::uint64_t hash = 0;
    RigTime light{};  ///< when its light begins to come
    std::uint64_t number = 0;
  };
  std::deque<Shown> glass;
  std::uint64_t pictures = 0;
  int missed = 0;
  double dimmed = 1;

  // The scene, made anew when something moved.
  LiveSceneSetup sceneSetup;
  std::optional<LiveScene> scene;
  std::uint64_t sceneVersion = 0;
  std::optional<LiveLamp> lamp;
  std::optional<Image> lampLight;
  struct Cached {
    std::uint64_t hash = 0, version = 0;
    Image radiance;
  };
  std::list<Cached> cache;

  // The camera.
  bool opened = false, unplugged = false, frozen = false;
  int lost = 0, damaged = 0;
  double exposureS = 1.0 / 60, gain = 1;
  double oldExposureS = 1.0 / 60, oldGain = 1;
  int settling = 0;  ///< frames that still come with the old settings
  std::uint64_t sequence = 0;
  std::uint64_t framesOfPicture = 0, pictureOfFrames = 0;

  /// Errors: those of LiveScene.
  Status prepareScene();
  const Image& radianceOf(const Shown& shown);
  /// The frame that begins at `start`, or what goes wrong. `scene` must be prepared.
  Frame expose(RigTime start, double exposureS, double gain);
  void sceneChanged() {
    scene.reset();
    lampLight.reset();
    ++sceneVersion;
  }
  CameraInfo info() const;
};

std::unique_ptr<CameraDevice> makeLiveCamera(std::shared_ptr<LiveRig> rig, LiveRig::State& state);
std::unique_ptr<PatternDisplay> makeLiveDisplay(std::shared_ptr<LiveRig> rig, LiveRig::State& state);

}  // namespace patina
