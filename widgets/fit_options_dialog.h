#pragma once

#include <QDialog>

#include "engine/fourier/options.h"

class QCheckBox;
class QComboBox;
class QDialogButtonBox;
class QDoubleSpinBox;
class QLabel;
class QSpinBox;

namespace patina {

/// The form of FourierFitOptions: every field with unit, range and the effect of raising it. Says every
/// problem at once.
class FitOptionsDialog : public QDialog {
  Q_OBJECT

 public:
  explicit FitOptionsDialog(const FourierFitOptions& options, QWidget* parent = nullptr);
  FourierFitOptions options() const;
  void setOptions(const FourierFitOptions& options);

 private:
  void check();
  QSpinBox *size_, *iterations_;
  QComboBox *lobe_, *weights_, *schedule_;
  QDoubleSpinBox* memory_;
  QDoubleSpinBox* toleranceExponent_;
  QCheckBox *restarts_, *pool_;
  /// The tolerance that was given, and what the form shows of it: kept exactly unless somebody changes it.
  double givenTolerance_ = 0, givenExponent_ = 0;
  QLabel* problems_;
  QDialogButtonBox* buttons_;
};

}  // namespace patina
