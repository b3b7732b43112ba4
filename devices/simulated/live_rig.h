#pragma once

#include <Eigen/Core>
#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "devices/simulated/live_scene.h"
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
  Screen screen;               ///< as declared; effects.screenPose moves the true one
  SimulatedSheet sheet;        ///< of the two Gaussians' kind, unless `brdfs` says otherwise
  std::vector<BrdfPtr> brdfs;  ///< measured or analytic; one for each of the sheet's materials in turn.
                               ///< Empty: the sheet's own microfacets
  SimulatedEffects effects;  ///< undeclared ones; subsurface scattering and wrong exposures are not simulated
                             ///< live. Drift and noise of time count by pictures shown
  SensorNoise noise;         ///< shares of full scale
  double gamma = 2.2;        ///< of the screen: light = value^gamma
  double refreshHz = 60;
  double flickerDepth = 0.3;   ///< of the backlight, a sine at the refresh rate: exposures of whole periods
                               ///< don't see it
  double latencyMs = 35;       ///< from swap to light
  double riseMs = 4;           ///< of the liquid crystal, exponential
  double fullScaleSecond = 0;  ///< radiance that fills the sensor in one second; 0: the window's brightest
                               ///< does in a tenth of a second
  double ambient = 0.0005;     ///< radiance of the room's light, times the surface's albedo
  double pedestal = 0.01;      ///< black level, share of full scale
  double leastExposureS = 1e-4, mostExposureS = 10;
  double mostGain = 16;
  int settleFrames = 2;  ///< frames until a setting acts
  double readoutMs = 4;  ///< between frames
  bool bayer12 = false;  ///< 12-bit Bayer frames instead of linear floats
  std::uint64_t seed = 1;
  bool realTime = false;  ///< else its own clock, which runs as fast as anyone waits for it
  std::vector<std::string> validate() const;
};

/// A camera, a screen and a sample that behave as real ones do, but for being there. The camera sees exactly
/// what the display's window shows: the pixels of the picture, not its name. Light from the screen's pixels
/// to the camera's is worked out once for a pose (see LiveScene); a frame of a picture seen before costs next
/// to nothing. Threading: all functions from any thread.
class LiveRig : public GlassObserver, public std::enable_shared_from_this<LiveRig> {
 public:
  /// A laptop's screen over a desk and a small camera. `pixels`: of its sides. `screenPx`: across.
  static LiveRigSetup desk(const std::string& scene, int pixels = 64, int screenPx = 960);
  /// A rig from {"scene": "laminate", "pixels": 64, "effects": {...}, "latencyMs": 35, ...}: the fields of
  /// LiveRigSetup that are single numbers or true and false, by their names; scene, pixels, screenPx; brdfs
  /// (a list of sources as `openBrdf` takes them); effects as in `simulatedEffectsFromJson`. Errors:
  /// Malformed, Invalid (an unknown key, the nearest named).
  static Result<LiveRigSetup> fromJson(std::string_view text, const std::string& where);
  /// Errors: Invalid, and those of LiveScene.
  static Result<std::shared_ptr<LiveRig>> create(const LiveRigSetup& setup);
  ~LiveRig() override;

  const LiveRigSetup& setup() const;
  /// What a perfect calibration would say (before undeclared effects).
  RigDescription description() const;

  // ---- what an operator does ----
  void moveCamera(const Camera& camera);
  /// Puts another screen there: of so many pixels, as wide as it was, its height by square pixels.
  void exchangeScreen(int widthPx, int heightPx);
  void moveSample(const Eigen::Vector2d& toMm, double turnDeg);
  void put(OnTable what);
  /// Boards that lie on the table or are held before the camera.
  void show(std::vector<LivePrint> prints);
  /// A distant lamp; none: off.
  void light(const std::optional<LiveLamp>& lamp);
  Camera camera() const;

  /// The camera, as a backend would open it, and a display without a window. One camera at a time: busy else.
  Result<std::unique_ptr<CameraDevice>> openCamera();
  std::unique_ptr<PatternDisplay> openDisplay();
  /// Knows the camera's pose, some degrees and mm wrong (a normal error of that size, anew at each look).
  std::unique_ptr<PoseSource> poses(double errorDeg = 0, double errorMm = 0);

  /// The real pattern window's pictures come in here.
  void glassShows(const std::string& screenId, const ShownPicture& picture, RigTime swapped) override;
  RigTime now() const override;
  bool waitUntil(RigTime when, const std::stop_token& stop) override;
  std::uint64_t picturesShown() const;

  // ---- what can go wrong ----
  void unplug();  ///< the camera is gone; `plugIn` brings it back
  void plugIn();
  void loseFrames(int frames);    ///< so many never come
  void damageFrames(int frames);  ///< so many come marked as damaged
  void freeze();                  ///< no frame comes any more
  /// The display keeps showing what it shows for the next so many pictures, and says that it doesn't.
  void missPictures(int pictures);
  /// The screen's light changes to this share.
  void dim(double share);

  struct State;

 private:
  explicit LiveRig(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// "simulated:laminate", ... and "simulated:FILE.json".
class LiveRigProvider : public CameraProvider {
 public:
  std::string backend() const override { return "simulated"; }
  Result<std::vector<CameraInfo>> list() override;
  Result<std::unique_ptr<CameraDevice>> open(const std::string& id) override;
  /// The rig behind an id: camera and display of one rig belong together. `realTime`: as in LiveRigSetup.
  Result<std::shared_ptr<LiveRig>> rig(const std::string& id, bool realTime = false);

 private:
  std::vector<std::pair<std::string, std::shared_ptr<LiveRig>>> rigs_;
};

}  // namespace patina
