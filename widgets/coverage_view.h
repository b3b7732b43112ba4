#pragma once

#include <QPolygonF>
#include <QWidget>

#include "engine/calibration/camera_calibration.h"

namespace patina {

/// What the views of a camera calibration reach: corners over the cells of the picture, and beside it the
/// tilts, with the view to add next as a dashed outline.
class CoverageView : public QWidget {
  Q_OBJECT

 public:
  explicit CoverageView(QWidget* parent = nullptr);
  void setCoverage(const CalibrationCoverage& coverage, std::vector<Eigen::Vector2d> corners, int width,
                   int height);
  const CalibrationCoverage& coverage() const { return coverage_; }

  QSize sizeHint() const override { return {300, 150}; }
  QSize minimumSizeHint() const override { return {220, 110}; }

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  CalibrationCoverage coverage_;
  std::vector<Eigen::Vector2d> corners_;
  int width_ = 4, height_ = 3;
};

/// Where a board should be held next, as an outline in the picture: in the emptiest part of it, and with the
/// tilt that is missing most. Empty: enough is covered. `board`'s proportions are used.
QPolygonF nextViewOutline(const CalibrationCoverage& coverage, const Board& board, int width, int height);

}  // namespace patina
