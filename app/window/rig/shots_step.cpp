#include "app/window/rig/shots_step.h"

#include <Eigen/Geometry>
#include <QDateTime>
#include <QDir>
#include <QDoubleSpinBox>
#include <QFileDialog>
#include <QGridLayout>
#include <QLineEdit>
#include <QProgressBar>
#include <QPushButton>
#include <QScrollArea>
#include <QStandardPaths>
#include <QTimer>
#include <numbers>

#include "app/window/rig/calibration_step.h"
#include "app/window/rig/white_tile_step.h"
#include "widgets/live_view.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kSideWidth = 360;

QString freshFolder() {
  return QStandardPaths::writableLocation(QStandardPaths::DocumentsLocation) +
         QStringLiteral("/Patina/two-shot ") +
         QDateTime::currentDateTime().toString(QStringLiteral("yyyy-MM-dd hhmm"));
}

}  // namespace

ShotsStep::ShotsStep(TwoShotTask& task) : task_(task) {
  connect(&watcher_, &BoardWatcher::seen, this, &ShotsStep::saw);
  connect(&task_.rig(), &RigController::frameArrived, this, [this](const LiveFramePtr& frame) {
    if (!entered_ || !view_) return;
    view_->setFrame(frame);
    watcher_.look(frame);
  });
  connect(&task_, &TwoShotTask::changed, this, [this] {
    // Another plan or sample is another capture; what was taken is on disk and can be gone on with.
    if (!working_) session_.reset();
    refresh();
  });
  connect(&task_.rig().job(), &JobRunner::progressed, this,
          [this](const QString&, qint64 done, qint64 total) {
            if (!working_) return;
            progress_->setRange(0, static_cast<int>(std::max<qint64>(1, total)));
            progress_->setValue(static_cast<int>(done));
          });
}

ShotsStep::~ShotsStep() {
  guideJob_.disconnect();
}

QString ShotsStep::title() const {
  return tr("Shots");
}

QString ShotsStep::sentence() const {
  if (!session_)
    return tr(
        "Lay the markers on the table and the sample in their middle, mount camera and lamp on stands, and "
        "say where the photographs go.");
  const int shot = shot_ + 1;
  const int shots = static_cast<int>(session_->setup().shots.size());
  switch (step_) {
    case TwoShotStep::PlaceCamera:
      return tr("Shot %1 of %2: move the camera as the picture says, and take its place when it is right.")
          .arg(shot)
          .arg(shots);
    case TwoShotStep::PlaceLight:
      return tr("Shot %1 of %2: move the lamp, and enter its direction as measured. The dashed line shows "
                "where the "
                "shadow of a pin of 20 mm in the middle must fall.")
          .arg(shot)
          .arg(shots);
    case TwoShotStep::PhotographSample:
      return tr("Shot %1 of %2: touch nothing and photograph the sample.").arg(shot).arg(shots);
    case TwoShotStep::PlaceTile:
      return tr("Shot %1 of %2: put the white tile in the sample's place, without moving camera or lamp.")
          .arg(shot)
          .arg(shots);
    case TwoShotStep::PhotographTile:
      return tr("Shot %1 of %2: photograph the tile.").arg(shot).arg(shots);
    case TwoShotStep::Done:
      break;
  }
  return tr("All shots are taken. The capture opens in the window, where it is reconstructed.");
}

QWidget* ShotsStep::body(QWidget* parent) {
  if (body_) return body_;
  body_ = new QWidget(parent);
  body_->setObjectName(QStringLiteral("shots-step"));
  view_ = new LiveView(body_);
  view_->setOverlay([this](QPainter& painter, const QTransform& transform) { drawOver(painter, transform); });
  auto* scroll = new QScrollArea(body_);
  scroll->setFrameShape(QFrame::NoFrame);
  scroll->setWidgetResizable(true);
  scroll->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  scroll->setFixedWidth(kSideWidth);
  auto* side = new QWidget(scroll);
  auto* column = new QVBoxLayout(side);
  column->setContentsMargins(0, 0, 10, 0);
  column->setSpacing(12);
  const auto button = [](QWidget* owner, const QString& text, const char* name, bool primary) {
    auto* made = new QPushButton(text, owner);
    made->setObjectName(QLatin1String(name));
    if (primary) made->setProperty("primary", true);
    return made;
  };
  const auto box = [&](QWidget*& which) {
    which = new QWidget(side);
    auto* layout = new QVBoxLayout(which);
    layout->setContentsMargins(0, 0, 0, 0);
    layout->setSpacing(8);
    column->addWidget(which);
    return layout;
  };
  const auto label = [](QWidget* owner, const char* name) {
    auto* made = new QLabel(owner);
    made->setObjectName(QLatin1String(name));
    made->setWordWrap(true);
    return made;
  };

  QVBoxLayout* layout = box(beginBox_);
  layout->addWidget(new QLabel(tr("Folder of the capture"), beginBox_));
  folder_ = new QLineEdit(freshFolder(), beginBox_);
  folder_->setObjectName(QStringLiteral("shots-folder"));
  layout->addWidget(folder_);
  auto* choose = button(beginBox_, tr("Choose\u2026"), "shots-choose", false);
  layout->addWidget(choose, 0, Qt::AlignLeft);
  connect(choose, &QPushButton::clicked, this, [this] {
    const QString chosen = QFileDialog::getExistingDirectory(body_, tr("Folder of the Capture"));
    if (!chosen.isEmpty()) folder_->setText(chosen);
  });
  begin_ = button(beginBox_, tr("Begin, or Go On"), "shots-begin", true);
  layout->addWidget(begin_, 0, Qt::AlignLeft);
  connect(begin_, &QPushButton::clicked, this, &ShotsStep::begin);

  where_ = label(side, "shots-where");
  where_->setTextFormat(Qt::PlainText);
  column->addWidget(where_);

  layout = box(cameraBox_);
  numbers_ = label(cameraBox_, "shots-numbers");
  layout->addWidget(numbers_);
  place_ = button(cameraBox_, tr("Take This Place"), "camera-place", true);
  accept_ = button(cameraBox_, tr("Accept the Price"), "camera-accept", false);
  layout->addWidget(place_, 0, Qt::AlignLeft);
  layout->addWidget(accept_, 0, Qt::AlignLeft);
  connect(place_, &QPushButton::clicked, this, [this] { placeCamera(false); });
  connect(accept_, &QPushButton::clicked, this, [this] { placeCamera(true); });

  layout = box(lightBox_);
  auto* grid = new QGridLayout;
  const auto angle = [&](const char* name, const QString& words, double least, double most) {
    auto* made = new QDoubleSpinBox(lightBox_);
    made->setObjectName(QLatin1String(name));
    made->setAccessibleName(words);
    made->setRange(least, most);
    made->setDecimals(2);
    made->setSingleStep(0.5);
    made->setSuffix(QStringLiteral("\u00b0"));
    const int row = grid->rowCount();
    grid->addWidget(new QLabel(words, lightBox_), row, 0);
    grid->addWidget(made, row, 1);
    connect(made, &QDoubleSpinBox::valueChanged, this, &ShotsStep::lightChanged);
    return made;
  };
  tilt_ = angle("light-tilt", tr("Lamp from the normal"), 0, 89);
  azimuth_ = angle("light-azimuth", tr("Its azimuth"), -180, 180);
  layout->addLayout(grid);
  lightWords_ = label(lightBox_, "light-words");
  layout->addWidget(lightWords_);
  placeLight_ = button(lightBox_, tr("The Lamp Stands There"), "light-place", true);
  acceptLight_ = button(lightBox_, tr("Accept the Price"), "light-accept", false);
  layout->addWidget(placeLight_, 0, Qt::AlignLeft);
  layout->addWidget(acceptLight_, 0, Qt::AlignLeft);
  connect(placeLight_, &QPushButton::clicked, this, [this] { placeLight(false); });
  connect(acceptLight_, &QPushButton::clicked, this, [this] { placeLight(true); });

  layout = box(photoBox_);
  photoWords_ = label(photoBox_, "photo-words");
  layout->addWidget(photoWords_);
  photo_ = button(photoBox_, tr("Photograph"), "shots-photograph", true);
  tile_ = button(photoBox_, tr("The Tile Lies There"), "shots-tile", true);
  retake_ = button(photoBox_, tr("Begin This Shot Again"), "shots-retake", false);
  layout->addWidget(photo_, 0, Qt::AlignLeft);
  layout->addWidget(tile_, 0, Qt::AlignLeft);
  layout->addWidget(retake_, 0, Qt::AlignLeft);
  connect(photo_, &QPushButton::clicked, this, &ShotsStep::photograph);
  connect(tile_, &QPushButton::clicked, this, &ShotsStep::tilePlaced);
  connect(retake_, &QPushButton::clicked, this, &ShotsStep::retake);

  layout = box(handsBox_);
  buildHands(layout, handsBox_);

  workBox_ = new QWidget(side);
  auto* workRow = new QHBoxLayout(workBox_);
  workRow->setContentsMargins(0, 0, 0, 0);
  progress_ = new QProgressBar(workBox_);
  progress_->setTextVisible(false);
  cancel_ = button(workBox_, tr("Cancel"), "shots-cancel", false);
  workRow->addWidget(progress_, 1);
  workRow->addWidget(cancel_);
  connect(cancel_, &QPushButton::clicked, &task_.rig().job(), &JobRunner::cancel);
  column->addWidget(workBox_);
  said_ = label(side, "shots-said");
  said_->setTextFormat(Qt::PlainText);
  column->addWidget(said_);
  column->addStretch(1);
  scroll->setWidget(side);
  auto* row = new QHBoxLayout(body_);
  row->setContentsMargins(0, 0, 0, 0);
  row->setSpacing(14);
  row->addWidget(view_, 1);
  row->addWidget(scroll);
  refresh();
  return body_;
}

void ShotsStep::enter() {
  entered_ = true;
  watcher_.setBoards({{task_.markers().board, BoardSide::Direct}});
  view_->setFrame(task_.rig().lastFrame());
  task_.rig().setLive(true);
  refresh();
}

void ShotsStep::leave() {
  entered_ = false;
  watcher_.forget();
  if (working_) task_.rig().job().cancel();
  task_.rig().setLive(false);
}

GuideStep::State ShotsStep::state() const {
  return session_ && step_ == TwoShotStep::Done ? State::Done : State::ToDo;
}

QString ShotsStep::note() const {
  if (!session_) return {};
  if (state() == State::Done) return tr("%1 shots").arg(session_->setup().shots.size());
  return tr("shot %1 of %2").arg(shot_ + 1).arg(session_->setup().shots.size());
}

QString ShotsStep::whyNot() const {
  return tr("The shots are not all taken yet.");
}

QString ShotsStep::goOnText() const {
  return tr("Open the Capture");
}

QString ShotsStep::said() const {
  return said_ ? said_->text() : QString();
}

void ShotsStep::say(const QString& text, bool problem) {
  said_->setText(text);
  said_->setStyleSheet(QStringLiteral("color: %1").arg((problem ? theme::kWarning : theme::kGood).name()));
}

// ---- the session ----

void ShotsStep::sync() {
  if (!session_ || working_) return;
  step_ = session_->step();
  shot_ = session_->shot();
}

void ShotsStep::begin() {
  const auto lens = task_.lens();
  if (!lens) return say(tr("The camera's lens is not known.\nTry: the step Checkerboard first."), true);
  const std::filesystem::path folder = folder_->text().toStdString();
  std::error_code code;
  std::filesystem::create_directories(folder.parent_path(), code);
  auto opened = TwoShotSession::open(folder, task_.setup(), false);
  if (!opened && opened.error().code == ErrorCode::Refused)
    opened = TwoShotSession::open(folder, task_.setup(), true);
  if (!opened) return say(sentencesOf(opened.error()), true);
  session_ = std::move(*opened);
  sync();
  say({}, false);
  if (!session_->setup().shots.empty() && step_ != TwoShotStep::Done)
    setLight(session_->setup().shots[static_cast<std::size_t>(shot_)].directions.toLight);
  if (step_ == TwoShotStep::Done) task_.rig().setFinishedBundle(session_->folder());
  refresh();
}

void ShotsStep::saw(const BoardSightingPtr& sighting) {
  if (!entered_) return;
  sighting_ = sighting;
  guideNow();
  view_->update();
}

void ShotsStep::guideNow() {
  const BoardDetection& found = sighting_->found.front();
  if (!found.found) {
    pose_.reset();
    guide_.reset();
    return refresh();
  }
  if (guideJob_.running()) return;  // the next sighting is newer anyhow
  const auto lens = task_.lens();
  if (!lens) return;
  using Outcome = std::pair<PoseEstimate, std::optional<CameraGuide>>;
  const bool wanted = session_ && !working_ && step_ == TwoShotStep::PlaceCamera;
  guideJob_.start<Outcome>(
      [session = wanted ? session_ : nullptr, lens = *lens, markers = task_.markers(),
       height = task_.sampleHeightMm(), view = found.view](const JobContext&) -> Result<Outcome> {
        const auto pose = poseFromMarkers(lens, markers, height, view);
        if (!pose) return pose.error();
        Outcome outcome{*pose, std::nullopt};
        if (session) outcome.second = session->guideCamera(pose->camera);
        return outcome;
      },
      [this](Result<Outcome> outcome) {
        if (!outcome) {
          pose_.reset();
          guide_.reset();
        } else {
          pose_ = outcome->first;
          guide_ = outcome->second;
        }
        refresh();
        if (view_) view_->update();
      });
}

void ShotsStep::placeCamera(bool accept) {
  if (!session_ || !pose_) return;
  if (guideJob_.running()) {  // it reads the session: place when it is done
    QTimer::singleShot(5, this, [this, accept] { placeCamera(accept); });
    return;
  }
  const Status placed = session_->placeCamera(pose_->camera, accept);
  if (!placed) return say(sentencesOf(placed.error()), true);
  sync();
  guide_.reset();
  setLight(session_->setup().shots[static_cast<std::size_t>(shot_)].directions.toLight);
  say(tr("The camera's place is taken. Do not touch it until this shot is over."), false);
  refresh();
}

Eigen::Vector3d ShotsStep::toLight() const {
  const double theta = tilt_->value() * kDegree, phi = azimuth_->value() * kDegree;
  return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
}

void ShotsStep::setLight(const Eigen::Vector3d& toLight) {
  tilt_->setValue(std::acos(std::clamp(toLight.z(), -1.0, 1.0)) / kDegree);
  azimuth_->setValue(std::atan2(toLight.y(), toLight.x()) / kDegree);
  lightChanged();
}

void ShotsStep::lightChanged() {
  lightGuide_.reset();
  if (session_ && !working_ && step_ == TwoShotStep::PlaceLight)
    lightGuide_ = session_->guideLight(toLight());
  refresh();
  if (view_) view_->update();
}

void ShotsStep::placeLight(bool accept) {
  if (!session_) return;
  const Status placed = session_->placeLight(toLight(), accept);
  if (!placed) return say(sentencesOf(placed.error()), true);
  sync();
  lightGuide_.reset();
  say(tr("The lamp's place is taken."), false);
  refresh();
}

void ShotsStep::photograph() {
  RigController& rig = task_.rig();
  if (!session_ || !rig.camera() || rig.busy()) return;
  const auto lens = task_.lens();
  if (!lens) return say(sentencesOf(lens.error()), true);
  const bool tile = step_ == TwoShotStep::PhotographTile;
  const int shot = shot_;
  working_ = true;
  progress_->setRange(0, 0);
  say({}, false);
  refresh();
  CameraDevice* camera = rig.camera();
  rig.run<Done>(
      tile ? tr("Photographing the tile") : tr("Photographing the sample"),
      [session = session_, camera, lens = *lens, markers = task_.markers(),
       height = task_.sampleHeightMm()](const JobContext& job) -> Status {
        const auto poses = boardPoseSource(lens, markers, height);
        return session->photograph(*camera, poses.get(), job);
      },
      [this, tile, shot](Status outcome) {
        working_ = false;
        sync();
        if (!outcome) {
          if (outcome.error().code == ErrorCode::Cancelled)
            say(tr("Cancelled. What was taken before is kept."), true);
          else
            say(sentencesOf(outcome.error()), true);
        } else if (tile) {
          afterTile(shot);
        } else {
          say(tr("The sample is photographed."), false);
        }
        if (step_ == TwoShotStep::Done) task_.rig().setFinishedBundle(session_->folder());
        if (step_ == TwoShotStep::PlaceCamera)
          setLight(session_->setup().shots[static_cast<std::size_t>(shot_)].directions.toLight);
        refresh();
      });
}

void ShotsStep::afterTile(int shot) {
  // The photograph just taken, looked at as the step White tile does.
  const TwoShotCapture capture = session_->capture();
  for (auto photo = capture.whiteShots.rbegin(); photo != capture.whiteShots.rend(); ++photo) {
    const auto image = readPhoto(capture, *photo);
    if (!image) break;
    WhiteTileOptions options;
    if (const auto region = regionInDisc(photo->camera, task_.radiusMm())) options.region = *region;
    options.exposureS = photo->exposureS;
    options.saturation = capture.saturation;
    const auto tile = calibrateWhiteTile(*image, task_.reflectance(), options);
    if (!tile) return say(sentencesOf(tile.error()), true);
    return say(tr("Shot %1 is whole. %2").arg(shot + 1).arg(tileInWords(*tile)), !tile->passed());
  }
  say(tr("Shot %1 is whole.").arg(shot + 1), false);
}

void ShotsStep::tilePlaced() {
  if (!session_) return;
  const Status placed = session_->tilePlaced();
  if (!placed) return say(sentencesOf(placed.error()), true);
  sync();
  say({}, false);
  refresh();
}

void ShotsStep::retake() {
  if (!session_) return;
  const Status again = session_->retakeShot(shot_);
  if (!again) return say(sentencesOf(again.error()), true);
  sync();
  say(tr("This shot is begun again."), false);
  lightGuide_.reset();
  refresh();
}

}  // namespace patina
