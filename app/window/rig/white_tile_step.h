#pragma once

#include "app/window/rig/calibration_step.h"
#include "app/window/rig/two_shot_task.h"

class QDoubleSpinBox;

namespace patina {

/// The white tile: what its certificate says, and what a photograph of it tells of the lamp: the irradiance
/// at every pixel, dust and shadows.
class WhiteTileStep : public CalibrationStep {
  Q_OBJECT

 public:
  explicit WhiteTileStep(TwoShotTask& task);

  QString title() const override;
  QString sentence() const override;
  void enter() override;
  const WhiteTileCalibration* result() const { return result_ ? &*result_ : nullptr; }
  QDoubleSpinBox* reflectance(int channel) const { return reflectance_[static_cast<std::size_t>(channel)]; }
  /// Reads a certificate's table; what is wrong with it is said.
  void loadCertificate(const QString& file);
  void setChooseFile(std::function<QString()> choose) { choose_ = std::move(choose); }

 protected:
  void buildControls(QVBoxLayout* column, QWidget* parent) override;
  void frameCame(const LiveFramePtr& frame) override;
  void refreshControls() override;
  Rechecker rechecker() const override;
  QString recheckHint() const override;

 private:
  PixelRegion region() const;
  void measure();
  void drawOver(QPainter& painter, const QTransform& widgetFromPicture);
  CertifiedReflectance certified() const;

  TwoShotTask& task_;
  BoardWatcher watcher_;
  BoardSightingPtr sighting_;
  std::optional<PixelRegion> seen_;  ///< where the markers say that the tile is
  std::optional<WhiteTileCalibration> result_;
  CertifiedReflectance table_;  ///< `source` empty: no certificate was loaded
  std::array<QDoubleSpinBox*, 3> reflectance_{};
  QLabel* source_ = nullptr;
  QPushButton* take_ = nullptr;
  std::function<QString()> choose_;
};

/// The largest upright rectangle of the picture inside of the disc round the world's origin; empty where the
/// disc isn't wholly in the picture.
std::optional<PixelRegion> regionInDisc(const Camera& camera, double radiusMm);
/// What a photograph of the tile shows, in sentences, those that are wrong first.
QString tileInWords(const WhiteTileCalibration& tile);

}  // namespace patina
