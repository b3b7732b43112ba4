#pragma once

#include "app/window/job_runner.h"
#include "app/window/rig/rig_controller.h"
#include "widgets/guide_step.h"

namespace patina {

class CameraPanel;

/// Which camera, how it sends its pictures, and what it is set to.
class CameraStep : public GuideStep {
  Q_OBJECT

 public:
  explicit CameraStep(RigController& rig);

  QString title() const override;
  QString sentence() const override;
  QWidget* body(QWidget* parent) override;
  void enter() override;
  void leave() override;
  State state() const override;
  QString note() const override;
  QString whyNot() const override;

  CameraPanel* panel() { return panel_; }

 private:
  void look();
  void refresh();
  void cameraOpened();
  void chooseFolder();
  void chooseRigFile();
  void setControl(CameraControlId id, double value);

  RigController& rig_;
  CameraPanel* panel_ = nullptr;
  std::vector<CameraInfo> cameras_;
  std::vector<FrameFormat> formats_;
  QStringList remarks_, lookRemarks_;
  const CameraDevice* known_ = nullptr;  ///< whose automatics were held and whose formats were read
  bool entered_ = false;
  JobRunner lookJob_;  ///< last: destroyed first
};

}  // namespace patina
