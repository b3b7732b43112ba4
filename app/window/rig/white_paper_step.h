#pragma once

#include "app/window/rig/calibration_step.h"
#include "engine/fourier/emission_calibration.h"

class QDoubleSpinBox;

namespace patina {

/// The screen's emission and the radiance scale, from a short Fourier capture of white paper: Appendix A.
class WhitePaperStep : public CalibrationStep {
  Q_OBJECT

 public:
  explicit WhitePaperStep(RigController& rig);

  QString title() const override;
  QString sentence() const override;
  const EmissionCalibration* result() const { return result_ ? &*result_ : nullptr; }
  QDoubleSpinBox* albedo(int channel) const { return albedo_[static_cast<std::size_t>(channel)]; }
  QDoubleSpinBox* sampleWidth() const { return width_; }
  QDoubleSpinBox* sampleHeight() const { return height_; }

 protected:
  void buildControls(QVBoxLayout* column, QWidget* parent) override;
  void refreshControls() override;
  bool setsExposure() const override { return false; }

 private:
  void capture();
  void tell(const EmissionCalibration& found, const QStringList& remarks);

  std::optional<EmissionCalibration> result_;
  std::array<QDoubleSpinBox*, 3> albedo_{};
  QDoubleSpinBox *width_ = nullptr, *height_ = nullptr;
  QPushButton* take_ = nullptr;
};

}  // namespace patina
