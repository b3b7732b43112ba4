#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>

#include "app/window/rig/checklist_step.h"
#include "engine/acquire/capture_session.h"
#include "widgets/guide_step.h"

namespace patina {

class CapturePanel;

/// The sequence of photographs: started, held, cancelled, gone on with, single ones taken again. A folder
/// with an unfinished capture is offered to go on with.
class FourierCaptureStep : public GuideStep {
  Q_OBJECT

 public:
  /// `checklist`: what is taken comes from it; must outlive this.
  FourierCaptureStep(RigController& rig, const ChecklistStep& checklist);
  ~FourierCaptureStep() override;

  QString title() const override;
  QString sentence() const override;
  QWidget* body(QWidget* parent) override;
  void enter() override;
  void leave() override;
  State state() const override;
  QString note() const override;
  QString whyNot() const override;
  QString goOnText() const override;

  CapturePanel* panel() { return panel_; }
  /// What is taken (tests take less).
  void setPlan(const CapturePlanOptions& plan);
  void setFolder(const std::filesystem::path& folder);
  std::filesystem::path folder() const { return folder_; }
  bool running() const { return running_; }

 private:
  class Teller;
  void chooseFolder();
  void proposeFolder();
  void start();
  void photographed(int photo, const PhotoState& state, const LiveFramePtr& picture, bool kept);
  void ended(Result<CaptureSession::Outcome> outcome);
  void refreshPlan();
  void refresh();
  double secondsLeft() const;

  RigController& rig_;
  const ChecklistStep& checklist_;
  CapturePanel* panel_ = nullptr;
  CapturePlanOptions plan_;
  std::filesystem::path folder_;
  std::shared_ptr<CaptureSession> session_;
  std::shared_ptr<Teller> teller_;
  bool running_ = false, paused_ = false, complete_ = false, resume_ = false;
  int taken_ = 0, total_ = 0, flawed_ = 0;
  QString remarks_;
  std::chrono::steady_clock::time_point startedAt_;
  int takenAtStart_ = 0;
};

}  // namespace patina
