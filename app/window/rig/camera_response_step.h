#pragma once

#include "app/window/rig/calibration_step.h"

namespace patina {

/// The camera's response from a bracket of one still scene, and its black level from dark frames. Needed
/// where the camera's format isn't linear; elsewhere it shows that it is.
class CameraResponseStep : public CalibrationStep {
  Q_OBJECT

 public:
  explicit CameraResponseStep(RigController& rig);

  QString title() const override;
  QString sentence() const override;
  bool canGoOn() const override;
  QString whyNot() const override;
  const CameraResponse* result() const { return result_ ? &*result_ : nullptr; }
  const DarkLevel* dark() const { return dark_ ? &*dark_ : nullptr; }

 protected:
  void buildControls(QVBoxLayout* column, QWidget* parent) override;
  void refreshControls() override;
  Rechecker rechecker() const override;
  QString recheckHint() const override;

 private:
  bool linear() const;
  void bracket();
  void darkFrames();
  void keepBoth();
  void tell();

  std::optional<CameraResponse> result_;
  std::optional<DarkLevel> dark_;
  QPushButton *bracket_ = nullptr, *takeDark_ = nullptr;
};

}  // namespace patina
