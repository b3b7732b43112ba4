#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "devices/simulated/simulated_effects.h"
#include "devices/simulated/simulated_sensor.h"
#include "devices/simulated/simulated_sheet.h"
#include "engine/acquire/camera_device.h"
#include "engine/acquire/pattern_display.h"
#include "engine/acquire/pose_source.h"
#include "engine/acquire/rig_description.h"
#include "engine/base/result.h"
#include "engine/brdf/brdf.h"

namespace patina {

/// What a live simulated rig is made of.
struct LiveRigSetup {
  std::string name = "laminate";
  Camera camera;               ///< true; `LiveRig::desk` has a usable one
  Screen screen;               ///< true pose, pixels, emission
  SimulatedSheet sheet;        ///< of the two Gaussians' kind, unless `brdfs` says otherwise
  std::vector<BrdfPtr> brdfs;  ///< measured or analytic; one for each of the sheet's materials in turn.
                               ///< Empty: the sheet's own microfacets
  SimulatedEffects effects;  ///< undeclared ones: screen, surface, time, lens, sensor
  SensorNoise noise;
  double gamma = 2.2;  ///< of the screen: light = value^gamma
  double refreshHz = 60;
  double latencyMs = 35;       ///< from swap to light
  double riseMs = 8;           ///< of the liquid crystal, exponential
  double fullScaleSecond = 0;  ///< radiance that fills the sensor in a second; 0: the window's brightest does
                               ///< in 0.1 s
  double ambient = 0.0005;     ///< radiance of the room on the sheet, over the screen's white
  double pedestal = 0.01;      ///< black level, share of full scale
  int settleFrames = 2;        ///< frames until a setting acts
  bool bayer12 = false;        ///< 12-bit Bayer frames instead of linear floats
  double movedMmPerS = 0;      ///< somebody pushes the sample
  std::uint64_t seed = 1;
  bool realTime = false;  ///< else its own clock, which runs as fast as anyone waits for it
  std::vector<std::string> validate() const;
};

/// A camera, a screen and a sample that behave as real ones do, but for being there. The camera sees exactly
/// what the display's window shows: the pixels of the picture, not its name. Light from the screen's pixels
/// to the camera's is worked out once for a pose (linear in the screen's pixels) by integrating the true BRDF
/// over the screen in blocks of pixels; then a frame is one product. Shares no formula with the fit.
/// Threading: all functions from any thread.
class LiveRig : public GlassObserver {
 public:
  /// A desk with a small camera. `pixels`: of its sides.
  static LiveRigSetup desk(const std::string& scene, int pixels = 64);
  /// Reads {"scene": ..., "pixels": ..., "effects": {...}, "latencyMs": ...}: every field of LiveRigSetup
  /// that is a number, scene, brdfs (sources as `openBrdf` takes them), effects. Errors: Malformed, Invalid.
  static Result<LiveRigSetup> fromJson(std::string_view text, const std::string& where);
  static Result<std::shared_ptr<LiveRig>> create(const LiveRigSetup& setup);
  ~LiveRig() override;

  /// What a perfect calibration would say.
  RigDescription trueDescription() const;
  const LiveRigSetup& setup() const;

  // ---- what an operator does ----
  /// Moves camera or sample; light transport is worked out again at the next frame.
  void moveCamera(const Camera& camera);
  void moveSample(const Eigen::Vector2d& byMm, double turnDeg);
  enum class OnTable { Sheet, WhitePaper, Mirror, Checkerboard, WhiteTile };
  void put(OnTable what);
  /// A distant lamp (two-shot): direction and irradiance in radiance units; none: off.
  void light(const std::optional<Eigen::Vector3d>& toLight, double irradiance = 1);

  /// The camera, as a backend would open it, and a display without a window.
  std::unique_ptr<CameraDevice> openCamera();
  std::unique_ptr<PatternDisplay> openDisplay();
  /// Knows the camera's pose, with some uncertainty in degrees and mm.
  std::unique_ptr<PoseSource> poses(double noiseDeg = 0, double noiseMm = 0);

  /// The real pattern window's pictures come in here.
  void glassShows(const std::string& screenId, const ShownPicture& picture, RigTime swapped) override;
  RigTime now() const;

  // ---- what can go wrong ----
  void unplug();                ///< the camera is gone from now on
  void loseFrames(int frames);  ///< the next ones never come
  void damageFrames(int frames);

 private:
  friend class LiveCamera;
  friend class LiveDisplay;
  struct State;
  explicit LiveRig(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// "simulated:laminate", ... and "simulated:FILE.json".
class LiveRigProvider : public CameraProvider {
 public:
  std::string backend() const override { return "simulated"; }
  Result<std::vector<CameraInfo>> list() override;
  Result<std::unique_ptr<CameraDevice>> open(const std::string& id) override;
  /// The rig behind an id: camera and display of one rig belong together.
  Result<std::shared_ptr<LiveRig>> rig(const std::string& id);
};

}  // namespace patina
