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
#include <QStandardPaths>
#include <QStatusBar>
#include <QTimer>
#include <QUrl>

#include "widgets/elided_label.h"
#include "widgets/empty_state.h"
#include "widgets/error_banner.h"
#include "widgets/image_view.h"
#include "widgets/map_panel.h"
#include "widgets/photo_strip.h"
#include "widgets/texel_inspector.h"
#include "widgets/theme.h"
#include "widgets/viewport_panel.h"

namespace patina {

namespace {

constexpr int kProgressMs = 200;

std::filesystem::path pathOf(const QString& text) {
  return std::filesystem::path(text.toStdString());
}

/// The folder that a bundle's or fit's path means: the folder itself, or that of its capture.json or
/// fit.json.
QString folderOf(const QString& path) {
  const QFileInfo file(path);
  return QDir::cleanPath(file.isFile() ? file.absolutePath() : file.absoluteFilePath());
}

bool isFit(const QString& path) {
  const QFileInfo file(path);
  if (file.isFile()) return file.fileName() == QStringLiteral("fit.json");
  return QFileInfo::exists(path + QStringLiteral("/fit.json")) &&
         !QFileInfo::exists(path + QStringLiteral("/capture.json"));
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
    pages_->setCurrentWidget(document_.capture() ? workspace_ : empty_);
    refreshActions();
    refreshTitle();
  });
  connect(&fitJob_, &JobRunner::progressed, this, &MainWindow::showProgress);
  connect(&fitJob_, &JobRunner::finished, this, [this] {
    progressPane_->hide();
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
}

void MainWindow::followTexel(std::optional<QPoint> texel) {
  inspector_->setHovered(texel);
  viewport_->setTexel(inspector_->shownTexel());
}

// ---- opening
// --------------------------------------------------------------------------------------------------

void MainWindow::openPath(const QString& path) {
  if (path.isEmpty() || !mayLoseFit(tr("open %1").arg(QFileInfo(path).fileName()), tr("Open"))) return;
  if (fitJob_.running()) fitJob_.abandon();
  if (simulating_) simulationDone();  // its outcome is dropped
  const QString name = QFileInfo(path).fileName() == QStringLiteral("capture.json") ||
                               QFileInfo(path).fileName() == QStringLiteral("fit.json")
                           ? QFileInfo(folderOf(path)).fileName()
                           : QFileInfo(path).fileName();
  empty_->setBusy(tr("Opening %1\u2026").arg(name));
  statusBar()->showMessage(tr("Opening %1\u2026").arg(path), 3000);
  banner_->hide();
  if (isFit(path)) {
    openJob_.start<std::shared_ptr<const FourierFit>>(
        [load = services_.loadFit, folder = folderOf(path)](const JobContext& job) {
          return load(pathOf(folder), job);
        },
        [this, path, name](Result<std::shared_ptr<const FourierFit>> outcome) {
          if (!outcome) {
            if (outcome.error().code == ErrorCode::NotFound) forget(path);
            return banner_->showError(tr("Opening the fit %1").arg(name), outcome.error());
          }
          const auto fit = *outcome;
          opened(std::make_shared<const FourierCapture>(fit->capture()), path);
          document_.adoptFit(fit, tr("open fit"));
          document_.undoStack()->clear();  // opening is not a step
          fitSavedTo_ = folderOf(path);
          fitIsSaved_ = true;
          document_.restoreFitOptions(fit->options());
          if (maps_->kind() == ViewKind::Photo) maps_->setKind(ViewKind::Diffuse);
          refreshTitle();
        });
    return;
  }
  openJob_.start<FourierCapture>(
      [read = services_.readCapture, path](const JobContext& job) { return read(pathOf(path), job); },
      [this, path, name](Result<FourierCapture> outcome) {
        if (!outcome) {
          if (outcome.error().code == ErrorCode::NotFound) forget(path);
          return banner_->showError(tr("Opening %1").arg(name), outcome.error());
        }
        opened(std::make_shared<const FourierCapture>(std::move(*outcome)), path);
        maps_->setKind(ViewKind::Photo);
      });
}

void MainWindow::simulate(const std::string& scene) {
  if (openJob_.running() || !mayLoseFit(tr("make a simulated capture"), tr("Go On"))) return;
  if (fitJob_.running()) fitJob_.abandon();
  const QString name = QString::fromStdString(scene);
  const QString folder = QStandardPaths::writableLocation(QStandardPaths::AppDataLocation) +
                         QStringLiteral("/simulated/") + name;
  banner_->hide();
  empty_->setBusy(tr("Photographing %1\u2026").arg(name));
  showPane(tr("Photographing %1").arg(name), tr("Stop the simulated capture (Esc)"));
  simulating_ = true;
  openJob_.start<FourierCapture>(
      [make = services_.simulate, scene, folder](const JobContext& job) {
        return make(scene, pathOf(folder), job);
      },
      [this, folder, name](Result<FourierCapture> outcome) {
        if (!outcome) {
          if (outcome.error().code == ErrorCode::Cancelled)
            return statusBar()->showMessage(tr("The simulated capture was cancelled."), 8000);
          return banner_->showError(tr("Photographing %1").arg(name), outcome.error());
        }
        opened(std::make_shared<const FourierCapture>(std::move(*outcome)), folder);
        maps_->setKind(ViewKind::Photo);
      });
}

void MainWindow::simulationDone() {
  simulating_ = false;
  if (!fitJob_.running()) progressPane_->hide();
}

void MainWindow::forget(const QString& path) {
  settings_.removeRecent(folderOf(path));
  refreshRecent();
}

void MainWindow::opened(std::shared_ptr<const FourierCapture> capture, const QString& path) {
  openPath_ = folderOf(path);
  fitSavedTo_.clear();
  fitIsSaved_ = true;
  settings_.addRecent(openPath_);
  settings_.set(QStringLiteral("last_folder"), QFileInfo(openPath_).absolutePath());
  refreshRecent();
  document_.openCapture(capture);
  // The first pattern shows more than a black frame does.
  int first = 0;
  for (std::size_t i = 0; i < capture->photos.size(); ++i)
    if (capture->photos[i].role == PhotoRole::Window) {
      first = static_cast<int>(i);
      break;
    }
  strip_->setCurrentPhoto(first);
  strip_->setFocus();  // the arrow keys step through the photographs
  if (!capture->ignoredKeys.empty()) {
    QStringList keys;
    for (const std::string& key : capture->ignoredKeys) keys << QString::fromStdString(key);
    banner_->showNotice(tr("capture.json holds keys that this version doesn't know and doesn't read: %1.")
                            .arg(keys.join(QStringLiteral(", "))));
  }
  refreshHealth();
}

// ---- fitting
// --------------------------------------------------------------------------------------------------

void MainWindow::startFit() {
  const auto capture = document_.capture();
  if (!capture || fitJob_.running()) return;
  banner_->hide();
  estimate_.emplace(settings_.stageSeconds());
  shownStage_.clear();
  showPane(tr("Starting"), tr("Stop the fit; what is finished is kept and marked (Esc)"));
  fitJob_.start<std::shared_ptr<const FourierFit>>(
      [fit = services_.fit, capture, options = document_.fitOptions()](const JobContext& job) {
        return fit(*capture, options, job);
      },
      [this](Result<std::shared_ptr<const FourierFit>> outcome) { fitDone(std::move(outcome)); });
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

void MainWindow::showProgress(const QString& stage, qint64 done, qint64 total, const QString& unit) {
  if (!estimate_) return;
  estimate_->update(stage.toStdString(), done, total);
  // Every change of a label has the whole window composed anew, because of the 3D view in it: a few times a
  // second are enough.
  if (stage == shownStage_ && shownProgress_.isValid() && shownProgress_.elapsed() < kProgressMs) return;
  shownStage_ = stage;
  shownProgress_.restart();
  progress_->setValue(static_cast<int>(std::lround(1000 * estimate_->fraction())));
  QString text = QString::fromStdString(ProgressEstimate::title(stage.toStdString()));
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
  const bool running = fitJob_.running(), unsaved = document_.fit() && !fitIsSaved_;
  if (!running && !unsaved) return true;
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
  const auto fit = document_.fit();
  if (!fit || folder.isEmpty()) return;
  statusBar()->showMessage(tr("Saving the fit\u2026"));
  saveJob_.start<Done>(
      [write = services_.writeFit, fit, folder](const JobContext&) { return write(pathOf(folder), *fit); },
      [this, fit, folder](Status outcome) {
        statusBar()->clearMessage();
        if (!outcome) return banner_->showError(tr("Saving the fit"), outcome.error());
        if (document_.fit() == fit) {
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
  if (!capture) {
    setWindowTitle(QStringLiteral("Patina"));
    bundleLabel_->clear();
    return;
  }
  const QString name = QFileInfo(QString::fromStdString(capture->folder.string())).fileName();
  const bool unsaved = document_.fit() && !fitIsSaved_;
  setWindowTitle(
      QStringLiteral("%1%2 \u2014 Patina").arg(name, unsaved ? tr(" (fit not saved)") : QString()));
  const QString shown = capture->sampleName.empty() ? name : QString::fromStdString(capture->sampleName);
  QString text = QStringLiteral("<b>%1</b>")
                     .arg(fontMetrics()
                              .elidedText(shown, Qt::ElideMiddle, fontMetrics().averageCharWidth() * 34)
                              .toHtmlEscaped());
  text += tr("&nbsp;&nbsp;%1 photographs&nbsp;\u00b7&nbsp;%2 \u00d7 %3 mm")
              .arg(capture->photos.size())
              .arg(capture->sampleWidthMm, 0, 'g', 4)
              .arg(capture->sampleHeightMm, 0, 'g', 4);
  bundleLabel_->setText(text);
  bundleLabel_->setToolTip(QString::fromStdString(capture->folder.string()));
}

void MainWindow::refreshHealth() {
  const auto fit = document_.fit();
  if (!fit) {
    healthLabel_->setText(!document_.capture() ? tr("No bundle open")
                          : fitJob_.running()  ? tr("Fitting")
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
