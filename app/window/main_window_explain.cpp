// The main window's closing of the loop: running it, showing what it found, and taking the fit that it made.
#include <QDir>
#include <QFileDialog>
#include <QFileInfo>
#include <QMessageBox>
#include <QPushButton>
#include <QStackedWidget>
#include <QStatusBar>
#include <QTableWidget>

#include "app/window/explain_controller.h"
#include "app/window/main_window.h"
#include "app/window/two_shot_controller.h"
#include "widgets/error_banner.h"
#include "widgets/explain_page.h"
#include "widgets/map_panel.h"

namespace patina {

namespace {

/// Where the settings keep the time of an explanation's stages.
const QString kExplainStages = QStringLiteral("explain_stages");

}  // namespace

void MainWindow::connectExplain() {
  ExplainPage* page = explain_->page();
  connect(page, &ExplainPage::startRequested, this, &MainWindow::startExplain);
  connect(page, &ExplainPage::backRequested, this, [this] { showExplain(false); });
  connect(page, &ExplainPage::saveRequested, this, &MainWindow::chooseExplanationFolder);
  connect(page, &ExplainPage::takeFitRequested, this, &MainWindow::takeExplainedFit);
  connect(page, &ExplainPage::refitRequested, this, [this](const QString& id) {
    if (!explain_->explanation() || !services_.explainWith || fitJob_.running()) return;
    runExplain(explain_->refitWork(id), tr("Fitting with %1").arg(id));
  });
}

bool MainWindow::explainShown() const {
  return pages_->currentWidget() == explain_->page();
}

void MainWindow::showExplain(bool shown) {
  explainWanted_ = shown && !openBundle().isEmpty();
  showOpenPage();
  if (!explainShown()) return;
  ExplainPage* page = explain_->page();
  explain_->explanation() ? page->photographs()->setFocus() : page->startButton()->setFocus();
}

void MainWindow::explainOrShow() {
  if (openBundle().isEmpty()) return;
  showExplain(true);
  if (!explain_->explanation() && !fitJob_.running()) startExplain();
}

void MainWindow::startExplain() {
  if (openBundle().isEmpty() || fitJob_.running() || !services_.explain) return;
  showExplain(true);
  runExplain(explain_->work(), tr("Explaining\u2026"));
}

void MainWindow::runExplain(std::function<Result<Explained>(const JobContext&)> work, const QString& words) {
  banner_->hide();
  shownStage_.clear();
  estimate_.emplace(settings_.stageSeconds(kExplainStages), ProgressEstimate::Clock::now(),
                    ProgressEstimate::Work::Explain);
  showPane(tr("Starting"), tr("Stop; what was found until then is kept and marked (Esc)"));
  explain_->page()->setRunning(true, words);
  fitJob_.start<Explained>(std::move(work),
                           [this](Result<Explained> outcome) { explainDone(std::move(outcome)); });
  refreshActions();
  refreshHealth();
}

void MainWindow::explainDone(Result<Explained> outcome) {
  if (!outcome) {
    if (outcome.error().code == ErrorCode::Cancelled)
      return statusBar()->showMessage(tr("Cancelled before anything was found."), 8000);
    return banner_->showError(tr("Explaining"), outcome.error());
  }
  const ExplanationPtr found = outcome->explanation;
  explain_->adopt(std::move(*outcome));
  if (!found->cancelled) settings_.setStageSeconds(found->seconds, kExplainStages);
  // Somebody who went back to the maps meanwhile stays there, and is told.
  if (!explainShown()) statusBar()->showMessage(tr("Explained: Ctrl+E shows what was found."), 12000);
  refreshTitle();
}

void MainWindow::takeExplainedFit() {
  const ExplanationPtr found = explain_->explanation();
  if (!found) return;
  if (found->fourierAfter && document_.capture()) {
    document_.adoptFit(found->fourierAfter, tr("fit with added effects"));
    if (maps_->kind() == ViewKind::Photo) maps_->setKind(ViewKind::Diffuse);
  } else if (found->twoShotAfter && twoShotOpen()) {
    twoShot_->adopt(found->twoShotAfter, tr("reconstruction with added effects"));
  } else {
    return;
  }
  fitIsSaved_ = false;
  fitSavedTo_.clear();
  showExplain(false);
  refreshTitle();
}

void MainWindow::saveExplanationTo(const QString& folder) {
  const ExplanationPtr explanation = explain_->explanation();
  if (!explanation || folder.isEmpty() || saveJob_.running()) return;
  statusBar()->showMessage(tr("Saving the report\u2026"));
  saveJob_.start<Done>(explain_->saveWork(folder), [this, explanation, folder](Status outcome) {
    statusBar()->clearMessage();
    if (!outcome) return banner_->showError(tr("Saving the report"), outcome.error());
    explain_->noteSaved(explanation);
    settings_.set(QStringLiteral("last_save_folder"), QFileInfo(folder).absolutePath());
    refreshTitle();
    statusBar()->showMessage(tr("Saved: %1").arg(QDir(folder).filePath(QStringLiteral("report.html"))),
                             12000);
  });
}

void MainWindow::chooseExplanationFolder() {
  if (!explain_->explanation()) return;
  QFileDialog dialog(this, tr("Save the Report: Name of a New Folder"), settings_.text("last_save_folder"));
  dialog.setAcceptMode(QFileDialog::AcceptSave);
  dialog.setFileMode(QFileDialog::AnyFile);
  dialog.setOption(QFileDialog::DontConfirmOverwrite);
  dialog.setLabelText(QFileDialog::FileName, tr("Folder:"));
  dialog.selectFile(QFileInfo(openPath_).fileName() + QStringLiteral("_explained"));
  if (dialog.exec() != QDialog::Accepted || dialog.selectedFiles().isEmpty()) return;
  const QString folder = dialog.selectedFiles().front();
  if (QFileInfo::exists(folder + QStringLiteral("/explain.json")) &&
      QMessageBox::question(this, tr("Replace the report?"),
                            tr("%1 already holds a report. Replace it?").arg(folder)) != QMessageBox::Yes)
    return;
  saveExplanationTo(folder);
}

}  // namespace patina
