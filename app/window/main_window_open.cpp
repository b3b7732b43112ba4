// The main window's opening of bundles, fits and simulated samples.
#include <QDir>
#include <QFileInfo>
#include <QProgressBar>
#include <QPushButton>
#include <QStackedWidget>
#include <QStandardPaths>
#include <QStatusBar>
#include <QUndoGroup>

#include "app/window/explain_controller.h"
#include "app/window/main_window.h"
#include "app/window/rig/capture_guides.h"
#include "app/window/two_shot_controller.h"
#include "widgets/empty_state.h"
#include "widgets/error_banner.h"
#include "widgets/explain_page.h"
#include "widgets/map_panel.h"
#include "widgets/photo_strip.h"
#include "widgets/shot_strip.h"
#include "widgets/two_shot_page.h"

namespace patina {

namespace {

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

}  // namespace

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
  const bool fit = isFit(path);
  openJob_.start<Opened>(
      [services = services_, path, fit](const JobContext& job) {
        return fit ? readFit(services, folderOf(path), job) : readBundle(services, path, job);
      },
      [this, path, name, fit](Result<Opened> outcome) {
        if (outcome) return take(*outcome, path);
        if (outcome.error().code == ErrorCode::NotFound) forget(path);
        banner_->showError(fit ? tr("Opening the fit %1").arg(name) : tr("Opening %1").arg(name),
                           outcome.error());
      });
}

Result<MainWindow::Opened> MainWindow::readBundle(const Services& services, const QString& path,
                                                  const JobContext& job) {
  Opened opened;
  const auto kind = services.captureKind(pathOf(folderOf(path)));
  if (kind && *kind == "two-shot") {
    auto capture = services.readTwoShot(pathOf(folderOf(path)), job);
    if (!capture) return capture.error();
    opened.twoShot = std::make_shared<const TwoShotCapture>(std::move(*capture));
    return opened;
  }
  if (kind && *kind == "flash") {
    auto capture = services.readFlash(pathOf(folderOf(path)), job);
    if (!capture) return capture.error();
    opened.flash = std::make_shared<const FlashCapture>(std::move(*capture));
    return opened;
  }
  // Any other kind, and what is no bundle at all: this reader says what is wrong with it.
  auto capture = services.readCapture(pathOf(path), job);
  if (!capture) return capture.error();
  opened.fourier = std::make_shared<const FourierCapture>(std::move(*capture));
  return opened;
}

Result<MainWindow::Opened> MainWindow::readFit(const Services& services, const QString& folder,
                                               const JobContext& job) {
  Opened opened;
  if (services.fitKind(pathOf(folder)) == "two-shot") {
    auto fit = services.loadTwoShotFit(pathOf(folder), job);
    if (!fit) return fit.error();
    opened.twoShotFit = std::move(*fit);
    opened.twoShot = std::shared_ptr<const TwoShotCapture>(opened.twoShotFit, &opened.twoShotFit->capture);
    return opened;
  }
  auto fit = services.loadFit(pathOf(folder), job);
  if (!fit) return fit.error();
  opened.fourierFit = std::move(*fit);
  opened.fourier = std::make_shared<const FourierCapture>(opened.fourierFit->capture());
  return opened;
}

void MainWindow::take(const Opened& found, const QString& path) {
  if (found.flash) {
    openedFlash(found.flash, path);
  } else if (found.twoShot) {
    openedTwoShot(found.twoShot, path);
    if (found.twoShotFit) twoShot_->open(found.twoShotFit);
  } else {
    opened(found.fourier, path);
    if (found.fourierFit) {
      document_.adoptFit(found.fourierFit, tr("open fit"));
      document_.undoStack()->clear();  // opening is not a step
      document_.restoreFitOptions(found.fourierFit->options());
      if (maps_->kind() == ViewKind::Photo) maps_->setKind(ViewKind::Diffuse);
    } else {
      maps_->setKind(ViewKind::Photo);
    }
  }
  if (!found.twoShotFit && !found.fourierFit) return;
  fitSavedTo_ = folderOf(path);
  fitIsSaved_ = true;
  refreshTitle();
}

bool MainWindow::somethingOpen() const {
  return document_.capture() || twoShot_->isOpen();
}

bool MainWindow::twoShotOpen() const {
  return twoShot_->isOpen();
}

bool MainWindow::fitted() const {
  return document_.fit() || twoShot_->fitted();
}

QString MainWindow::openBundle() const {
  if (flash_) return QString::fromStdString(flash_->folder.string());
  if (const auto capture = document_.capture()) return QString::fromStdString(capture->folder.string());
  if (const auto capture = twoShot_->document()->capture())
    return QString::fromStdString(capture->folder.string());
  return {};
}

void MainWindow::showOpenPage() {
  const bool twoShot = twoShotOpen();
  const QString bundle = openBundle();
  if (bundle != explain_->bundle()) explainWanted_ = false;  // another bundle is looked at first
  const std::size_t photographs = flash_                ? flash_->photos.size()
                                  : document_.capture() ? document_.capture()->photos.size()
                                  : twoShot_->isOpen()  ? twoShot_->document()->capture()->shots.size()
                                                        : 0;
  explain_->setBundle(bundle, tr("%1 photographs").arg(photographs));
  explain_->page()->setMayGoBack(somethingOpen());
  if (guides_) guides_->leave();
  pages_->setCurrentWidget(explainWanted_ || flash_ ? static_cast<QWidget*>(explain_->page())
                           : twoShot                ? static_cast<QWidget*>(twoShot_->page())
                           : document_.capture()    ? workspace_
                                                    : static_cast<QWidget*>(empty_));
  history_->setActiveStack(twoShot ? twoShot_->document()->undoStack() : document_.undoStack());
  refreshActions();
  refreshTitle();
}

CaptureGuides* MainWindow::captureGuides() {
  if (guides_) return guides_.get();
  guides_ = std::make_unique<CaptureGuides>(services_.rig, settings_, pages_);
  connect(guides_.get(), &CaptureGuides::leaveRequested, this, &MainWindow::leaveCapture);
  const RigController* rig = guides_->rig();
  connect(rig, &RigController::failed, banner_, &ErrorBanner::showError);
  connect(rig, &RigController::noticed, banner_, &ErrorBanner::showNotice);
  connect(rig, &RigController::bundleReady, this,
          [this](const std::filesystem::path& folder) { openPath(QString::fromStdString(folder.string())); });
  return guides_.get();
}

void MainWindow::startCapture(bool twoShot) {
  banner_->hide();
  captureGuides()->show(twoShot ? CaptureGuides::Kind::TwoShot : CaptureGuides::Kind::Fourier);
  refreshActions();
}

void MainWindow::leaveCapture() {
  showOpenPage();
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
  openJob_.start<Opened>(
      [services = services_, scene, folder](const JobContext& job) -> Result<Opened> {
        Opened made;
        for (const auto& [twoShotScene, summary] : services.twoShotScenes)
          if (scene == twoShotScene) {
            auto capture = services.simulateTwoShot(scene, pathOf(folder), job);
            if (!capture) return capture.error();
            made.twoShot = std::make_shared<const TwoShotCapture>(std::move(*capture));
            return made;
          }
        auto capture = services.simulate(scene, pathOf(folder), job);
        if (!capture) return capture.error();
        made.fourier = std::make_shared<const FourierCapture>(std::move(*capture));
        return made;
      },
      [this, folder, name](Result<Opened> outcome) {
        if (outcome) return take(*outcome, folder);
        if (outcome.error().code == ErrorCode::Cancelled)
          return statusBar()->showMessage(tr("The simulated capture was cancelled."), 8000);
        banner_->showError(tr("Photographing %1").arg(name), outcome.error());
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

void MainWindow::noteOpened(const QString& path, const std::vector<std::string>& ignoredKeys) {
  openPath_ = folderOf(path);
  fitSavedTo_.clear();
  fitIsSaved_ = true;
  settings_.addRecent(openPath_);
  settings_.set(QStringLiteral("last_folder"), QFileInfo(openPath_).absolutePath());
  refreshRecent();
  if (ignoredKeys.empty()) return;
  QStringList keys;
  for (const std::string& key : ignoredKeys) keys << QString::fromStdString(key);
  banner_->showNotice(tr("capture.json holds keys that this version doesn't know and doesn't read: %1.")
                          .arg(keys.join(QStringLiteral(", "))));
}

void MainWindow::opened(std::shared_ptr<const FourierCapture> capture, const QString& path) {
  noteOpened(path, capture->ignoredKeys);
  flash_.reset();
  if (twoShotOpen()) twoShot_->document()->close();
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
  refreshHealth();
}

void MainWindow::openedTwoShot(std::shared_ptr<const TwoShotCapture> capture, const QString& path) {
  noteOpened(path, capture->ignoredKeys);
  flash_.reset();
  if (document_.capture()) document_.close();
  twoShot_->document()->openCapture(std::move(capture));
  twoShot_->page()->strip()->setCurrent(0);
  twoShot_->page()->strip()->setFocus();
  refreshHealth();
}

void MainWindow::openedFlash(std::shared_ptr<const FlashCapture> capture, const QString& path) {
  noteOpened(path, capture->ignoredKeys);
  if (document_.capture()) document_.close();
  if (twoShotOpen()) twoShot_->document()->close();
  flash_ = std::move(capture);
  showOpenPage();
  explain_->page()->startButton()->setFocus();
  refreshHealth();
}

}  // namespace patina
