#pragma once

#include "app/window/rig/calibration_step.h"

class QCheckBox;
class QTableWidget;

namespace patina {

class BoardChooser;
class CoverageView;

/// The camera's lens from views of a board that is held before it. Views are taken by themselves when the
/// board stands still somewhere new, or by key or button.
class CheckerboardStep : public CalibrationStep {
  Q_OBJECT

 public:
  explicit CheckerboardStep(RigController& rig);
  ~CheckerboardStep() override;

  QString title() const override;
  QString sentence() const override;
  void enter() override;
  void leave() override;

  BoardChooser* boards() { return boards_; }
  const std::vector<CalibrationView>& views() const { return views_; }
  void removeView(int view);
  /// The lens that the views give; null: too few yet.
  const CameraCalibration* result() const { return result_ ? &*result_ : nullptr; }
  bool solving() const { return solver_.running(); }

 protected:
  void buildControls(QVBoxLayout* column, QWidget* parent) override;
  QWidget* belowPicture(QWidget* parent) override;
  void frameCame(const LiveFramePtr& frame) override;
  Rechecker rechecker() const override;
  QString recheckHint() const override;
  void refreshControls() override;

 private:
  void saw(const BoardSightingPtr& sighting);
  void take();
  bool isNew(const BoardView& view) const;
  void solve();
  void showResult();
  void showCoverage();
  void drawOver(QPainter& painter, const QTransform& widgetFromPicture);
  void boardChanged();
  void keepResult();

  BoardWatcher watcher_;
  StillnessJudge still_;
  BoardSightingPtr sighting_;
  std::vector<CalibrationView> views_;
  std::optional<CameraCalibration> result_;
  CalibrationCoverage coverage_;
  QPolygonF ghost_;
  int taken_ = 0, hand_ = 0;
  bool solveAgain_ = false, atLast_ = false, sized_ = false;
  BoardChooser* boards_ = nullptr;
  CoverageView* map_ = nullptr;
  QCheckBox* auto_ = nullptr;
  QLabel *seen_ = nullptr, *advice_ = nullptr, *lens_ = nullptr;
  QTableWidget* table_ = nullptr;
  QPushButton *take_ = nullptr, *keep_ = nullptr, *print_ = nullptr;
  JobRunner solver_;  ///< last: destroyed first
};

}  // namespace patina
