#include "app/window/main_window.h"

#include <QCloseEvent>
#include <QDir>
#include <QFileInfo>
#include <QLabel>
#include <QMenu>
#include <QMessageBox>
#include <QMimeData>
#include <QProgressBar>
#include <QPushButton>
#include <QSplitter>
#include <QStackedWidget>
#include <QStatusBar>
#include <QTimer>
#include <QUndoGroup>
#include <QUrl>

#include "app/window/explain_controller.h"
#include "app/window/rig/capture_guides.h"
#include "app/window/two_shot_controller.h"
#include "widgets/elided_label.h"
#include "widgets/empty_state.h"
#include "widgets/error_banner.h"
#include "widgets/explain_page.h"
#include "widgets/image_view.h"
#include "widgets/map_panel.h"
#include "widgets/photo_strip.h"
#include "widgets/texel_inspector.h"
#include "widgets/theme.h"
#include "widgets/two_shot_page.h"
#include "widgets/viewport_panel.h"

namespace patina {

namespace {

constexpr int kProgressMs = 200;
/// Where the settings keep the time of a reconstruction's stages.
const QString kTwoShotStages = QStringLiteral("two_shot_stages");
const QString kBasisStage = QStringLiteral("built-in basis");

std::filesystem::path pathOf(const QString& text) {
  return std::filesystem::path(text.toStdString());
}

QString droppedPath(const QMimeData* data) {
  for (const QUrl& url : data->urls())
    if (url.isLocalFile()) return url.toLocalFile();
  return {};
}

}  // namespace

MainWindow::MainWindow(Services services, const QString& settingsFile, QWidget* parent)
    : QMainWindow(parent), services_(std::move(services)), settings_(settingsFile) {
  setObjectName(QStringLiteral("mainWindow"));
  setWindowIcon(theme::icon(QStringLiteral("app")));
  setAcceptDrops(true);
  ask_ = [this](const QString& title, const QString& text, const QString& goOn, bool maySave) {
    QMessageBox question(QMessageBox::Question, title, text, QMessageBox::NoButton, this);
    QPushButton* save = maySave ? question.addButton(tr("Save\u2026"), QMessageBox::AcceptRole) : nullptr;
    QPushButton* agreed = question.addButton(goOn, QMessageBox::DestructiveRole);
    QPushButton* stay = question.addButton(QMessageBox::Cancel);
    question.setDefaultButton(save ? save : stay);
    question.exec();
    if (save && question.clickedButton() == save) return Answer::Save;
    return question.clickedButton() == agreed ? Answer::GoOn : Answer::Stay;
  };
  library_ = new PhotoLibrary(services_.readPhoto, this);
  history_ = new QUndoGroup(this);
  history_->addStack(document_.undoStack());
  buildContent();
  buildStatusBar();
  buildActions();
  connectAll();
  restoreState();
  refreshRecent();
  refreshActions();
  refreshTitle();
  refreshHealth();
}

MainWindow::~MainWindow() {
  // Widgets still talk to each other while they are taken down; nothing of that is for this object any more.
  document_.disconnect();
  document_.undoStack()->disconnect();
  explain_->page()->disconnect(this);
  twoShot_->disconnect();
  twoShot_->document()->disconnect();
  twoShot_->document()->undoStack()->disconnect();
  history_->disconnect();
  if (guides_) guides_->disconnect(), guides_->rig()->disconnect();
  for (JobRunner* job : {&openJob_, &fitJob_, &saveJob_}) job->disconnect();
}

void MainWindow::buildContent() {
  empty_ = new EmptyState(this);
  banner_ = new ErrorBanner(this);
  maps_ = new MapPanel(&document_, library_, this);
  viewport_ = new ViewportPanel(&document_, this);
  inspector_ = new TexelInspector(&document_, this);
  strip_ = new PhotoStrip(library_, this);
  strip_->setObjectName(QStringLiteral("photoStrip"));

  right_ = new QSplitter(Qt::Vertical, this);
  right_->setHandleWidth(3);
  right_->addWidget(viewport_);
  right_->addWidget(inspector_);
  right_->setStretchFactor(0, 1);
  right_->setStretchFactor(1, 1);
  right_->setChildrenCollapsible(false);
  columns_ = new QSplitter(Qt::Horizontal, this);
  columns_->setHandleWidth(3);
  columns_->addWidget(maps_);
  columns_->addWidget(right_);
  columns_->setStretchFactor(0, 11);
  columns_->setStretchFactor(1, 9);
  columns_->setChildrenCollapsible(false);
  columns_->setSizes({550, 450});
  right_->setSizes({420, 420});

  workspace_ = new QWidget(this);
  auto* rows = new QVBoxLayout(workspace_);
  rows->setContentsMargins(0, 0, 0, 0);
  rows->setSpacing(0);
  rows->addWidget(columns_, 1);
  rows->addWidget(strip_);
  pages_ = new QStackedWidget(this);
  pages_->addWidget(empty_);
  pages_->addWidget(workspace_);
  twoShot_ = std::make_unique<TwoShotController>(services_, settings_, this);
  pages_->addWidget(twoShot_->page());
  explain_ = std::make_unique<ExplainController>(services_, settings_, this);
  pages_->addWidget(explain_->page());
  history_->addStack(twoShot_->document()->undoStack());
  history_->setActiveStack(document_.undoStack());

  auto* content = new QWidget(this);
  auto* column = new QVBoxLayout(content);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(0);
  column->addWidget(banner_);
  column->addWidget(pages_, 1);
  setCentralWidget(content);
}

void MainWindow::buildStatusBar() {
  healthLabel_ = new ElidedLabel(this);
  healthLabel_->setObjectName(QStringLiteral("health"));
  healthLabel_->setContentsMargins(8, 0, 8, 0);
  healthLabel_->setMinimumWidth(40);
  progressPane_ = new QWidget(this);
  progressPane_->setObjectName(QStringLiteral("progressPane"));
  stageLabel_ = new QLabel(progressPane_);
  stageLabel_->setObjectName(QStringLiteral("stage"));
  stageLabel_->setMinimumWidth(fontMetrics().averageCharWidth() * 40);
  stageLabel_->setAlignment(Qt::AlignRight | Qt::AlignVCenter);
  progress_ = new QProgressBar(progressPane_);
  progress_->setObjectName(QStringLiteral("progress"));
  progress_->setRange(0, 1000);
  progress_->setFixedWidth(fontMetrics().averageCharWidth() * 28);
  progress_->setTextVisible(true);
  progress_->setFormat(QStringLiteral("%p %"));
  leftLabel_ = new QLabel(progressPane_);
  leftLabel_->setObjectName(QStringLiteral("timeLeft"));
  leftLabel_->setMinimumWidth(fontMetrics().averageCharWidth() * 17);
  leftLabel_->setProperty("role", "caption");
  cancelButton_ = new QPushButton(tr("Cancel"), progressPane_);
  cancelButton_->setObjectName(QStringLiteral("cancelButton"));
  cancelButton_->setStyleSheet(QStringLiteral("QPushButton { padding: 2px 12px; }"));
  auto* row = new QHBoxLayout(progressPane_);
  row->setContentsMargins(8, 2, 8, 2);
  row->setSpacing(10);
  row->addWidget(stageLabel_);
  row->addWidget(progress_);
  row->addWidget(leftLabel_);
  row->addWidget(cancelButton_);
  progressPane_->hide();
  statusBar()->setSizeGripEnabled(false);
  statusBar()->addWidget(healthLabel_, 1);
  statusBar()->addPermanentWidget(progressPane_);
}

void MainWindow::connectAll() {
  connect(empty_, &EmptyState::openRequested, this, &MainWindow::chooseBundle);
  connect(empty_, &EmptyState::openFitRequested, this, &MainWindow::chooseFit);
  connect(empty_, &EmptyState::simulateRequested, this, [this] {
    if (!services_.scenes.empty()) simulate(services_.scenes.front().first);
  });
  connect(empty_, &EmptyState::captureRequested, this, &MainWindow::startCapture);
  connect(empty_, &EmptyState::recentRequested, this, &MainWindow::openPath);
  connect(strip_, &PhotoStrip::photoSelected, maps_, &MapPanel::showPhoto);
  connect(strip_, &PhotoStrip::photoActivated, maps_, &MapPanel::showPhoto);
  connect(library_, &PhotoLibrary::photoFailed, this, [this](int, const Error& error) {
    if (!banner_->isVisible()) banner_->showError(tr("Reading a photograph"), error);
  });
  connect(maps_, &MapPanel::texelHovered, this, &MainWindow::followTexel);
  connect(&document_, &Document::pickChanged, this, [this] { followTexel(std::nullopt); });
  connect(&document_, &Document::fitChanged, this, [this] {
    refreshActions();
    refreshHealth();
    refreshTitle();
  });
  connect(&document_, &Document::captureChanged, this, [this] {
    library_->setCapture(document_.capture());
    strip_->reload();
    showOpenPage();
  });
  connect(twoShot_->document(), &TwoShotDocument::captureChanged, this, &MainWindow::showOpenPage);
  connect(twoShot_->document(), &TwoShotDocument::fitChanged, this, [this] {
    refreshActions();
    refreshHealth();
    refreshTitle();
  });
  connect(twoShot_->page()->photos(), &PhotoCache::photoFailed, this, [this](int, const Error& error) {
    if (!banner_->isVisible()) banner_->showError(tr("Reading a photograph"), error);
  });
  connect(twoShot_.get(), &TwoShotController::noticed, banner_, &ErrorBanner::showNotice);
  connect(twoShot_.get(), &TwoShotController::saved, this,
          [this](const QString& file) { statusBar()->showMessage(tr("Saved %1").arg(file), 8000); });
  connect(&fitJob_, &JobRunner::progressed, this, &MainWindow::showProgress);
  connect(&fitJob_, &JobRunner::finished, this, [this] {
    progressPane_->hide();
    explain_->page()->setRunning(false);
    refreshActions();
    refreshHealth();
  });
  connect(&openJob_, &JobRunner::started, this, &MainWindow::refreshActions);
  connect(&openJob_, &JobRunner::progressed, this,
          [this](const QString& stage, qint64 done, qint64 total, const QString&) {
            if (!simulating_ || openJob_.cancelling() || total <= 0) return;
            // Exposing takes nearly all of the time.
            progress_->setValue(static_cast<int>(
                stage == QStringLiteral("expose") ? 950 * done / total : 950 + 50 * done / total));
          });
  connect(&openJob_, &JobRunner::finished, this, [this] {
    empty_->setBusy({});
    if (simulating_) simulationDone();
    refreshActions();
  });
  connect(&saveJob_, &JobRunner::started, this, &MainWindow::refreshActions);
  connect(&saveJob_, &JobRunner::finished, this, &MainWindow::refreshActions);
  for (JobRunner* job : {&openJob_, &fitJob_})
    connect(job, &JobRunner::warned, this, [this](const QString& sentence) {
      if (!banner_->isVisible()) banner_->showNotice(sentence);
    });
  connect(cancelButton_, &QPushButton::clicked, this, &MainWindow::cancelFit);
  connectExplain();
}

void MainWindow::followTexel(std::optional<QPoint> texel) {
  inspector_->setHovered(texel);
  viewport_->setTexel(inspector_->shownTexel());
}

// ---- fitting
// --------------------------------------------------------------------------------------------------

void MainWindow::startFit() {
  if (!somethingOpen() || fitJob_.running()) return;
  showExplain(false);
  explain_->page()->setRunning(true);
  banner_->hide();
  shownStage_.clear();
  if (twoShotOpen()) {
    estimate_.emplace(settings_.stageSeconds(kTwoShotStages), ProgressEstimate::Clock::now(),
                      ProgressEstimate::Work::TwoShotFit);
    showPane(tr("Starting"), tr("Stop the reconstruction (Esc)"));
    fitJob_.start<std::shared_ptr<const TwoShotFit>>(
        twoShot_->fitWork(),
        [this](Result<std::shared_ptr<const TwoShotFit>> outcome) { twoShotFitDone(std::move(outcome)); });
  } else {
    estimate_.emplace(settings_.stageSeconds());
    showPane(tr("Starting"), tr("Stop the fit; what is finished is kept and marked (Esc)"));
    fitJob_.start<std::shared_ptr<const FourierFit>>(
        [fit = services_.fit, capture = document_.capture(),
         options = document_.fitOptions()](const JobContext& job) { return fit(*capture, options, job); },
        [this](Result<std::shared_ptr<const FourierFit>> outcome) { fitDone(std::move(outcome)); });
  }
  refreshActions();
  refreshHealth();
}

void MainWindow::showPane(const QString& stage, const QString& cancelTip) {
  progress_->setValue(0);
  stageLabel_->setText(stage);
  leftLabel_->clear();
  cancelButton_->setEnabled(true);
  cancelButton_->setText(tr("Cancel"));
  cancelButton_->setToolTip(cancelTip);
  progressPane_->show();
}

void MainWindow::cancelFit() {
  if (!fitJob_.running() && !simulating_) return;
  if (simulating_)
    openJob_.cancel();
  else
    fitJob_.cancel();
  cancelButton_->setEnabled(false);
  cancelButton_->setText(tr("Cancelling\u2026"));
  leftLabel_->clear();
  refreshActions();
}

void MainWindow::fitDone(Result<std::shared_ptr<const FourierFit>> outcome) {
  if (!outcome) {
    if (outcome.error().code == ErrorCode::Cancelled)
      return statusBar()->showMessage(tr("The fit was cancelled before any texel was fitted."), 8000);
    return banner_->showError(tr("Fitting"), outcome.error());
  }
  const auto fit = *outcome;
  fitIsSaved_ = false;
  fitSavedTo_.clear();
  document_.adoptFit(fit, fit->stats().cancelled ? tr("cancelled fit") : tr("fit"));
  if (maps_->kind() == ViewKind::Photo) maps_->setKind(ViewKind::Diffuse);
  if (fit->stats().cancelled)
    banner_->showNotice(
        tr("The fit was cancelled: texels that had their turn are kept, the others hold the first guess and "
           "are marked in the status map."));
  else
    settings_.setStageSeconds(fit->stats().seconds);
  refreshTitle();
}

void MainWindow::twoShotFitDone(Result<std::shared_ptr<const TwoShotFit>> outcome) {
  if (!outcome) {
    if (outcome.error().code == ErrorCode::Cancelled)
      return statusBar()->showMessage(tr("The reconstruction was cancelled."), 8000);
    return banner_->showError(tr("Reconstructing"), outcome.error());
  }
  const auto fit = *outcome;
  fitIsSaved_ = false;
  fitSavedTo_.clear();
  twoShot_->adopt(fit, fit->stats.cancelled ? tr("cancelled reconstruction") : tr("reconstruction"));
  if (fit->stats.cancelled)
    banner_->showNotice(tr("The reconstruction was cancelled: what it had by then is shown."));
  else
    settings_.setStageSeconds(fit->stats.seconds, kTwoShotStages);
  refreshTitle();
}

void MainWindow::showProgress(const QString& stage, qint64 done, qint64 total, const QString& unit) {
  if (!estimate_) return;
  if (stage == kBasisStage && estimate_->work() == ProgressEstimate::Work::TwoShotFit) {
    // Made once, before anything is reconstructed: a bar of its own, and the reconstruction's time is counted
    // from its end.
    estimate_.emplace(settings_.stageSeconds(kTwoShotStages), ProgressEstimate::Clock::now(),
                      ProgressEstimate::Work::TwoShotFit);
    stageLabel_->setText(QString::fromStdString(ProgressEstimate::title(stage.toStdString())));
    progress_->setValue(total > 0 ? static_cast<int>(1000 * done / total) : 0);
    return;
  }
  estimate_->update(stage.toStdString(), done, total);
  // Every change of a label has the whole window composed anew, because of the 3D view in it: a few times a
  // second are enough.
  if (stage == shownStage_ && shownProgress_.isValid() && shownProgress_.elapsed() < kProgressMs) return;
  shownStage_ = stage;
  shownProgress_.restart();
  progress_->setValue(static_cast<int>(std::lround(1000 * estimate_->fraction())));
  QString text = QString::fromStdString(ProgressEstimate::title(stage.toStdString(), estimate_->work()));
  if (total > 0 && !unit.isEmpty()) text += QStringLiteral("  %L1 / %L2 %3").arg(done).arg(total).arg(unit);
  stageLabel_->setText(text);
  if (fitJob_.cancelling()) return;
  if (const auto left = estimate_->left()) {
    const long seconds = static_cast<long>(left->count());
    leftLabel_->setText(seconds >= 90 ? tr("about %1 min left").arg((seconds + 30) / 60)
                        : seconds > 1 ? tr("about %1 s left").arg(seconds)
                                      : tr("nearly done"));
  }
}

bool MainWindow::mayLoseFit(const QString& doing, const QString& goOn) {
  const bool running = fitJob_.running(), unsaved = fitted() && !fitIsSaved_;
  if (!running && !unsaved) {
    if (explain_->saved()) return true;
    const Answer answer = ask_(
        tr("The report is not saved"),
        tr("What was found out about this bundle is not saved. Lose it, and %1?").arg(doing), goOn, true);
    if (answer == Answer::Save) chooseExplanationFolder();
    return answer == Answer::GoOn;
  }
  const Answer answer =
      running ? ask_(tr("A fit is running"),
                     tr("A fit is running. Stop it, drop what it has, and %1?").arg(doing), goOn, false)
              : ask_(tr("The fit is not saved"), tr("The fit is not saved. Lose it, and %1?").arg(doing),
                     goOn, true);
  if (answer == Answer::Save) chooseSaveFolder();  // what was asked for can be repeated once that is done
  return answer == Answer::GoOn;
}

// ---- saving
// ---------------------------------------------------------------------------------------------------

void MainWindow::saveFitTo(const QString& folder) {
  if (!fitted() || folder.isEmpty()) return;
  const auto fit = document_.fit();
  const auto reconstruction = twoShot_->document()->fit();
  statusBar()->showMessage(tr("Saving the fit\u2026"));
  std::function<Status(const JobContext&)> work;
  if (twoShotOpen())
    work = twoShot_->saveWork(folder);
  else
    work = [write = services_.writeFit, fit, folder](const JobContext&) {
      return write(pathOf(folder), *fit);
    };
  saveJob_.start<Done>(std::move(work), [this, fit, reconstruction, folder](Status outcome) {
    statusBar()->clearMessage();
    if (!outcome) return banner_->showError(tr("Saving the fit"), outcome.error());
    if (document_.fit() == fit && twoShot_->document()->fit() == reconstruction) {
      fitIsSaved_ = true;
      fitSavedTo_ = folder;
    }
    settings_.set(QStringLiteral("last_save_folder"), QFileInfo(folder).absolutePath());
    settings_.addRecent(QDir::cleanPath(folder));
    refreshRecent();
    refreshTitle();
    statusBar()->showMessage(tr("Saved to %1").arg(folder), 8000);
  });
}

// ---- what the window says
// -------------------------------------------------------------------------------------

void MainWindow::refreshTitle() {
  const auto capture = document_.capture();
  const auto twoShot = twoShot_->document()->capture();
  if (!somethingOpen()) {
    const QString flash = flash_ ? QFileInfo(openPath_).fileName() : QString();
    setWindowTitle(flash_ ? QStringLiteral("%1 \u2014 Patina").arg(flash) : QStringLiteral("Patina"));
    bundleLabel_->setText(flash_ ? tr("<b>%1</b>&nbsp;&nbsp;%2 flash photographs")
                                       .arg(flash.toHtmlEscaped())
                                       .arg(flash_->photos.size())
                                 : QString());
    bundleLabel_->setToolTip(openPath_);
    return;
  }
  const QString folder = QString::fromStdString((capture ? capture->folder : twoShot->folder).string());
  const QString name = QFileInfo(folder).fileName();
  const bool unsaved = fitted() && !fitIsSaved_;
  setWindowTitle(
      QStringLiteral("%1%2 \u2014 Patina").arg(name, unsaved ? tr(" (fit not saved)") : QString()));
  const std::string& sample = capture ? capture->sampleName : twoShot->sampleName;
  const QString shown = sample.empty() ? name : QString::fromStdString(sample);
  QString text = QStringLiteral("<b>%1</b>&nbsp;&nbsp;")
                     .arg(fontMetrics()
                              .elidedText(shown, Qt::ElideMiddle, fontMetrics().averageCharWidth() * 34)
                              .toHtmlEscaped());
  text += twoShot ? twoShot_->summary()
                  : tr("%1 photographs&nbsp;\u00b7&nbsp;%2 \u00d7 %3 mm")
                        .arg(capture->photos.size())
                        .arg(capture->sampleWidthMm, 0, 'g', 4)
                        .arg(capture->sampleHeightMm, 0, 'g', 4);
  bundleLabel_->setText(text);
  bundleLabel_->setToolTip(folder);
}

void MainWindow::refreshHealth() {
  if (twoShotOpen()) {
    healthLabel_->setText(twoShot_->health(fitJob_.running()));
    healthLabel_->setToolTip(twoShot_->healthTip());
    return;
  }
  const auto fit = document_.fit();
  if (!fit) {
    healthLabel_->setText(flash_                 ? tr("Flash photographs: Explain (Ctrl+E) fits them")
                          : !document_.capture() ? tr("No bundle open")
                          : fitJob_.running()    ? tr("Fitting")
                                                 : tr("Not fitted yet. Press F5 to fit."));
    healthLabel_->setToolTip({});
    return;
  }
  const FourierFitStats& stats = fit->stats();
  const auto total = stats.seconds.find("total");
  const double seconds = total == stats.seconds.end() ? 0 : total->second;
  const auto percent = [](double value) {
    return value > 0 ? QString::number(100 * value, 'f', 2) + QStringLiteral(" %") : tr("not known");
  };
  QString text = stats.cancelled ? tr("Cancelled fit") : tr("Fitted");
  text += QStringLiteral("  \u00b7  ") + tr("%L1 points in %2 s").arg(stats.texels).arg(seconds, 0, 'f', 1);
  if (!stats.cancelled) {
    text += QStringLiteral("  \u00b7  ") + tr("fit RMS %1").arg(percent(stats.fitRms));
    if (stats.holdoutRms >= 0) {
      text += QStringLiteral("  \u00b7  ") + tr("held-out RMS %1").arg(percent(stats.holdoutRms));
      if (stats.noiseFloorHoldout > 0)
        text += tr(" (%1 \u00d7 noise)").arg(stats.holdoutRms / stats.noiseFloorHoldout, 0, 'f', 2);
    }
  }
  healthLabel_->setText(text);
  QString tip = tr("Relative RMS of model minus photograph, over the sample's pixels and all "
                   "channels.\nNoise floor: %1 fitted, %2 held out. %3 iterations on average, %4 threads.")
                    .arg(percent(stats.noiseFloorFit), percent(stats.noiseFloorHoldout))
                    .arg(stats.meanIterations, 0, 'f', 1)
                    .arg(stats.threads);
  for (const auto& [stage, value] : stats.seconds)
    if (stage != "total")
      tip += QStringLiteral("\n%1: %2 s")
                 .arg(QString::fromStdString(ProgressEstimate::title(stage)))
                 .arg(value, 0, 'f', 2);
  healthLabel_->setToolTip(tip);
}

// ---- events
// ---------------------------------------------------------------------------------------------------

void MainWindow::closeEvent(QCloseEvent* event) {
  if (!mayLoseFit(tr("quit"), tr("Quit"))) return event->ignore();
  keepState();
  if (guides_) guides_->leave();
  fitJob_.abandon();
  openJob_.abandon();
  event->accept();
}

void MainWindow::dragEnterEvent(QDragEnterEvent* event) {
  if (droppedPath(event->mimeData()).isEmpty()) return;
  empty_->setDropHint(true);
  statusBar()->showMessage(tr("Drop to open"));
  event->acceptProposedAction();
}

void MainWindow::dragLeaveEvent(QDragLeaveEvent*) {
  empty_->setDropHint(false);
  statusBar()->clearMessage();
}

void MainWindow::dropEvent(QDropEvent* event) {
  empty_->setDropHint(false);
  statusBar()->clearMessage();
  const QString path = droppedPath(event->mimeData());
  if (path.isEmpty()) return;
  event->acceptProposedAction();
  // After the drop is over: a question here would hold up the program that it came from.
  QTimer::singleShot(0, this, [this, path] { openPath(path); });
}

}  // namespace patina
