#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "engine/acquire/camera_device.h"
#include "engine/acquire/frame_image.h"
#include "engine/acquire/pose_source.h"
#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/capture/two_shot_capture.h"
#include "engine/twoshot/metric.h"
#include "engine/twoshot/plan.h"

namespace patina {

/// A two-shot capture's own description.
struct TwoShotSetup {
  bool disc = true;
  double radiusMm = 20;              ///< disc
  double widthMm = 0, heightMm = 0;  ///< rectangle
  std::string sampleName;
  Eigen::Vector3d whiteReflectance{0.99, 0.99, 0.99};  ///< of the tile, from its certificate
  double distanceMm = 300;                             ///< at which the camera should stand
  std::vector<PlannedShot> shots;                      ///< what was planned (`planDirections`)
  std::vector<bool> holdout;                           ///< of each; empty: none
  BasisPtr basis;                                      ///< for the expected error; null: none is told
  BasisRegion region = BasisRegion::All;
  double eta = kPaperEta;
  double toleranceDeg = 1.5;  ///< camera and light within this of the plan: capture without asking
  double toleranceMm = 10;    ///< and the distance
  FrameConversion conversion;
  std::vector<std::string> validate() const;
};

/// Where the camera is against where it should be.
struct CameraGuide {
  Eigen::Vector3d toCamera = Eigen::Vector3d::UnitZ();  ///< as it is, unit
  double offDeg = 0;                                    ///< angle between planned and real direction
  double leftDeg = 0;    ///< to move the camera to its own left by, about the sample; negative: right
  double upDeg = 0;      ///< towards the normal
  double closerMm = 0;   ///< negative: back
  double aimOffDeg = 0;  ///< angle between the camera's axis and the sample's centre
  bool sampleInPicture = true;
  bool within = false;  ///< of the tolerance
  /// RMS of ln units over the BRDF: planned, with the camera where it is now (the shots already taken as they
  /// were taken, those to come as planned), and what moving costs in per cent. Negative: no basis.
  double plannedError = -1, errorNow = -1, costPercent = 0;
  std::string sentence;     ///< "Move 3 degrees left and 2 cm closer."
  double milliseconds = 0;  ///< that the guide took
};

/// The same for the light.
struct LightGuide {
  Eigen::Vector3d toLight = Eigen::Vector3d::UnitZ();
  double offDeg = 0, leftDeg = 0, upDeg = 0;  ///< left as seen from the camera's place
  bool within = false;
  double errorNow = -1, costPercent = 0;
  std::string sentence;
};

/// What to do next.
enum class TwoShotStep { PlaceCamera, PlaceLight, PhotographSample, PlaceTile, PhotographTile, Done };

/// A guided two-shot capture: for every planned shot camera, light, sample, tile. State is kept in the
/// bundle's journal: killed and opened again it goes on with what is on disk. Threading: one thread, except
/// `guideCamera` and `guideLight`, which only read.
class TwoShotSession {
 public:
  /// Errors: as `CaptureSession::open`.
  static Result<std::unique_ptr<TwoShotSession>> open(const std::filesystem::path& folder,
                                                      const TwoShotSetup& setup, bool resume);
  ~TwoShotSession();

  TwoShotStep step() const;
  int shot() const;  ///< the planned one that the step is about
  const TwoShotSetup& setup() const;
  const std::filesystem::path& folder() const;

  /// Guidance for a pose seen live. Cost: under 50 ms with the built-in basis, two shots (measured in a
  /// test).
  CameraGuide guideCamera(const Camera& camera) const;
  LightGuide guideLight(const Eigen::Vector3d& toLight) const;

  /// Takes the camera's place as it is (`accept`: though out of tolerance). Errors: Refused (out of
  /// tolerance, the sentence says by what; the sample not in the picture; the camera under the sample's
  /// plane).
  Status placeCamera(const Camera& camera, bool accept);
  Status placeLight(const Eigen::Vector3d& toLight, bool accept);
  /// Photographs the sample, then (after `PlaceTile`) the tile: exposures from the histogram, a bracket where
  /// one exposure can't hold the range. `poses`: the pose is looked at once more in the photograph itself;
  /// moved by more than the tolerance's tenth: Refused. Errors: those of the camera.
  Status photograph(CameraDevice& device, PoseSource* poses, const JobContext& job);
  /// The operator has put the tile in the sample's place.
  Status tilePlaced();
  /// Forgets the current shot's photographs and starts it again.
  Status retakeShot(int shot);
  /// The description so far; whole once `step()` is Done, when capture.json is on disk.
  TwoShotCapture capture() const;

 private:
  struct State;
  explicit TwoShotSession(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// "Move 3 degrees left, 2 cm closer": parts below half of `smallestDeg` and `smallestMm` are left out; "Hold
/// still: the camera is where it should be." where all are.
std::string moveSentence(double leftDeg, double upDeg, double closerMm, double smallestDeg,
                         double smallestMm);

}  // namespace patina
