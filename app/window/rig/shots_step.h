#pragma once

#include <QPointer>
#include <memory>

#include "app/window/rig/two_shot_task.h"
#include "engine/acquire/two_shot_guide.h"
#include "widgets/board_watcher.h"
#include "widgets/guide_step.h"

class QDoubleSpinBox;
class QLabel;
class QLineEdit;
class QProgressBar;
class QPushButton;
class QVBoxLayout;

namespace patina {

class LiveView;
class SimulatedHands;

/// The shots themselves: for each the camera against its plan, live, then the lamp, the sample, the tile.
/// Ends with a bundle that the window opens.
class ShotsStep : public GuideStep {
  Q_OBJECT

 public:
  explicit ShotsStep(TwoShotTask& task);
  ~ShotsStep() override;

  QString title() const override;
  QString sentence() const override;
  QWidget* body(QWidget* parent) override;
  void enter() override;
  void leave() override;
  State state() const override;
  QString note() const override;
  QString whyNot() const override;
  QString goOnText() const override;

  /// Null before the first shot is begun.
  const TwoShotSession* session() const { return session_.get(); }
  TwoShotStep step() const { return step_; }
  bool working() const { return working_; }
  /// What the live pose is against the plan; nothing while no markers are seen.
  const std::optional<CameraGuide>& guide() const { return guide_; }
  const std::optional<PoseEstimate>& pose() const { return pose_; }
  QString said() const;
  QLineEdit* folder() { return folder_; }
  QDoubleSpinBox* lightTilt() { return tilt_; }
  QDoubleSpinBox* lightAzimuth() { return azimuth_; }

 private:
  void begin();
  void sync();
  void saw(const BoardSightingPtr& sighting);
  void guideNow();
  void placeCamera(bool accept);
  void placeLight(bool accept);
  void lightChanged();
  void photograph();
  void tilePlaced();
  void retake();
  void afterTile(int shot);
  void say(const QString& text, bool problem);
  void refresh();
  void drawOver(QPainter& painter, const QTransform& widgetFromPicture);
  Eigen::Vector3d toLight() const;
  void setLight(const Eigen::Vector3d& toLight);
  void act(std::function<void(SimulatedHands&)> act);
  void buildHands(QVBoxLayout* column, QWidget* parent);

  TwoShotTask& task_;
  BoardWatcher watcher_;
  std::shared_ptr<TwoShotSession> session_;
  BoardSightingPtr sighting_;
  std::optional<PoseEstimate> pose_;
  std::optional<CameraGuide> guide_;
  std::optional<LightGuide> lightGuide_;
  bool entered_ = false, working_ = false;
  // Of the session, which a job may be writing to.
  TwoShotStep step_ = TwoShotStep::PlaceCamera;
  int shot_ = 0;
  QPointer<QWidget> body_;
  LiveView* view_ = nullptr;
  QWidget *beginBox_ = nullptr, *cameraBox_ = nullptr, *lightBox_ = nullptr, *photoBox_ = nullptr,
          *handsBox_ = nullptr, *workBox_ = nullptr;
  QLineEdit* folder_ = nullptr;
  QLabel *where_ = nullptr, *numbers_ = nullptr, *lightWords_ = nullptr, *photoWords_ = nullptr,
         *said_ = nullptr;
  QPushButton *begin_ = nullptr, *place_ = nullptr, *accept_ = nullptr, *placeLight_ = nullptr,
              *acceptLight_ = nullptr, *photo_ = nullptr, *tile_ = nullptr, *retake_ = nullptr,
              *cancel_ = nullptr;
  QDoubleSpinBox *tilt_ = nullptr, *azimuth_ = nullptr;
  QProgressBar* progress_ = nullptr;
  JobRunner guideJob_;  ///< last: destroyed first
};

}  // namespace patina
