#include "app/window/rig/fourier_capture_step.h"

#include <QDateTime>
#include <QFileDialog>
#include <QPointer>
#include <QStandardPaths>

#include "app/window/settings.h"
#include "engine/acquire/capture_journal.h"
#include "widgets/capture_panel.h"

namespace patina {

namespace {

const QString kUnfinished = QStringLiteral("rig/unfinished_capture");
const QString kParent = QStringLiteral("rig/captures_folder");
constexpr int kShownSide = 640;  ///< of a photograph that is looked at here: all of them are kept in memory
/// What a photograph takes beside exposure and latency, until it is known: reading out, judging, writing.
constexpr double kGuessedRestS = 0.25;

/// A photograph (per second) as a small picture.
LiveFramePtr smallPicture(const Image& perSecond, double exposureS) {
  Image linear = perSecond;
  for (float& sample : linear.samples()) sample *= static_cast<float>(exposureS);
  const LiveFramePtr whole = makeLiveFrame(std::move(linear), {}, {});
  auto small = std::make_shared<LiveFrame>();
  small->shown =
      whole->shown.width() > kShownSide || whole->shown.height() > kShownSide
          ? whole->shown.scaled(kShownSide, kShownSide, Qt::KeepAspectRatio, Qt::SmoothTransformation)
          : whole->shown;
  small->clippedShare = whole->clippedShare;
  return small;
}

QString minutes(double seconds) {
  const int whole = static_cast<int>(std::lround(seconds));
  if (whole >= 90) return FourierCaptureStep::tr("about %1 min").arg((whole + 30) / 60);
  return FourierCaptureStep::tr("about %1 s").arg(std::max(1, whole));
}

}  // namespace

/// Brings what the session says from the job's thread to the window's.
class FourierCaptureStep::Teller : public CaptureObserver {
 public:
  explicit Teller(FourierCaptureStep* step) : step_(step) {}
  void photographed(int photo, const Image& perSecond, const PhotoState& state, bool kept) override {
    const LiveFramePtr picture = smallPicture(perSecond, state.exposureS > 0 ? state.exposureS : 1);
    post([photo, state, picture, kept](FourierCaptureStep& step) {
      step.photographed(photo, state, picture, kept);
    });
  }
  void paused(bool paused) override {
    post([paused](FourierCaptureStep& step) {
      step.paused_ = paused;
      step.refresh();
    });
  }

 private:
  template <typename Call>
  void post(Call call) {
    // The step outlives the job: the controller ends jobs before pages go. What was posted last goes with it.
    QMetaObject::invokeMethod(
        step_, [step = step_, call] { call(*step); }, Qt::QueuedConnection);
  }
  FourierCaptureStep* step_;
};

FourierCaptureStep::FourierCaptureStep(RigController& rig, const ChecklistStep& checklist)
    : rig_(rig), checklist_(checklist), teller_(std::make_shared<Teller>(this)) {
  connect(&checklist_, &GuideStep::changed, this, &FourierCaptureStep::refresh);
}

FourierCaptureStep::~FourierCaptureStep() = default;

QString FourierCaptureStep::title() const {
  return tr("Capture");
}

QString FourierCaptureStep::sentence() const {
  if (running_ && paused_) return tr("Held. Nothing may have moved when you go on.");
  if (running_)
    return tr(
        "Photographs are being taken. Keep the room as it is: no light, no steps, nothing touched. Esc on "
        "the "
        "pattern screen stops it.");
  if (complete_ && flawed_ > 0)
    return tr(
        "All photographs are taken. Some are not good: choose one below and have it taken again, or open the "
        "bundle as it is.");
  if (complete_) return tr("All photographs are taken and good. Open the bundle to fit it.");
  if (resume_) return tr("A capture was begun here. Go on with it, or choose another folder for a new one.");
  return tr("Leave camera, screen and sample as they are, and start.");
}

QWidget* FourierCaptureStep::body(QWidget* parent) {
  if (panel_) return panel_;
  panel_ = new CapturePanel(parent);
  connect(panel_, &CapturePanel::startRequested, this, &FourierCaptureStep::start);
  connect(panel_, &CapturePanel::pauseRequested, this, [this](bool paused) {
    if (!session_) return;
    session_->pause(paused);
    paused_ = paused;
    refresh();
  });
  connect(panel_, &CapturePanel::cancelRequested, this, [this] { rig_.job().cancel(); });
  connect(panel_, &CapturePanel::folderRequested, this, &FourierCaptureStep::chooseFolder);
  connect(panel_, &CapturePanel::retakeRequested, this, [this](int photo) {
    if (!session_ || running_) return;
    if (const Status asked = session_->retake(photo); !asked)
      return Q_EMIT rig_.failed(tr("Taking a photograph again"), asked.error());
    panel_->setWanted(photo);
    refresh();
  });
  return panel_;
}

void FourierCaptureStep::enter() {
  if (folder_.empty()) proposeFolder();
  refreshPlan();
  refresh();
}

void FourierCaptureStep::leave() {
  if (running_) return;  // goes on; coming back shows it
  rig_.closeDisplay();
}

void FourierCaptureStep::setPlan(const CapturePlanOptions& plan) {
  plan_ = plan;
  if (panel_) refreshPlan();
}

void FourierCaptureStep::proposeFolder() {
  const QString unfinished = rig_.settings().text(kUnfinished);
  if (!unfinished.isEmpty() &&
      std::filesystem::exists(std::filesystem::path(unfinished.toStdString()) / kCaptureJournal))
    return setFolder(unfinished.toStdString());
  QString parent = rig_.settings().text(kParent);
  if (parent.isEmpty())
    parent = QStandardPaths::writableLocation(QStandardPaths::AppDataLocation) + QStringLiteral("/captures");
  QString name =
      checklist_.description() ? QString::fromStdString(checklist_.description()->sampleName) : QString();
  for (QChar& letter : name)
    if (!letter.isLetterOrNumber()) letter = QLatin1Char('_');
  if (name.isEmpty()) name = QStringLiteral("capture");
  setFolder((parent + QLatin1Char('/') + name +
             QDateTime::currentDateTime().toString(QStringLiteral("_yyyy-MM-dd_HHmmss")))
                .toStdString());
}

void FourierCaptureStep::setFolder(const std::filesystem::path& folder) {
  if (running_) return;
  folder_ = folder;
  session_.reset();
  complete_ = false;
  taken_ = flawed_ = 0;
  remarks_.clear();
  std::error_code ignored;
  resume_ = std::filesystem::exists(folder / kCaptureJournal, ignored);
  if (panel_) refreshPlan();
  refresh();
}

void FourierCaptureStep::chooseFolder() {
  QFileDialog dialog(panel_, tr("Where the Bundle Goes: Name of a New Folder, or of a Capture to Go On with"),
                     QString::fromStdString(folder_.parent_path().string()));
  dialog.setFileMode(QFileDialog::Directory);
  dialog.setOption(QFileDialog::ShowDirsOnly);
  dialog.setLabelText(QFileDialog::FileName, tr("Folder:"));
  if (dialog.exec() != QDialog::Accepted || dialog.selectedFiles().isEmpty()) return;
  const std::filesystem::path chosen = dialog.selectedFiles().front().toStdString();
  rig_.settings().set(kParent, QString::fromStdString(chosen.parent_path().string()));
  setFolder(chosen);
}

void FourierCaptureStep::start() {
  if (running_ || !rig_.camera() || !checklist_.description() || !checklist_.checklist()) return;
  const auto display = rig_.display();
  if (!display) return Q_EMIT rig_.failed(tr("The pattern window"), display.error());
  CaptureOptions options;
  options.plan = plan_;
  options.exposureS = checklist_.checklist()->exposureS;
  options.gain = checklist_.checklist()->gain;
  options.check = !(options.exposureS > 0);  // a camera that can't be told an exposure is only looked at
  CameraDevice* camera = rig_.camera();
  running_ = true;
  paused_ = false;
  remarks_.clear();
  if (!session_) {
    Result<std::unique_ptr<CaptureSession>> opened =
        CaptureSession::open(folder_, *checklist_.description(), options, resume_);
    if (!opened) {
      running_ = false;
      rig_.closeDisplay();
      Q_EMIT rig_.failed(tr("Starting the capture"), opened.error());
      return refresh();
    }
    session_ = std::move(*opened);
    const std::vector<PhotoState> photos = session_->photos();
    for (std::size_t i = 0; i < photos.size(); ++i)
      if (photos[i].stage != PhotoState::Stage::Waiting)
        panel_->setPhoto(static_cast<int>(i), photos[i], nullptr, true);
  }
  rig_.settings().set(kUnfinished, QString::fromStdString(folder_.string()));
  taken_ = takenAtStart_ = session_->taken();
  total_ = static_cast<int>(session_->plan().photos.size());
  startedAt_ = std::chrono::steady_clock::now();
  rig_.run<CaptureSession::Outcome>(
      tr("The capture"),
      [session = session_, teller = teller_, camera, shown = *display](const JobContext& job) {
        return session->run(*camera, *shown, job, teller.get());
      },
      [this](Result<CaptureSession::Outcome> outcome) { ended(std::move(outcome)); });
  refresh();
}

void FourierCaptureStep::photographed(int photo, const PhotoState& state, const LiveFramePtr& picture,
                                      bool kept) {
  panel_->setPhoto(photo, state, picture, kept);
  if (session_) taken_ = session_->taken();
  refresh();
}

void FourierCaptureStep::ended(Result<CaptureSession::Outcome> outcome) {
  running_ = paused_ = false;
  rig_.closeDisplay();
  taken_ = session_->taken();
  resume_ = true;
  if (outcome) {
    complete_ = outcome->complete;
    flawed_ = outcome->flawed;
    QStringList sentences;
    for (const std::string& remark : outcome->remarks) sentences << QString::fromStdString(remark);
    remarks_ = sentences.join(QLatin1Char(' '));
    if (complete_) {
      rig_.settings().set(kUnfinished, QString());
      rig_.setFinishedBundle(folder_);
    } else if (outcome->cancelled) {
      Q_EMIT rig_.noticed(
          tr("The capture was stopped. %1 of %2 photographs are kept in %3; go on with it when you like.")
              .arg(outcome->taken)
              .arg(outcome->total)
              .arg(QString::fromStdString(folder_.string())));
    }
  }
  refresh();
}

double FourierCaptureStep::secondsLeft() const {
  const int done = taken_ - takenAtStart_;
  if (running_ && done > 2) {
    const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - startedAt_;
    return passed.count() / done * (total_ - taken_);
  }
  double each = kGuessedRestS + (rig_.latency() ? static_cast<double>(rig_.latency()->count()) / 1e6 : 0.15);
  if (checklist_.checklist()) each += checklist_.checklist()->exposureS;
  return each * (total_ - taken_);
}

void FourierCaptureStep::refreshPlan() {
  const CapturePlan plan = makeCapturePlan(plan_);
  total_ = static_cast<int>(plan.photos.size());
  QString words = tr("%1 photographs: the window, black, and %2 frequencies in four phases")
                      .arg(total_)
                      .arg(plan_.fitted.size());
  if (!plan_.heldOut.empty())
    words +=
        tr("; %1 frequencies more are held out, to measure how well the fit predicts what it has not seen")
            .arg(plan_.heldOut.size());
  words += tr(". It takes %1.").arg(minutes(secondsLeft()));
  if (checklist_.description()) {
    Screen screen = checklist_.description()->screen;
    if (rig_.screen()) {
      screen.widthPx = rig_.screen()->widthPx;
      screen.heightPx = rig_.screen()->heightPx;
    }
    std::vector<Eigen::Vector2i> all = plan_.fitted;
    all.insert(all.end(), plan_.heldOut.begin(), plan_.heldOut.end());
    if (const auto fine = tooFine(all, screen); !fine.empty())
      words += QLatin1Char(' ') +
               tr("%1 of the patterns are too fine for this screen's pixels and will be of little use.")
                   .arg(fine.size());
  }
  if (!session_) panel_->setPlan(plan, words);
}

void FourierCaptureStep::refresh() {
  if (panel_) {
    const auto mode = running_    ? (paused_ ? CapturePanel::Mode::Paused : CapturePanel::Mode::Running)
                      : complete_ ? CapturePanel::Mode::Done
                                  : CapturePanel::Mode::Ready;
    panel_->setMode(mode, resume_ && !complete_);
    panel_->setMayStart(!rig_.camera() || !rig_.cameraProblem().isEmpty()
                            ? tr("Not now: no camera is open. Go back to the first step.")
                        : !checklist_.checklist() || !checklist_.checklist()->good()
                            ? tr("Not now: the rig must be checked again. Go back to the checklist.")
                            : QString());
    panel_->setFolder(QString::fromStdString(folder_.string()),
                      (resume_ && !complete_ ? tr("A capture begun in %1") : tr("Goes into %1"))
                              .arg(QString::fromStdString(folder_.string())) +
                          (remarks_.isEmpty() ? QString() : QStringLiteral("\n") + remarks_));
    panel_->setProgress(
        taken_, total_,
        running_     ? (paused_ ? tr("held") : tr("taking photographs"))
        : complete_  ? tr("complete")
        : taken_ > 0 ? tr("stopped")
                     : QString(),
        running_ && !paused_ && taken_ < total_ ? tr("%1 left").arg(minutes(secondsLeft())) : QString());
  }
  Q_EMIT changed();
}

GuideStep::State FourierCaptureStep::state() const {
  return complete_ ? State::Done : State::ToDo;
}

QString FourierCaptureStep::note() const {
  if (complete_) return flawed_ > 0 ? tr("%1 not good").arg(flawed_) : tr("%1 photographs").arg(taken_);
  return taken_ > 0 ? tr("%1 of %2").arg(taken_).arg(total_) : QString();
}

QString FourierCaptureStep::whyNot() const {
  if (complete_) return {};
  return running_ ? tr("Photographs are being taken.") : tr("Not all photographs are taken yet.");
}

QString FourierCaptureStep::goOnText() const {
  return tr("Open the Bundle");
}

}  // namespace patina
