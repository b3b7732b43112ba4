#pragma once

#include "app/window/rig/calibration_step.h"

class QDoubleSpinBox;

namespace patina {

class BoardChooser;

/// The board that a screen shows for the mirror, and where on it: in whole pixels, round its middle.
struct ScreenBoard {
  PlacedBoard placed;  ///< in the screen's frame, its markers as they are shown
  ShownPicture picture;
};
/// Errors: Invalid (a screen of too few pixels, or without a size).
Result<ScreenBoard> screenBoardFor(const ScreenInfo& screen);

/// Where screen and camera stand, from one photograph of a mirror in the sample's place: Appendix A.
class MirrorStep : public CalibrationStep {
  Q_OBJECT

 public:
  explicit MirrorStep(RigController& rig);

  QString title() const override;
  QString sentence() const override;
  void enter() override;
  void leave() override;

  BoardChooser* boards() { return boards_; }
  PlacedBoard markers() const;
  void setMarkers(const PlacedBoard& markers);
  /// What the last frame shows of the two boards; null: nothing yet.
  const BoardSighting* sighting() const { return sighting_.get(); }
  const ScreenPoseCalibration* result() const { return result_ ? &*result_ : nullptr; }

 protected:
  void buildControls(QVBoxLayout* column, QWidget* parent) override;
  QWidget* belowPicture(QWidget* parent) override;
  void frameCame(const LiveFramePtr& frame) override;
  Rechecker rechecker() const override;
  QString recheckHint() const override;
  void prepareRecheck() override;
  void refreshControls() override;
  std::string deviceName() const override;

 private:
  void saw(const BoardSightingPtr& sighting);
  void showBoard();
  bool coversThisWindow() const;
  void boardsChanged();
  void calibrate();
  void drawOver(QPainter& painter, const QTransform& widgetFromPicture);

  BoardWatcher watcher_;
  BoardSightingPtr sighting_;
  std::optional<ScreenBoard> onScreen_;
  std::optional<ScreenPoseCalibration> result_;
  bool sized_ = false;
  BoardChooser* boards_ = nullptr;
  QDoubleSpinBox *x_ = nullptr, *y_ = nullptr, *turn_ = nullptr, *height_ = nullptr;
  QLabel *seenMarkers_ = nullptr, *seenScreen_ = nullptr;
  QPushButton *show_ = nullptr, *take_ = nullptr;
};

}  // namespace patina
