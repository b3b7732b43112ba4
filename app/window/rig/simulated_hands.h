#pragma once

#include <memory>

#include "engine/calibration/screen_pose.h"

namespace patina {

class LiveRig;

/// What a person would do at a real rig, done to the simulated one: for training without hardware, and for
/// tests. Blocks while the rig's camera works out a frame: call it in a job.
class SimulatedHands {
 public:
  explicit SimulatedHands(std::shared_ptr<LiveRig> rig) : rig_(std::move(rig)) {}

  /// Side of a square so that the board, held before the camera, is as wide as half of the picture.
  double squareThatFits(const Board& board) const;
  /// Holds the board before the camera under a lamp. `view` counts through stands that cover the picture and
  /// tilt to all sides.
  void holdBoard(const Board& board, int view);
  /// A mirror in the sample's place, with the marker board on it, under a lamp.
  void layMirror(const PlacedBoard& markers);
  void layPaper();   ///< white paper in the sample's place, no lamp
  void laySample();  ///< the sample, no lamp and no board
  /// Nothing but the screen's light falls on the camera's lens: a cap.
  void coverLens(bool covered);

  // ---- the two-shot rig: a lamp instead of the screen ----
  /// The marker board round the sample's place, with a hole of that radius.
  void layMarkers(const PlacedBoard& markers, double holeRadiusMm);
  void placeSample(bool tile);  ///< sample or white tile in the hole
  /// The camera on its stand, looking at the sample's centre; its lens stays as it is.
  void moveCamera(const Eigen::Vector3d& toCamera, double distanceMm);
  /// The lamp: a direction, and how bright it shines on a plane that faces it, in full scales a second.
  void moveLamp(const Eigen::Vector3d& toLight, double fullScalesASecond);

 private:
  std::shared_ptr<LiveRig> rig_;
};

}  // namespace patina
