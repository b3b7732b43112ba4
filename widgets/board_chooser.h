#pragma once

#include <QWidget>

#include "engine/calibration/board.h"

class QComboBox;
class QDoubleSpinBox;
class QLabel;
class QSpinBox;

namespace patina {

/// Which board: its kind, its squares and their side.
class BoardChooser : public QWidget {
  Q_OBJECT

 public:
  explicit BoardChooser(QWidget* parent = nullptr);
  Board board() const { return board_; }
  void setBoard(const Board& board);
  QDoubleSpinBox* side() { return side_; }
  QComboBox* kindBox() { return kind_; }

 Q_SIGNALS:
  void changed();

 private:
  void take();

  Board board_ = Board::forCamera();
  bool filling_ = false;
  QComboBox* kind_;
  QSpinBox *columns_, *rows_;
  QDoubleSpinBox* side_;
  QLabel* problem_;
};

}  // namespace patina
