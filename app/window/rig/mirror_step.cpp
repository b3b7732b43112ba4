#include "app/window/rig/mirror_step.h"

#include <QDoubleSpinBox>
#include <QGuiApplication>
#include <QPushButton>
#include <QScreen>

#include "app/window/settings.h"
#include "devices/simulated/live_rig.h"
#include "widgets/board_chooser.h"
#include "widgets/board_print_dialog.h"
#include "widgets/live_overlay.h"
#include "widgets/theme.h"

namespace patina {

namespace {

const QString kMarkers = QStringLiteral("rig/marker_board");
// Squares that the screen shows: a mirror shows a part of them only, and each corner counts.
constexpr int kSquaresX = 16, kSquaresY = 9;
constexpr int kFramesAveraged = 4;
constexpr double kAngleBound = 0.2, kPositionBound = 0.5;  ///< degrees and mm that are good enough
constexpr int kFewCorners = 12;  ///< of the screen's board, below which the mirror should show more

QDoubleSpinBox* numberBox(QWidget* parent, const QString& name, const QString& words, double least,
                          double most, const QString& suffix) {
  auto* box = new QDoubleSpinBox(parent);
  box->setObjectName(name);
  box->setAccessibleName(words);
  box->setToolTip(words);
  box->setRange(least, most);
  box->setDecimals(2);
  box->setSuffix(suffix);
  return box;
}

}  // namespace

Result<ScreenBoard> screenBoardFor(const ScreenInfo& info) {
  Screen screen;
  screen.widthMm = info.widthMm, screen.heightMm = info.heightMm;
  screen.widthPx = info.widthPx, screen.heightPx = info.heightPx;
  if (!(screen.widthMm > 0 && screen.heightMm > 0))
    return Error{ErrorCode::Invalid, "the screen's size in millimetres is not known", info.name,
                 "measure it with a ruler in the step Screen"};
  // Half a square is left round it; an even number of pixels puts the markers in the middle of theirs.
  const int square = std::min(info.widthPx / (kSquaresX + 1), info.heightPx / (kSquaresY + 1)) / 2 * 2;
  Board board;
  board.squaresX = kSquaresX, board.squaresY = kSquaresY;
  board.squareMm = square * screen.widthMm / std::max(1, screen.widthPx);
  board.markerShare = 0.6;
  board.dictionary = "4x4_250";
  board.firstMarker = 128;
  const Result<Image> drawn = drawBoardPixels(board, square, 0);
  if (!drawn) return drawn.error();
  const int left = (info.widthPx - drawn->width()) / 2, top = (info.heightPx - drawn->height()) / 2;
  auto pixels = std::make_shared<std::vector<std::uint8_t>>(
      static_cast<std::size_t>(info.widthPx) * static_cast<std::size_t>(info.heightPx), std::uint8_t{255});
  for (int y = 0; y < drawn->height(); ++y)
    for (int x = 0; x < drawn->width(); ++x)
      (*pixels)[static_cast<std::size_t>(top + y) * info.widthPx + left + x] =
          drawn->at(x, y) > 0.5f ? 255 : 0;
  ScreenBoard shown;
  shown.placed = boardOnScreen(board, screen, square, {left, top});
  shown.picture.name = "board for the mirror";
  shown.picture.width = info.widthPx;
  shown.picture.height = info.heightPx;
  shown.picture.pixels = std::move(pixels);
  return shown;
}

MirrorStep::MirrorStep(RigController& rig) : CalibrationStep(rig, "screen-pose") {
  connect(&watcher_, &BoardWatcher::seen, this, &MirrorStep::saw);
}

QString MirrorStep::title() const {
  return tr("Mirror");
}

QString MirrorStep::sentence() const {
  if (state() == State::Done || state() == State::Reused)
    return tr(
        "Camera and screen are placed. Neither may be moved from here on; take mirror and markers away.");
  return tr(
      "Take the sample away. Lay a flat mirror in its place and the marker board on it, so that the "
      "camera sees all markers, and in the mirror as much as possible of the squares on the screen.");
}

void MirrorStep::buildControls(QVBoxLayout* column, QWidget* parent) {
  column->addWidget(makeCaption(parent, tr("The marker board")));
  boards_ = new BoardChooser(parent);
  boards_->setBoard(Board::forSamplePlane());
  const QString known = rig().settings().text(kMarkers);
  if (!known.isEmpty())
    if (const auto board = parseBoard(known.toStdString(), "settings")) {
      boards_->setBoard(*board);
      sized_ = true;
    }
  column->addWidget(boards_);
  auto* print = makeButton(parent, tr("Print the Markers\u2026"), QStringLiteral("mirror-print"), false);
  column->addWidget(print, 0, Qt::AlignLeft);
  connect(print, &QPushButton::clicked, this, [this] {
    BoardPrintDialog dialog(boards_->board(), view()->window());
    if (dialog.exec() == QDialog::Accepted) {
      boards_->setBoard(dialog.board());
      boardsChanged();
    }
  });
  x_ = numberBox(parent, QStringLiteral("mirror-x"), tr("Its middle, to the right of the sample's, mm"), -500,
                 500, tr(" mm"));
  y_ = numberBox(parent, QStringLiteral("mirror-y"), tr("Its middle, behind the sample's (towards y), mm"),
                 -500, 500, tr(" mm"));
  turn_ = numberBox(parent, QStringLiteral("mirror-turn"), tr("Turned counter-clockwise, degrees"), -180, 180,
                    QStringLiteral("\u00b0"));
  height_ = numberBox(parent, QStringLiteral("mirror-height"),
                      tr("Height of the reflecting surface over the sample's; a front-surface mirror on the "
                         "table: 0, with the markers lying on it"),
                      -100, 100, tr(" mm"));
  auto* grid = new QGridLayout;
  grid->setVerticalSpacing(5);
  grid->addWidget(new QLabel(tr("Its middle is at"), parent), 0, 0);
  grid->addWidget(x_, 0, 1);
  grid->addWidget(y_, 0, 2);
  grid->addWidget(new QLabel(tr("turned by"), parent), 1, 0);
  grid->addWidget(turn_, 1, 1);
  grid->addWidget(new QLabel(tr("Mirror higher by"), parent), 2, 0);
  grid->addWidget(height_, 2, 1);
  column->addLayout(grid);
  connect(boards_, &BoardChooser::changed, this, &MirrorStep::boardsChanged);

  show_ = makeButton(parent, tr("Show the Squares"), QStringLiteral("mirror-show"), false);
  show_->setToolTip(tr("On the screen that lights the sample"));
  column->addWidget(show_, 0, Qt::AlignLeft);
  connect(show_, &QPushButton::clicked, this, &MirrorStep::showBoard);
  take_ = makeButton(parent, tr("Photograph and Calibrate"), QStringLiteral("mirror-take"), true);
  column->addWidget(take_, 0, Qt::AlignLeft);
  connect(take_, &QPushButton::clicked, this, &MirrorStep::calibrate);
  addHand(tr("Lay Mirror and Markers"), QStringLiteral("hand-mirror"),
          [this] { return [placed = markers()](SimulatedHands& hands) { hands.layMirror(placed); }; });
  view()->setOverlay(
      [this](QPainter& painter, const QTransform& transform) { drawOver(painter, transform); });
}

QWidget* MirrorStep::belowPicture(QWidget* parent) {
  auto* box = new QWidget(parent);
  auto* column = new QVBoxLayout(box);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(3);
  seenMarkers_ = new QLabel(box);
  seenMarkers_->setObjectName(QStringLiteral("mirror-markers"));
  seenMarkers_->setWordWrap(true);
  seenScreen_ = new QLabel(box);
  seenScreen_->setObjectName(QStringLiteral("mirror-screen"));
  seenScreen_->setWordWrap(true);
  column->addWidget(seenMarkers_);
  column->addWidget(seenScreen_);
  return box;
}

PlacedBoard MirrorStep::markers() const {
  if (!x_) return {boards_->board(), {0, 0}, 0};
  return {boards_->board(), {x_->value(), y_->value()}, turn_->value()};
}

void MirrorStep::setMarkers(const PlacedBoard& markers) {
  boards_->setBoard(markers.board);
  x_->setValue(markers.centreMm.x());
  y_->setValue(markers.centreMm.y());
  turn_->setValue(markers.turnDeg);
  boardsChanged();
}

void MirrorStep::enter() {
  CalibrationStep::enter();
  if (rig().simulation() && !sized_) {
    // A small one at the mirror's near edge, as its sample's place is small.
    const SimulatedSheet& sheet = rig().simulation()->setup().sheet;
    Board board = Board::forSamplePlane();
    board.squareMm = std::max(1.0, std::floor(0.55 * sheet.widthMm / board.squaresX));
    board.dictionary = "4x4_250";
    board.markerShare = 0.6;
    board.firstMarker = 0;
    setMarkers({board, {0, -std::floor(0.5 * sheet.heightMm - 0.65 * board.heightMm())}, 0});
  }
  boardsChanged();
  if (!coversThisWindow() && state() != State::Done) showBoard();
}

void MirrorStep::leave() {
  watcher_.forget();
  CalibrationStep::leave();
}

bool MirrorStep::coversThisWindow() const {
  const auto screen = rig().screen();
  if (!screen || !view()->window() || !view()->window()->screen()) return false;
  return view()->window()->screen()->name().toStdString() == screen->id;
}

void MirrorStep::boardsChanged() {
  sized_ = true;
  sighting_.reset();
  result_.reset();
  onScreen_.reset();
  std::vector<WatchedBoard> wanted = {{boards_->board(), BoardSide::Direct}};
  if (const auto screen = rig().screen()) {
    Result<ScreenBoard> shown = screenBoardFor(*screen);
    if (shown) {
      onScreen_ = std::move(*shown);
      wanted.push_back({onScreen_->placed.board, BoardSide::Mirrored});
    } else {
      say(sentencesOf(shown.error()), Tone::Problem);
    }
  }
  watcher_.setBoards(std::move(wanted));
  rig().settings().set(kMarkers, QString::fromStdString(boardText(boards_->board())));
  refresh();
}

void MirrorStep::showBoard() {
  if (!onScreen_ || rig().busy()) return;
  rig().showPicture(onScreen_->picture);
  if (view()->window()) view()->window()->activateWindow();
}

void MirrorStep::frameCame(const LiveFramePtr& frame) {
  watcher_.look(frame);
}

void MirrorStep::saw(const BoardSightingPtr& sighting) {
  if (!entered()) return;
  sighting_ = sighting;
  seenMarkers_->setText(
      tr("Markers: %1").arg(sightingInWords(sighting->found[0], sighting->boards[0].board)));
  if (sighting->found.size() > 1) {
    QString text = tr("Screen: %1").arg(sightingInWords(sighting->found[1], sighting->boards[1].board));
    if (sighting->found[1].found && sighting->found[1].view.corners.size() < kFewCorners)
      text += tr(". More of it should be seen: turn the screen, or move the mirror towards it");
    seenScreen_->setText(text);
  }
  view()->update();
  refreshControls();
}

void MirrorStep::refreshControls() {
  if (!take_) return;
  take_->setEnabled(onScreen_.has_value() && !working());
  show_->setEnabled(onScreen_.has_value() && !working());
}

void MirrorStep::calibrate() {
  if (!mayPhotograph() || !onScreen_) return;
  const auto lens = store().inUse("camera");
  if (!lens) {
    say(tr("The camera's lens is not known.\nTry: the step Checkerboard first."), Tone::Problem);
    return;
  }
  const auto display = rig().display();
  if (!display) return say(sentencesOf(display.error()), Tone::Problem);
  MirrorCalibrationInput input;
  input.camera = std::get<StoredCamera>(lens->content).camera;
  input.screen.widthMm = rig().screen()->widthMm, input.screen.heightMm = rig().screen()->heightMm;
  input.screen.widthPx = rig().screen()->widthPx, input.screen.heightPx = rig().screen()->heightPx;
  input.onSample = markers();
  input.onScreen = onScreen_->placed;
  input.mirrorHeightMm = height_->value();
  PhotographOptions options;
  options.frames = kFramesAveraged;
  options.refreshHz = rig().screen()->refreshHz;
  options.conversion = conversion();
  CameraDevice* camera = rig().camera();
  work<ScreenPoseCalibration>(
      tr("Photographing mirror and markers"),
      [camera, shown = *display, picture = onScreen_->picture, input,
       options](const JobContext& job) -> Result<ScreenPoseCalibration> {
        const Result<OnGlass> glass = shown->show(picture, job.stop);
        if (!glass) return glass.error();
        PhotographOptions when = options;
        when.notBefore = glass->since;
        const Result<Photograph> photo = takePhotograph(*camera, when, job);
        if (!photo) return photo.error();
        BoardDetectionOptions look;
        look.timeLimit = std::chrono::milliseconds(4000);
        return calibrateScreenPose(input, photo->image, look);
      },
      [this, input](ScreenPoseCalibration found) {
        result_ = found;
        const Eigen::Vector3d eye = found.camera.positionMm(), origin = found.screen.originMm;
        QString text = tr("Camera at (%1, %2, %3) mm \u00b1 %4 mm.\nScreen's middle at (%5, %6, %7) mm "
                          "\u00b1 %8 mm, turned within "
                          "%9\u00b0.")
                           .arg(eye.x(), 0, 'f', 1)
                           .arg(eye.y(), 0, 'f', 1)
                           .arg(eye.z(), 0, 'f', 1)
                           .arg(found.cameraPositionSdMm, 0, 'f', 2)
                           .arg(origin.x(), 0, 'f', 1)
                           .arg(origin.y(), 0, 'f', 1)
                           .arg(origin.z(), 0, 'f', 1)
                           .arg(found.screenPositionSdMm, 0, 'f', 2)
                           .arg(found.screenAngleSdDeg, 0, 'f', 2);
        text += tr("\nCorners are %1 px RMS from their predictions.").arg(found.rmsPx, 0, 'f', 3);
        for (const std::string& warning : found.warnings) {
          QString sentence = QString::fromStdString(warning);
          if (!sentence.isEmpty()) sentence[0] = sentence[0].toUpper();
          text += QStringLiteral("\n") + sentence + QLatin1Char('.');
        }
        const bool good = found.screenAngleSdDeg < kAngleBound && found.screenPositionSdMm < kPositionBound;
        if (!good)
          text +=
              tr("\nThat is less sure than it should be (0.2\u00b0, 0.5 mm): let the mirror show more of the "
                 "screen's squares, or move the camera nearer, and photograph again.");
        const StoredScreenPose stored{
            found.camera,         found.screen,           input.onSample,          input.onScreen,
            input.mirrorHeightMm, found.screenAngleSdDeg, found.screenPositionSdMm};
        if (!keep(stored, found.rmsPx, "px", found.warnings)) return;
        say(text, good ? Tone::Good : Tone::Problem);
        rig().closeDisplay();
      });
}

CalibrationStep::Rechecker MirrorStep::rechecker() const {
  return [](const CalibrationRecord& record, const Photograph& photo, CameraDevice&, const JobContext&) {
    return recheckScreenPose(record, photo.image);
  };
}

QString MirrorStep::recheckHint() const {
  return tr("Lay mirror and markers where they lay; the markers alone tell about the camera.");
}

void MirrorStep::prepareRecheck() {
  if (!coversThisWindow()) showBoard();
}

std::string MirrorStep::deviceName() const {
  const auto screen = rig().screen();
  return CalibrationStep::deviceName() + (screen ? ", " + screen->name : std::string());
}

void MirrorStep::drawOver(QPainter& painter, const QTransform& transform) {
  if (!sighting_) return;
  for (std::size_t i = 0; i < sighting_->found.size(); ++i)
    live_overlay::drawBoard(painter, transform, sighting_->boards[i].board, sighting_->found[i]);
}

}  // namespace patina
