#include "app/window/rig/rig_controller.h"

#include <QStandardPaths>

#include "app/window/rig/live_feed.h"
#include "app/window/settings.h"
#include "devices/simulated/live_rig.h"

namespace patina {

namespace {

const QString kFolder = QStringLiteral("rig/folder");

std::filesystem::path folderOf(const Settings& settings) {
  QString folder = settings.text(kFolder);
  if (folder.isEmpty())
    folder = QStandardPaths::writableLocation(QStandardPaths::AppDataLocation) + QStringLiteral("/rig");
  return folder.toStdString();
}

QString sentenceOf(const Error& error) {
  QString text = QString::fromStdString(error.what);
  if (!text.isEmpty()) text[0] = text[0].toUpper();
  return text + QLatin1Char('.');
}

}  // namespace

RigController::RigController(RigServices services, Settings& settings, QObject* parent)
    : QObject(parent),
      services_(std::move(services)),
      settings_(settings),
      folder_(folderOf(settings)),
      feed_(std::make_unique<LiveFeed>()) {
  connect(feed_.get(), &LiveFeed::arrived, this, [this](const LiveFramePtr& frame) {
    lastFrame_ = frame;
    Q_EMIT frameArrived(frame);
  });
  connect(feed_.get(), &LiveFeed::ended, this, [this](const Error& error) {
    cameraEnded(error);
    Q_EMIT failed(tr("The camera"), error);
  });
}

RigController::~RigController() {
  shutDown();
}

void RigController::shutDown() {
  disconnect();
  for (JobRunner* job : {&job_, &showJob_, &openJob_}) {
    job->disconnect();
    job->abandonAndWait();
  }
  if (camera_) camera_->stop();
  camera_.reset();
  display_.reset();
}

// ---- the camera ----

void RigController::openCamera(const std::string& id) {
  if (job_.running()) return;
  closeCamera();
  cameraId_ = id;
  using Opened = std::shared_ptr<std::pair<std::unique_ptr<CameraDevice>, std::shared_ptr<LiveRig>>>;
  openJob_.start<Opened>(
      [services = services_, id](const JobContext&) -> Result<Opened> {
        Result<std::unique_ptr<CameraDevice>> camera = services.openCamera(id);
        if (!camera) return camera.error();
        auto opened = std::make_shared<Opened::element_type>();
        opened->first = std::move(*camera);
        if (services.simulation) opened->second = services.simulation(id);
        return opened;
      },
      [this](Result<Opened> outcome) {
        if (!outcome) {
          cameraProblem_ = sentenceOf(outcome.error());
          Q_EMIT cameraChanged();
          Q_EMIT failed(tr("Opening the camera"), outcome.error());
          return;
        }
        camera_ = std::move((*outcome)->first);
        simulation_ = (*outcome)->second;
        camera_->preview(feed_->sink());
        startStream();
        Q_EMIT cameraChanged();
      });
  Q_EMIT cameraChanged();
}

void RigController::closeCamera() {
  if (job_.running()) return;
  openJob_.abandon();
  closeDisplay();
  const bool any = camera_ != nullptr || !cameraProblem_.isEmpty();
  if (camera_) camera_->stop();
  camera_.reset();
  simulation_.reset();
  feed_->forget();
  lastFrame_.reset();
  cameraProblem_.clear();
  cameraId_.clear();
  if (any) Q_EMIT cameraChanged();
}

Status RigController::setFormat(const FrameFormat& format) {
  const Error none{ErrorCode::Refused, "the camera is in use by what runs now", "",
                   "wait until that is over"};
  if (!camera_ || job_.running()) return none;
  camera_->stop();
  feed_->forget();
  const Status set = camera_->setFormat(format);
  startStream();
  Q_EMIT cameraChanged();
  return set;
}

Result<double> RigController::setControl(CameraControlId id, double value) {
  if (!camera_ || job_.running())
    return Error{ErrorCode::Refused, "the camera is in use by what runs now", "", "wait until that is over"};
  return camera_->set(id, value);
}

QStringList RigController::holdAutomatics() {
  QStringList remarks;
  if (!camera_ || job_.running()) return remarks;
  const Result<std::vector<CameraControl>> controls = camera_->controls();
  if (!controls) return remarks;
  for (const CameraControl& control : *controls) {
    const bool automatic = control.id == CameraControlId::AutoExposure ||
                           control.id == CameraControlId::AutoWhiteBalance ||
                           control.id == CameraControlId::AutoFocus;
    if (!automatic || control.value == 0) continue;
    if (const Result<double> off = camera_->set(control.id, 0); !off || *off != 0) {
      QString name = QString::fromStdString(controlName(control.id));
      name[0] = name[0].toUpper();
      remarks
          << tr("%1 can't be switched off from here: hold it at the camera, if it can be held.").arg(name);
    }
  }
  return remarks;
}

void RigController::setLive(bool live) {
  live_ = live;
  if (live)
    startStream();
  else
    stopStream();
}

void RigController::startStream() {
  if (!live_ || !camera_ || job_.running() || !cameraProblem_.isEmpty() || camera_->streaming()) return;
  if (const Status started = camera_->start(feed_->sink()); !started) {
    cameraEnded(started.error());
    Q_EMIT failed(tr("The camera"), started.error());
  }
}

void RigController::stopStream() {
  if (camera_ && !job_.running()) camera_->stop();
}

void RigController::cameraEnded(const Error& error) {
  cameraProblem_ = sentenceOf(error);
  Q_EMIT cameraChanged();
}

// ---- the screen ----

void RigController::chooseScreen(const ScreenInfo& screen) {
  const bool other = !screen_ || screen_->id != screen.id || screen_->widthPx != screen.widthPx ||
                     screen_->heightPx != screen.heightPx;
  if (other) {
    closeDisplay();
    latency_.reset();
  }
  screen_ = screen;
  if (simulation_ && screen.id != kSimulatedScreen)
    simulation_->exchangeScreen(screen.widthPx, screen.heightPx);
  Q_EMIT screenChanged();
}

Result<std::shared_ptr<PatternDisplay>> RigController::display() {
  if (display_) return display_;
  if (!screen_)
    return Error{ErrorCode::Refused, "no screen is chosen", "", "choose the screen that lights the sample"};
  if (screen_->id == kSimulatedScreen && simulation_) {
    display_ = simulation_->openDisplay();
    if (latency_) display_->setLatency(*latency_);
    return display_;
  }
  Result<std::shared_ptr<PatternDisplay>> opened =
      services_.openDisplay(screen_->id, simulation_.get(), [this](const Error& error) {
        display_.reset();
        // A job that shows pictures says so itself.
        if (!job_.running()) Q_EMIT failed(tr("The pattern window"), error);
      });
  if (!opened) return opened.error();
  display_ = *opened;
  if (latency_) display_->setLatency(*latency_);
  return display_;
}

void RigController::setLatency(std::optional<std::chrono::microseconds> latency) {
  latency_ = latency;
  if (display_ && latency_) display_->setLatency(*latency_);
  Q_EMIT screenChanged();
}

void RigController::showPicture(const ShownPicture& picture) {
  const Result<std::shared_ptr<PatternDisplay>> opened = display();
  if (!opened) return Q_EMIT failed(tr("The pattern window"), opened.error());
  showJob_.start<Done>(
      [shown = *opened, picture](const JobContext& job) -> Status {
        const Result<OnGlass> glass = shown->show(picture, job.stop);
        if (!glass) return glass.error();
        return Done{};
      },
      [this](Status outcome) {
        if (!outcome && outcome.error().code != ErrorCode::Cancelled &&
            outcome.error().code != ErrorCode::Refused)
          Q_EMIT failed(tr("The pattern window"), outcome.error());
      });
}

void RigController::closeDisplay() {
  showJob_.abandon();
  display_.reset();
}

// ---- calibrations ----

void RigController::setFolder(const std::filesystem::path& folder) {
  if (folder == folder_) return;
  folder_ = folder;
  settings_.set(kFolder, QString::fromStdString(folder.string()));
  Q_EMIT calibrationChanged(QString());
}

std::filesystem::path RigController::file(const std::string& kind) const {
  return folder_ / (kind + ".json");
}

void RigController::noteCalibration(const std::string& kind) {
  Q_EMIT calibrationChanged(QString::fromStdString(kind));
}

// ---- jobs ----

void RigController::beginJob() {
  if (camera_) camera_->stop();
}

void RigController::endJob(const QString& doing, const Error* error) {
  if (error && error->code != ErrorCode::Cancelled) {
    // A camera that is gone is gone for the live picture too; it says so itself.
    Q_EMIT failed(doing, *error);
  }
  startStream();
}

}  // namespace patina
