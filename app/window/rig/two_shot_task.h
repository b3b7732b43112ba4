#pragma once

#include <QObject>
#include <memory>

#include "app/window/rig/rig_controller.h"
#include "engine/acquire/board_pose_source.h"
#include "engine/acquire/two_shot_session.h"
#include "engine/calibration/white_tile.h"
#include "engine/twoshot/basis.h"

namespace patina {

/// What the steps of a guided two-shot capture decide for each other. Lives in the window's thread.
class TwoShotTask : public QObject {
  Q_OBJECT

 public:
  explicit TwoShotTask(RigController& rig, QObject* parent = nullptr);
  ~TwoShotTask() override;

  RigController& rig() { return rig_; }
  /// The sample: a disc round the middle of the markers.
  double radiusMm() const { return radiusMm_; }
  double distanceMm() const { return distanceMm_; }
  double sampleHeightMm() const { return heightMm_; }
  void setSample(double radiusMm, double heightMm, double distanceMm);
  const PlacedBoard& markers() const { return markers_; }
  void setMarkers(const Board& board);

  const std::vector<PlannedShot>& shots() const { return shots_; }
  /// `basis`: that the expected error is told by; null: none is told.
  void setShots(std::vector<PlannedShot> shots, BasisPtr basis);
  BasisPtr basis() const { return basis_; }

  const CertifiedReflectance& reflectance() const { return reflectance_; }
  void setReflectance(const CertifiedReflectance& reflectance) { reflectance_ = reflectance; }

  /// The lens as it was calibrated. Errors: those of reading it.
  Result<Camera> lens() const;
  TwoShotSetup setup() const;

 Q_SIGNALS:
  void changed();

 private:
  RigController& rig_;
  double radiusMm_ = 20, heightMm_ = 0, distanceMm_ = 300;
  PlacedBoard markers_;
  std::vector<PlannedShot> shots_;
  BasisPtr basis_;
  CertifiedReflectance reflectance_;
};

}  // namespace patina
