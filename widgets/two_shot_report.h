#pragma once

#include <QWidget>

#include "widgets/two_shot_document.h"

class QLabel;
class QTableWidget;

namespace patina {

/// A two-shot reconstruction in words: the error to expect and the error reached, what the engine remarks,
/// what was left out and why; and the list of materials where there are several.
class TwoShotReport : public QWidget {
  Q_OBJECT

 public:
  explicit TwoShotReport(TwoShotDocument* document, QWidget* parent = nullptr);
  /// All of its text, without markup.
  QString text() const;
  QTableWidget* materials() { return materials_; }

  QSize sizeHint() const override { return {420, 190}; }
  QSize minimumSizeHint() const override { return {180, 90}; }

 private:
  void refresh();
  void refreshMaterials();

  TwoShotDocument* document_;
  QLabel* words_;
  QTableWidget* materials_;
  bool updating_ = false;
};

/// One line for the status bar: what was reached.
QString twoShotHealth(const TwoShotFit& fit);

}  // namespace patina
