#include "app/window/rig/calibration_step.h"

#include <QComboBox>
#include <QProgressBar>
#include <QPushButton>
#include <QScrollArea>
#include <QTimer>

#include "devices/simulated/live_rig.h"
#include "widgets/live_view.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr int kSideWidth = 360;
constexpr int kMostExposureTries = 12;  ///< then the camera is left as it is
// The live picture's brightest hundredth, of full scale, outside of which the exposure is set anew.
constexpr double kTooDark = 0.2, kTooBright = 0.97, kWanted = 0.7;

QString capitalised(QString text) {
  if (!text.isEmpty()) text[0] = text[0].toUpper();
  return text;
}

/// Light of the value that a hundredth of the picture exceeds, from its histogram of display values.
double brightestLight(const LiveFrame& frame) {
  double brightest = 0;
  for (const auto& channel : frame.histogram) {
    long total = 0, above = 0;
    for (const int count : channel) total += count;
    for (int bin = 63; bin >= 0; --bin) {
      above += channel[static_cast<std::size_t>(bin)];
      if (100 * above < total) continue;
      brightest = std::max(brightest, std::pow((bin + 0.5) / 64, 2.2));
      break;
    }
  }
  return brightest;
}

}  // namespace

QString sentencesOf(const Error& error) {
  QString text = capitalised(QString::fromStdString(error.what)) + QLatin1Char('.');
  if (!error.tryThis.empty())
    text += QStringLiteral("\n") + QObject::tr("Try: %1.").arg(QString::fromStdString(error.tryThis));
  return text;
}

QString sightingInWords(const BoardDetection& found, const Board& board) {
  if (!found.found) return capitalised(QString::fromStdString(found.whyNot));
  QString text = QObject::tr("%1 of %2 corners").arg(found.view.corners.size()).arg(board.cornerCount());
  if (found.view.mirrored) text += QObject::tr(", in the mirror");
  constexpr double kSoftPx = 1.6;
  if (found.sharpnessPx > kSoftPx) text += QObject::tr(", not sharp");
  return text;
}

CalibrationStep::CalibrationStep(RigController& rig, std::string kind) : rig_(rig), kind_(std::move(kind)) {
  connect(&rig_, &RigController::frameArrived, this, [this](const LiveFramePtr& frame) {
    if (!entered_ || !view_) return;
    view_->setFrame(frame);
    judgeExposure(frame);
    frameCame(frame);
  });
  connect(&rig_, &RigController::cameraChanged, this, [this] {
    exposureTries_ = 0;
    refresh();
  });
  connect(&rig_, &RigController::calibrationChanged, this, [this](const QString&) { fillKept(); });
  connect(&rig_.job(), &JobRunner::progressed, this,
          [this](const QString&, qint64 done, qint64 total, const QString&) {
            if (working_) showProgress(done, total);
          });
}

CalibrationStep::~CalibrationStep() = default;

QPushButton* CalibrationStep::makeButton(QWidget* parent, const QString& text, const QString& name,
                                         bool primary) {
  auto* button = new QPushButton(text, parent);
  button->setObjectName(name);
  if (primary) button->setProperty("primary", true);
  return button;
}

QLabel* CalibrationStep::makeCaption(QWidget* parent, const QString& text) {
  auto* label = new QLabel(text, parent);
  label->setWordWrap(true);
  label->setProperty("role", "caption");
  return label;
}

QWidget* CalibrationStep::body(QWidget* parent) {
  if (body_) return body_;
  body_ = new QWidget(parent);
  body_->setObjectName(QString::fromStdString(kind_) + QStringLiteral("-step"));
  view_ = new LiveView(body_);
  auto* scroll = new QScrollArea(body_);
  scroll->setFrameShape(QFrame::NoFrame);
  scroll->setWidgetResizable(true);
  scroll->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  scroll->setFixedWidth(kSideWidth);
  auto* side = new QWidget(scroll);
  auto* column = new QVBoxLayout(side);
  column->setContentsMargins(0, 0, 10, 0);
  column->setSpacing(10);

  const QString name = QString::fromStdString(kind_);
  keptBox_ = new QWidget(side);
  auto* keptColumn = new QVBoxLayout(keptBox_);
  keptColumn->setContentsMargins(0, 0, 0, 0);
  keptColumn->setSpacing(5);
  keptColumn->addWidget(makeCaption(keptBox_, tr("Kept from earlier")));
  kept_ = new QComboBox(keptBox_);
  kept_->setObjectName(name + QStringLiteral("-kept"));
  kept_->setSizeAdjustPolicy(QComboBox::AdjustToMinimumContentsLengthWithIcon);
  kept_->setMinimumContentsLength(20);
  keptColumn->addWidget(kept_);
  keptHint_ = makeCaption(keptBox_, recheckHint());
  keptHint_->setVisible(!recheckHint().isEmpty());
  keptColumn->addWidget(keptHint_);
  reuse_ = makeButton(keptBox_, rechecker() ? tr("Check by a Photograph and Use") : tr("Use It Again"),
                      name + QStringLiteral("-reuse"), false);
  keptColumn->addWidget(reuse_, 0, Qt::AlignLeft);
  column->addWidget(keptBox_);
  connect(reuse_, &QPushButton::clicked, this, &CalibrationStep::reuse);

  buildControls(column, side);

  handsBox_ = new QWidget(side);
  hands_ = hands_ ? hands_ : new QVBoxLayout;
  hands_->setContentsMargins(0, 0, 0, 0);
  hands_->setSpacing(5);
  handsBox_->setLayout(hands_);
  column->addWidget(handsBox_);

  workBox_ = new QWidget(side);
  auto* workRow = new QGridLayout(workBox_);
  workRow->setContentsMargins(0, 0, 0, 0);
  doing_ = new QLabel(workBox_);
  doing_->setWordWrap(true);
  progress_ = new QProgressBar(workBox_);
  progress_->setTextVisible(false);
  cancel_ = makeButton(workBox_, tr("Cancel"), name + QStringLiteral("-cancel"), false);
  workRow->addWidget(doing_, 0, 0, 1, 2);
  workRow->addWidget(progress_, 1, 0);
  workRow->addWidget(cancel_, 1, 1);
  connect(cancel_, &QPushButton::clicked, &rig_.job(), &JobRunner::cancel);
  column->addWidget(workBox_);
  workBox_->hide();

  said_ = new QLabel(side);
  said_->setObjectName(name + QStringLiteral("-said"));
  said_->setWordWrap(true);
  said_->setTextFormat(Qt::PlainText);
  said_->setTextInteractionFlags(Qt::TextSelectableByMouse);
  column->addWidget(said_);
  column->addStretch(1);
  scroll->setWidget(side);

  auto* row = new QHBoxLayout(body_);
  row->setContentsMargins(0, 0, 0, 0);
  row->setSpacing(14);
  auto* left = new QVBoxLayout;
  left->setSpacing(8);
  left->addWidget(view_, 1);
  if (QWidget* below = belowPicture(body_)) left->addWidget(below);
  row->addLayout(left, 1);
  row->addWidget(scroll);
  fillKept();
  refresh();
  return body_;
}

void CalibrationStep::enter() {
  entered_ = true;
  exposureTries_ = 0;
  view_->setFrame(rig_.lastFrame());
  fillKept();
  rig_.setLive(true);
  refresh();
}

void CalibrationStep::leave() {
  entered_ = false;
  if (working_) rig_.job().cancel();
  rig_.setLive(false);
  if (!rig_.busy()) rig_.closeDisplay();
}

QString CalibrationStep::note() const {
  if (!record_ || (state_ != State::Done && state_ != State::Reused)) return {};
  CalibrationRecord shown = *record_;
  shown.device.clear();  // the list is narrow
  return QString::fromStdString(recordInWords(shown, std::chrono::system_clock::now()));
}

QString CalibrationStep::whyNot() const {
  if (working_) return tr("The work that is going on is not over yet.");
  return state_ == State::Failed ? tr("It did not succeed yet: what is wrong stands on the right.")
                                 : tr("This is not calibrated yet.");
}

QString CalibrationStep::said() const {
  return said_ ? said_->text() : QString();
}

QPushButton* CalibrationStep::button(const QString& name) const {
  return body_ ? body_->findChild<QPushButton*>(name) : nullptr;
}

FrameConversion CalibrationStep::conversion() const {
  FrameConversion conversion;
  if (const auto record = store().inUse("camera-response"); record) {
    const auto& stored = std::get<StoredResponse>(record->content);
    conversion.response.assign(stored.curves.begin(), stored.curves.end());
  }
  return conversion;
}

bool CalibrationStep::mayPhotograph() {
  if (!rig_.camera() || !rig_.cameraProblem().isEmpty()) {
    say(tr("The camera is not open.\nTry: go back to the step Camera."), Tone::Problem);
    return false;
  }
  if (rig_.busy()) {
    say(tr("Wait until the work that is going on is over."), Tone::Problem);
    return false;
  }
  return true;
}

void CalibrationStep::photograph(const QString& doing, const PhotographOptions& options,
                                 std::function<void(Photograph)> done) {
  if (!mayPhotograph()) return;
  CameraDevice* camera = rig_.camera();
  work<Photograph>(
      doing, [camera, options](const JobContext& job) { return takePhotograph(*camera, options, job); },
      std::move(done));
}

void CalibrationStep::say(const QString& text, Tone tone) {
  if (!said_) return;
  said_->setText(text);
  const QColor colour = tone == Tone::Good      ? theme::kGood
                        : tone == Tone::Problem ? theme::kWarning
                                                : theme::kText;
  said_->setStyleSheet(QStringLiteral("color: %1").arg(colour.name()));
  if (text.isEmpty()) return;
  // In a small window it may be below the side's end; its height is known when the layout is.
  QTimer::singleShot(0, said_, [said = said_] {
    for (QWidget* parent = said->parentWidget(); parent; parent = parent->parentWidget())
      if (auto* scroll = qobject_cast<QScrollArea*>(parent)) scroll->ensureWidgetVisible(said);
  });
}

bool CalibrationStep::keep(StoredCalibration content, double residual, const char* unit,
                           const std::vector<std::string>& remarks, const Image* map) {
  CalibrationRecord record;
  record.content = std::move(content);
  record.device = deviceName();
  record.taken = std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now());
  record.residual = residual;
  record.residualUnit = unit;
  record.madeBy = "patina " PATINA_VERSION;
  record.remarks = remarks;
  if (const Status kept = store().keep(record, map); !kept) {
    say(sentencesOf(kept.error()), Tone::Problem);
    Q_EMIT rig_.failed(tr("Keeping the calibration"), kept.error());
    return false;
  }
  record_ = std::move(record);
  state_ = State::Done;
  rig_.noteCalibration(kind_);
  refresh();
  return true;
}

void CalibrationStep::setFailed() {
  state_ = State::Failed;
  refresh();
}

void CalibrationStep::setToDo() {
  state_ = State::ToDo;
  record_.reset();
  refresh();
}

std::string CalibrationStep::deviceName() const {
  return rig_.camera() ? rig_.camera()->info().name : std::string();
}

void CalibrationStep::addHand(const QString& text, const QString& name, std::function<HandAct()> make) {
  if (!hands_) {
    hands_ = new QVBoxLayout;
    hands_->addWidget(makeCaption(nullptr, tr("Simulated rig: what an operator would do")));
  }
  auto* button = makeButton(nullptr, text, name, false);
  hands_->addWidget(button, 0, Qt::AlignLeft);
  connect(button, &QPushButton::clicked, this, [this, make = std::move(make)] { doByHand(make()); });
}

void CalibrationStep::doByHand(HandAct act) {
  const std::shared_ptr<LiveRig> simulation = rig_.simulation();
  if (!simulation) return;
  if (rig_.busy()) return say(tr("Wait until the work that is going on is over."), Tone::Problem);
  // As a job: the rig's scene may be in use by the camera for a while.
  rig_.run<Done>(
      tr("Moving things in the simulated rig"),
      [simulation, act = std::move(act)](const JobContext&) -> Status {
        SimulatedHands hands(simulation);
        act(hands);
        return Done{};
      },
      [this](Status) { refresh(); });
}

void CalibrationStep::refresh() {
  if (body_) {
    handsBox_->setVisible(rig_.simulation() != nullptr && hands_->count() > 0);
    workBox_->setVisible(working_);
    reuse_->setEnabled(!working_);
    refreshControls();
  }
  Q_EMIT changed();
}

void CalibrationStep::beginWork(const QString& doing) {
  working_ = true;
  if (doing_) doing_->setText(doing + QStringLiteral("\u2026"));
  if (progress_) progress_->setRange(0, 0);
  say({});
  refresh();
}

void CalibrationStep::endWork(const Error* error) {
  working_ = false;
  if (error) {
    if (error->code == ErrorCode::Cancelled) {
      say(tr("Cancelled. Nothing was changed."));
    } else {
      say(sentencesOf(*error), Tone::Problem);
      if (state_ == State::ToDo) state_ = State::Failed;
    }
  }
  refresh();
}

void CalibrationStep::showProgress(qint64 done, qint64 total) {
  progress_->setRange(0, static_cast<int>(std::max<qint64>(1, total)));
  progress_->setValue(static_cast<int>(done));
}

// ---- what is kept ----

void CalibrationStep::fillKept() {
  if (!kept_) return;
  kept_->clear();
  const auto now = std::chrono::system_clock::now();
  for (const CalibrationStore::Entry& entry : store().list(kind_)) {
    const QString words = QString::fromStdString(recordInWords(entry.record, now));
    kept_->addItem(entry.inUse ? words : tr("%1 (replaced)").arg(words),
                   QString::fromStdString(entry.file.string()));
    kept_->setItemData(kept_->count() - 1, words, Qt::ToolTipRole);
  }
  // What was just made needs no second look.
  keptBox_->setVisible(kept_->count() > 0 && state_ != State::Done);
}

void CalibrationStep::reuse() {
  const std::filesystem::path file = kept_->currentData().toString().toStdString();
  auto record = readCalibration(file, kind_);
  if (!record) return say(sentencesOf(record.error()), Tone::Problem);
  const bool inUse = file == store().file(kind_);
  const auto take = [this, file, inUse, record = *record](const QString& sentence) {
    if (!inUse)
      if (const Status restored = store().restore(file); !restored)
        return say(sentencesOf(restored.error()), Tone::Problem);
    record_ = record;
    state_ = State::Reused;
    say(sentence, Tone::Good);
    rig_.noteCalibration(kind_);
    refresh();
  };
  const Rechecker check = rechecker();
  if (!check)
    return take(
        tr("In use again, as it was: one photograph can't tell whether it still holds. Calibrate anew "
           "if anything was moved or set since."));
  if (!mayPhotograph()) return;
  prepareRecheck();
  CameraDevice* camera = rig_.camera();
  work<Recheck>(
      tr("Checking what is kept by a fresh photograph"),
      [camera, check, record = *record](const JobContext& job) -> Result<Recheck> {
        const Result<Photograph> photo = takePhotograph(*camera, {}, job);
        if (!photo) return photo.error();
        return check(record, *photo, *camera, job);
      },
      [this, take](Recheck recheck) {
        const QString sentence = capitalised(QString::fromStdString(recheck.sentence)) + QLatin1Char('.');
        if (recheck.good) return take(sentence);
        say(sentence, Tone::Problem);
        setFailed();
      });
}

// ---- live exposure ----

void CalibrationStep::judgeExposure(const LiveFramePtr& frame) {
  if (!setsExposure() || rig_.busy() || !rig_.camera() || exposureTries_ >= kMostExposureTries) return;
  if (!frame->metadata.exposureS) return;
  const double light = brightestLight(*frame);
  if (light > kTooDark && light < kTooBright) return;
  std::optional<CameraControl> exposure;
  if (const auto controls = rig_.camera()->controls(); controls)
    for (const CameraControl& control : *controls)
      if (control.id == CameraControlId::ExposureS && control.writable) exposure = control;
  if (!exposure) {
    exposureTries_ = kMostExposureTries;  // it has none that can be set: the operator does
    return;
  }
  // Frames with the setting before are still on their way.
  if (std::abs(*frame->metadata.exposureS / exposure->value - 1) > 0.05) return;
  const double factor = light >= kTooBright ? 0.25 : std::clamp(kWanted / std::max(light, 1e-3), 1.0, 16.0);
  const double wanted = std::clamp(exposure->value * factor, exposure->least, std::min(exposure->most, 0.5));
  ++exposureTries_;
  if (std::abs(wanted / exposure->value - 1) < 0.02) return;
  // What the camera refuses here it also shows: the picture stays as it is.
  static_cast<void>(rig_.setControl(CameraControlId::ExposureS, wanted));
}

}  // namespace patina
