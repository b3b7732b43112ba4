#pragma once

#include <QPointer>

#include "app/window/rig/two_shot_task.h"
#include "widgets/guide_step.h"

class QCheckBox;
class QDoubleSpinBox;
class QLabel;
class QProgressBar;
class QPushButton;
class QSpinBox;
class QTableWidget;

namespace patina {

/// Where camera and lamp will stand: a pair that is good for any material, a search, or a plan from a file.
class PlanStep : public GuideStep {
  Q_OBJECT

 public:
  explicit PlanStep(TwoShotTask& task);
  ~PlanStep() override;

  QString title() const override;
  QString sentence() const override;
  QWidget* body(QWidget* parent) override;
  State state() const override;
  QString note() const override;
  QString whyNot() const override;

  QDoubleSpinBox* radius() { return radius_; }
  QDoubleSpinBox* distance() { return distance_; }
  QLabel* words() { return words_; }
  bool planning() const { return job_.running(); }
  /// Takes a plan's shots. For the file dialog, and for tests.
  void openPlan(const QString& file);
  void setChooseFile(std::function<QString()> choose) { choose_ = std::move(choose); }

 private:
  void search();
  double fovDeg() const;  ///< that the sample fills
  void recommended();
  void take(std::vector<PlannedShot> shots, BasisPtr basis, const Plan& expected);
  void refresh();

  TwoShotTask& task_;
  QPointer<QWidget> body_;
  QDoubleSpinBox *radius_ = nullptr, *height_ = nullptr, *distance_ = nullptr;
  QSpinBox* shots_ = nullptr;
  QCheckBox* trusted_ = nullptr;
  QTableWidget* table_ = nullptr;
  QLabel* words_ = nullptr;
  QPushButton *usual_ = nullptr, *search_ = nullptr, *open_ = nullptr, *cancel_ = nullptr;
  QProgressBar* progress_ = nullptr;
  double expected_ = -1;
  std::function<QString()> choose_;
  JobRunner job_;  ///< last: destroyed first
};

}  // namespace patina
