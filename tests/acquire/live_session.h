#pragma once

#include <memory>
#include <string>

#include "devices/simulated/live_rig.h"
#include "engine/acquire/capture_session.h"

namespace patina::test {

/// A simulated rig with its camera and display opened.
struct LiveSession {
  std::shared_ptr<LiveRig> rig;
  std::unique_ptr<CameraDevice> camera;
  std::unique_ptr<PatternDisplay> display;

  explicit LiveSession(const LiveRigSetup& setup)
      : rig(LiveRig::create(setup).value()), camera(rig->openCamera().value()), display(rig->openDisplay()) {}
};

/// A small capture: three frequencies and one held out.
inline CaptureOptions smallCapture() {
  CaptureOptions options;
  options.plan.fitted = {{1, 0}, {0, 2}, {3, -3}};
  options.plan.heldOut = {{2, 1}};
  return options;
}

/// An observer that does something when a photograph was taken.
class Doing : public CaptureObserver {
 public:
  explicit Doing(std::function<void(int photo, const PhotoState&, bool kept)> then)
      : then_(std::move(then)) {}
  void photographed(int photo, const Image&, const PhotoState& state, bool kept) override {
    then_(photo, state, kept);
  }
  void checked(const Checklist& list) override { checklist = list; }
  Checklist checklist;

 private:
  std::function<void(int, const PhotoState&, bool)> then_;
};

}  // namespace patina::test
