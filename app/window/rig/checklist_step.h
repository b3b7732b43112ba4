#pragma once

#include <optional>

#include "app/window/rig/rig_controller.h"
#include "engine/acquire/capture_checks.h"
#include "engine/acquire/rig_description.h"
#include "widgets/guide_step.h"

class QDoubleSpinBox;
class QLabel;
class QLineEdit;
class QPushButton;

namespace patina {

class ChecklistPanel;

/// The sample's size, and a look at everything that would spoil its capture.
class ChecklistStep : public GuideStep {
  Q_OBJECT

 public:
  explicit ChecklistStep(RigController& rig);

  QString title() const override;
  QString sentence() const override;
  QWidget* body(QWidget* parent) override;
  void enter() override;
  void leave() override;
  State state() const override;
  QString note() const override;
  QString whyNot() const override;

  /// What the capture is taken with; empty until a check was good. They belong together.
  const std::optional<Checklist>& checklist() const { return checklist_; }
  const std::optional<RigDescription>& description() const { return description_; }
  ChecklistPanel* panel() { return panel_; }

 private:
  void check();
  void forget(const QString& why);
  void sampleChanged();
  void refresh();

  RigController& rig_;
  QWidget* body_ = nullptr;
  QLineEdit* name_ = nullptr;
  QDoubleSpinBox *width_ = nullptr, *height_ = nullptr;
  QLabel* remarks_ = nullptr;
  QPushButton* hand_ = nullptr;  ///< shown with a simulated rig
  ChecklistPanel* panel_ = nullptr;
  std::optional<Checklist> checklist_;
  std::optional<RigDescription> description_;
  bool checking_ = false;
};

}  // namespace patina
