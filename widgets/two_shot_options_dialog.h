#pragma once

#include <QDialog>
#include <functional>

#include "widgets/two_shot_document.h"

class QCheckBox;
class QComboBox;
class QDialogButtonBox;
class QDoubleSpinBox;
class QLabel;
class QPushButton;
class QSpinBox;

namespace patina {

/// The basis: the built-in one, or a file of the person's own.
class BasisChooser : public QWidget {
  Q_OBJECT

 public:
  explicit BasisChooser(QWidget* parent = nullptr);
  /// Empty: the built-in one.
  QString file() const;
  void setFile(const QString& file);
  /// How a file is asked for; replaced by tests. Gives "" where the person changed their mind.
  void setChooseFile(std::function<QString()> choose) { choose_ = std::move(choose); }

 Q_SIGNALS:
  void changed();

 private:
  QComboBox* box_;
  QPushButton* browse_;
  std::function<QString()> choose_;
};

/// The form of TwoShotChoices: every field with unit, range and the effect of raising it. Says every problem
/// at once.
class TwoShotOptionsDialog : public QDialog {
  Q_OBJECT

 public:
  explicit TwoShotOptionsDialog(const TwoShotChoices& choices, QWidget* parent = nullptr);
  TwoShotChoices choices() const;
  void setChoices(const TwoShotChoices& choices);
  BasisChooser* basis() { return basis_; }

 private:
  void check();
  QDoubleSpinBox* eta_;
  QCheckBox *automaticEta_, *noise_;
  QSpinBox *rows_, *clusters_;
  BasisChooser* basis_;
  QLabel* problems_;
  QDialogButtonBox* buttons_;
};

}  // namespace patina
