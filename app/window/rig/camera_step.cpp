#include "app/window/rig/camera_step.h"

#include <QFileDialog>

#include "app/window/settings.h"
#include "devices/simulated/live_rig.h"
#include "widgets/camera_panel.h"

namespace patina {

namespace {
const QString kCamera = QStringLiteral("rig/camera");
const QString kFolder = QStringLiteral("rig/watched_folder");
}  // namespace

CameraStep::CameraStep(RigController& rig) : rig_(rig) {
  connect(&rig_, &RigController::cameraChanged, this, &CameraStep::refresh);
  connect(&rig_, &RigController::frameArrived, this, [this](const LiveFramePtr& frame) {
    if (panel_ && entered_) panel_->setFrame(frame);
  });
}

QString CameraStep::title() const {
  return tr("Camera");
}

QString CameraStep::sentence() const {
  if (rig_.openingCamera()) return tr("The camera is being opened.");
  if (!rig_.cameraProblem().isEmpty())
    return rig_.cameraProblem() + QLatin1Char(' ') + tr("Mend that and open it again, or choose another.");
  if (!rig_.camera())
    return tr("Choose the camera that looks at the sample. It must stand still from here to the end.");
  return tr(
      "Point the camera at the sample's place, focus on it, and set exposure and focus so that the picture "
      "is sharp and bright but nothing in it is clipped.");
}

QWidget* CameraStep::body(QWidget* parent) {
  if (panel_) return panel_;
  panel_ = new CameraPanel(parent);
  connect(panel_, &CameraPanel::lookRequested, this, &CameraStep::look);
  connect(panel_, &CameraPanel::openRequested, this, [this](const QString& id) {
    rig_.settings().set(kCamera, id);
    rig_.openCamera(id.toStdString());
  });
  connect(panel_, &CameraPanel::folderRequested, this, &CameraStep::chooseFolder);
  connect(panel_, &CameraPanel::rigFileRequested, this, &CameraStep::chooseRigFile);
  connect(panel_, &CameraPanel::formatRequested, this, [this](int index) {
    if (index < 0 || index >= static_cast<int>(formats_.size())) return;
    const Status set = rig_.setFormat(formats_[static_cast<std::size_t>(index)]);
    if (!set) Q_EMIT rig_.failed(tr("Choosing a format"), set.error());
  });
  connect(panel_, &CameraPanel::controlRequested, this, &CameraStep::setControl);
  refresh();
  return panel_;
}

void CameraStep::enter() {
  entered_ = true;
  look();
  rig_.setLive(true);
  refresh();
}

void CameraStep::leave() {
  entered_ = false;
  rig_.setLive(false);
}

void CameraStep::look() {
  if (lookJob_.running()) return;
  panel_->setLooking(true);
  using Found = std::pair<std::vector<CameraInfo>, std::vector<std::string>>;
  lookJob_.start<Found>(
      [list = rig_.services().listCameras](const JobContext&) -> Result<Found> {
        Found found;
        found.first = list(&found.second);
        return found;
      },
      [this](Result<Found> outcome) {
        panel_->setLooking(false);
        if (!outcome) return Q_EMIT rig_.failed(tr("Looking for cameras"), outcome.error());
        cameras_ = std::move(outcome->first);
        lookRemarks_.clear();
        for (const std::string& remark : outcome->second) lookRemarks_ << QString::fromStdString(remark);
        refresh();
      });
}

void CameraStep::cameraOpened() {
  known_ = rig_.camera();
  remarks_.clear();
  formats_.clear();
  if (!known_) return;
  remarks_ = rig_.holdAutomatics();
  if (Result<std::vector<FrameFormat>> formats = rig_.camera()->formats()) formats_ = std::move(*formats);
  // Linear ones come first; what a camera starts with is often compressed.
  if (!formats_.empty() && isLinear(formats_.front().layout) && !isLinear(rig_.camera()->format().layout))
    if (const Status set = rig_.setFormat(formats_.front()); !set)
      remarks_ << QString::fromStdString(set.error().sentence());
  if (!isLinear(rig_.camera()->format().layout))
    remarks_ << tr("This format is not linear in light: measure the camera's response, or choose another.");
}

void CameraStep::refresh() {
  if (rig_.camera() != known_) cameraOpened();
  if (panel_) {
    // What is open is among them, though no list knows it: a folder, a rig's file.
    std::vector<CameraInfo> cameras = cameras_;
    const std::string open = rig_.camera() ? rig_.cameraId() : std::string();
    if (!open.empty() && std::ranges::find(cameras, open, &CameraInfo::id) == cameras.end()) {
      CameraInfo info = rig_.camera()->info();
      info.id = open;
      cameras.insert(cameras.begin(), info);
    }
    panel_->setOpened(QString::fromStdString(open), rig_.cameraProblem());
    panel_->setCameras(cameras, rig_.settings().text(kCamera));
    panel_->setFormats(formats_, rig_.camera() ? rig_.camera()->format() : FrameFormat{});
    std::vector<CameraControl> controls;
    if (rig_.camera() && !rig_.busy())
      if (Result<std::vector<CameraControl>> read = rig_.camera()->controls()) controls = std::move(*read);
    panel_->setControls(controls);
    panel_->setRemarks(lookRemarks_ + remarks_);
  }
  Q_EMIT changed();
}

void CameraStep::setControl(CameraControlId id, double value) {
  const Result<double> set = rig_.setControl(id, value);
  if (!set) Q_EMIT rig_.failed(tr("Setting the camera"), set.error());
  if (!rig_.camera() || rig_.busy()) return;
  if (const Result<std::vector<CameraControl>> read = rig_.camera()->controls()) panel_->setControls(*read);
}

void CameraStep::chooseFolder() {
  const QString folder = QFileDialog::getExistingDirectory(
      panel_, tr("The Folder into which Photographs Come"), rig_.settings().text(kFolder));
  if (folder.isEmpty()) return;
  rig_.settings().set(kFolder, folder);
  rig_.openCamera("folder:" + folder.toStdString());
}

void CameraStep::chooseRigFile() {
  const QString file = QFileDialog::getOpenFileName(panel_, tr("A Simulated Rig"), {}, tr("Rigs (*.json)"));
  if (!file.isEmpty()) rig_.openCamera("simulated:" + file.toStdString());
}

GuideStep::State CameraStep::state() const {
  if (!rig_.cameraProblem().isEmpty()) return State::Failed;
  return rig_.camera() ? State::Done : State::ToDo;
}

QString CameraStep::note() const {
  return rig_.camera() ? QString::fromStdString(rig_.camera()->info().name) : QString();
}

QString CameraStep::whyNot() const {
  if (!rig_.cameraProblem().isEmpty()) return rig_.cameraProblem();
  return rig_.openingCamera() ? tr("The camera is being opened.") : tr("No camera is open yet.");
}

}  // namespace patina
