#pragma once

#include "app/window/rig/calibration_step.h"

class QSpinBox;

namespace patina {

/// The curve from a screen's values to its light, from a grey ramp that is shown and photographed. Of use,
/// not needed: without it a power of 2.2 is taken.
class ScreenResponseStep : public CalibrationStep {
  Q_OBJECT

 public:
  explicit ScreenResponseStep(RigController& rig);

  QString title() const override;
  QString sentence() const override;
  bool canGoOn() const override { return !working(); }
  const ScreenCurve* result() const { return result_ ? &*result_ : nullptr; }
  QSpinBox* steps() const { return steps_; }

 protected:
  void buildControls(QVBoxLayout* column, QWidget* parent) override;
  void refreshControls() override;
  bool setsExposure() const override { return false; }
  std::string deviceName() const override;

 private:
  void measure();
  void drawOver(QPainter& painter, const QTransform& widgetFromPicture);

  std::optional<ScreenCurve> result_;
  QSpinBox* steps_ = nullptr;
  QPushButton* take_ = nullptr;
};

}  // namespace patina
