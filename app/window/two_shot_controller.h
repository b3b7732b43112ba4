#pragma once

#include <QObject>
#include <memory>

#include "app/window/job_runner.h"
#include "app/window/services.h"
#include "app/window/settings.h"
#include "widgets/two_shot_document.h"

class QAction;
class QWidget;

namespace patina {

class PlanDialog;
class TwoShotPage;

/// The two-shot half of the window: its document and page, what a reconstruction is made of, and the planning
/// of directions with its dialog and job. The window runs the reconstruction, so that one fit runs at a time.
class TwoShotController : public QObject {
  Q_OBJECT

 public:
  using FitPtr = std::shared_ptr<const TwoShotFit>;

  /// `window`: parent of page and dialogs. `services` and `settings` must outlive this.
  TwoShotController(const Services& services, Settings& settings, QWidget* window);
  ~TwoShotController() override;

  TwoShotDocument* document() { return &document_; }
  TwoShotPage* page() { return page_; }
  bool isOpen() const { return document_.capture() != nullptr; }
  bool fitted() const { return document_.fit() != nullptr; }

  /// A reconstruction of what is open, with the present choices, for a worker.
  std::function<Result<FitPtr>(const JobContext&)> fitWork() const;
  /// Writes the fit into a folder, for a worker.
  std::function<Status(const JobContext&)> saveWork(const QString& folder) const;
  void adopt(FitPtr fit, const QString& how);
  /// A fit that was saved, with its options, after its capture was opened.
  void open(FitPtr fit);
  void editOptions();

  /// Shows the dialog; planning runs on a thread of its own beside a fit.
  void showPlan();
  /// Made at first use.
  PlanDialog* planDialog();
  bool planning() const { return planJob_.running(); }
  void savePlan(const QString& file);

  /// What the window's tool bar and status bar say.
  QString summary() const;
  QString health(bool fitting) const;
  QString healthTip() const;

  void restoreState();
  void keepState();

 Q_SIGNALS:
  /// A sentence for the person that belongs in the window's banner.
  void noticed(QString sentence);
  void saved(QString file);

 private:
  void startPlan(bool search);
  void showPlanProgress(const QString& stage, qint64 done, qint64 total);

  const Services& services_;
  Settings& settings_;
  QWidget* window_;
  TwoShotDocument document_;
  TwoShotPage* page_;
  PlanDialog* plan_ = nullptr;
  JobRunner planJob_;  ///< last: destroyed first, so that no job outlives what it reports to
};

}  // namespace patina
