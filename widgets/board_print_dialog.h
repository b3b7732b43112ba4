#pragma once

#include <QDialog>
#include <functional>

#include "engine/base/result.h"
#include "engine/calibration/board.h"

class QComboBox;
class QDoubleSpinBox;
class QLabel;
class QPushButton;

namespace patina {

class BoardChooser;

/// Draws a board to true scale and prints it, or saves it as PDF or SVG; then asks how long the line of
/// 100 mm became, and corrects the side of the squares by it.
class BoardPrintDialog : public QDialog {
  Q_OBJECT

 public:
  explicit BoardPrintDialog(const Board& board, QWidget* parent = nullptr);
  /// With the side that the print really has.
  Board board() const;
  BoardChooser* chooser() { return chooser_; }
  QDoubleSpinBox* measured() { return measured_; }
  QLabel* said() { return said_; }
  /// Writes the drawing; by its ending as .pdf or .svg. Errors: those of drawing and writing.
  Status saveTo(const QString& file) const;
  /// Asks for a file instead of a file dialog: tests.
  void setChooseFile(std::function<QString()> choose) { choose_ = std::move(choose); }

 private:
  void refresh();
  void save();
  void print();
  PrintOptions options() const;

  BoardChooser* chooser_;
  QComboBox* paper_;
  QLabel *preview_, *said_, *fits_;
  QDoubleSpinBox* measured_;
  QPushButton *save_, *print_;
  std::function<QString()> choose_;
};

}  // namespace patina
