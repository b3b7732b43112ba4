#pragma once

#include <QDialog>
#include <functional>
#include <memory>
#include <optional>

#include "engine/capture/two_shot_capture.h"
#include "engine/twoshot/plan.h"

class QCheckBox;
class QComboBox;
class QDoubleSpinBox;
class QLabel;
class QProgressBar;
class QPushButton;
class QSpinBox;
class QTableWidget;

namespace patina {

class BasisChooser;
class PlanViewport;

/// What planning gave: a plan, and what the open bundle's directions are expected to do; either may be
/// missing.
struct PlanOutcome {
  std::optional<Plan> plan, reached;
};

/// Where to put camera and light: a form, the search's answer as a drawing, a table and words, beside the
/// directions that the open bundle really reached. Asks its owner to do the work.
class PlanDialog : public QDialog {
  Q_OBJECT

 public:
  explicit PlanDialog(QWidget* parent = nullptr);

  PlanOptions options() const;
  void setOptions(const PlanOptions& options);
  QString basisFile() const;
  void setBasisFile(const QString& file);
  /// The open bundle, whose directions are drawn beside the plan; null: none.
  void setCapture(std::shared_ptr<const TwoShotCapture> capture);
  /// Shows what came out, and that nothing is running any more.
  void setOutcome(const PlanOutcome& outcome);
  const PlanOutcome& outcome() const { return outcome_; }
  void setRunning(bool running);
  bool running() const { return running_; }
  void setProgress(const QString& stage, double fraction);
  /// A sentence at the foot; problems in red.
  void say(const QString& sentence, bool problem = false);
  /// All words of the result, without markup.
  QString words() const;

  PlanViewport* viewport() { return viewport_; }
  QTableWidget* table() { return table_; }
  BasisChooser* basis() { return basis_; }
  /// How the name of a plan's file is asked for; replaced by tests.
  void setChooseFile(std::function<QString()> choose) { chooseFile_ = std::move(choose); }

 Q_SIGNALS:
  void planRequested();
  void judgeRequested();
  void cancelRequested();
  /// `file` ends in .json; a drawing of the same name goes beside it.
  void saveRequested(QString file);

 protected:
  void keyPressEvent(QKeyEvent* event) override;

 private:
  QWidget* buildForm();
  QWidget* buildResult();
  void check();
  void refresh();
  void refreshTable();

  std::shared_ptr<const TwoShotCapture> capture_;
  PlanOutcome outcome_;
  PlanOptions given_;  ///< fields that the form doesn't show
  bool running_ = false, updating_ = false;

  QSpinBox *shots_, *restarts_;
  QDoubleSpinBox *fov_, *poseError_;
  QComboBox *setup_, *region_;
  QCheckBox *keep_, *halfVectors_;
  BasisChooser* basis_;
  QPushButton *plan_, *judge_, *cancel_, *save_, *asBundle_;
  QLabel *problems_, *words_, *stage_, *said_;
  QProgressBar* progress_;
  QWidget* progressPane_;
  PlanViewport* viewport_;
  QTableWidget* table_;
  std::function<QString()> chooseFile_;
};

}  // namespace patina
