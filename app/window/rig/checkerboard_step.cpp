#include "app/window/rig/checkerboard_step.h"

#include <QCheckBox>
#include <QHeaderView>
#include <QPushButton>
#include <QShortcut>
#include <QTableWidget>

#include "app/window/settings.h"
#include "devices/simulated/live_rig.h"
#include "widgets/board_chooser.h"
#include "widgets/board_print_dialog.h"
#include "widgets/coverage_view.h"
#include "widgets/live_overlay.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr int kFewestViews = 4;  ///< to solve for the lens at all
constexpr int kEnoughViews = 8;  ///< to keep it
constexpr double kNewShare =
    0.04;  ///< of the picture's width by which corners must have moved since each view
const QString kBoard = QStringLiteral("rig/board");

QString sd(double value, double sd, int decimals) {
  return QStringLiteral("%1 \u00b1 %2").arg(value, 0, 'f', decimals).arg(sd, 0, 'f', decimals);
}

}  // namespace

CheckerboardStep::CheckerboardStep(RigController& rig) : CalibrationStep(rig, "camera") {
  connect(&watcher_, &BoardWatcher::seen, this, &CheckerboardStep::saw);
}

CheckerboardStep::~CheckerboardStep() {
  solver_.disconnect();
}

QString CheckerboardStep::title() const {
  return tr("Checkerboard");
}

QString CheckerboardStep::sentence() const {
  if (state() == State::Done || state() == State::Reused)
    return tr("The lens is known. Zoom, focus and format must stay as they are from here on.");
  if (views_.empty())
    return tr(
        "Hold the printed board before the camera, flat and still: a view is taken by itself. Then hold "
        "it elsewhere and tilted; the dashed outline shows where.");
  return tr(
      "Hold the board where the dashed outline is, as it is tilted. The tilted ones decide the focal "
      "length, those at the rim the distortion.");
}

void CheckerboardStep::buildControls(QVBoxLayout* column, QWidget* parent) {
  column->addWidget(makeCaption(parent, tr("The board")));
  boards_ = new BoardChooser(parent);
  const QString known = rig().settings().text(kBoard);
  if (!known.isEmpty())
    if (const auto board = parseBoard(known.toStdString(), "settings"))
      boards_->setBoard(*board), sized_ = true;
  column->addWidget(boards_);
  connect(boards_, &BoardChooser::changed, this, &CheckerboardStep::boardChanged);
  print_ = makeButton(parent, tr("Print the Board\u2026"), QStringLiteral("board-print"), false);
  column->addWidget(print_, 0, Qt::AlignLeft);
  connect(print_, &QPushButton::clicked, this, [this] {
    BoardPrintDialog dialog(boards_->board(), body(nullptr));
    if (dialog.exec() == QDialog::Accepted) boards_->setBoard(dialog.board()), boardChanged();
  });

  auto_ = new QCheckBox(tr("Take a view when the board stands still"), parent);
  auto_->setObjectName(QStringLiteral("board-auto"));
  auto_->setChecked(true);
  column->addWidget(auto_);
  take_ = makeButton(parent, tr("Take This View (Space)"), QStringLiteral("board-take"), false);
  column->addWidget(take_, 0, Qt::AlignLeft);
  connect(take_, &QPushButton::clicked, this, &CheckerboardStep::take);
  auto* key = new QShortcut(QKeySequence(Qt::Key_Space), parent->parentWidget());
  key->setContext(Qt::WidgetWithChildrenShortcut);
  connect(key, &QShortcut::activated, this, &CheckerboardStep::take);

  table_ = new QTableWidget(0, 4, parent);
  table_->setObjectName(QStringLiteral("board-views"));
  table_->setAccessibleName(tr("Views"));
  table_->setHorizontalHeaderLabels({tr("View"), tr("RMS px"), tr("Tilt"), QString()});
  table_->horizontalHeader()->setSectionResizeMode(QHeaderView::Stretch);
  table_->horizontalHeader()->setSectionResizeMode(3, QHeaderView::ResizeToContents);
  table_->verticalHeader()->hide();
  table_->setEditTriggers(QAbstractItemView::NoEditTriggers);
  table_->setSelectionMode(QAbstractItemView::NoSelection);
  table_->setMinimumHeight(150);
  column->addWidget(table_);
  lens_ = new QLabel(parent);
  lens_->setObjectName(QStringLiteral("board-lens"));
  lens_->setWordWrap(true);
  lens_->setTextInteractionFlags(Qt::TextSelectableByMouse);
  column->addWidget(lens_);
  keep_ = makeButton(parent, tr("Keep This Calibration"), QStringLiteral("board-keep"), true);
  column->addWidget(keep_, 0, Qt::AlignLeft);
  connect(keep_, &QPushButton::clicked, this, &CheckerboardStep::keepResult);

  addHand(tr("Hold the Board Elsewhere"), QStringLiteral("hand-board"), [this] {
    return
        [board = boards_->board(), view = hand_++](SimulatedHands& hands) { hands.holdBoard(board, view); };
  });
  view()->setOverlay(
      [this](QPainter& painter, const QTransform& transform) { drawOver(painter, transform); });
  watcher_.setBoards({{boards_->board(), BoardSide::Direct}});
}

QWidget* CheckerboardStep::belowPicture(QWidget* parent) {
  auto* box = new QWidget(parent);
  auto* row = new QHBoxLayout(box);
  row->setContentsMargins(0, 0, 0, 0);
  row->setSpacing(14);
  map_ = new CoverageView(box);
  map_->setFixedSize(300, 130);
  auto* words = new QVBoxLayout;
  seen_ = new QLabel(box);
  seen_->setObjectName(QStringLiteral("board-seen"));
  seen_->setWordWrap(true);
  advice_ = new QLabel(box);
  advice_->setObjectName(QStringLiteral("board-advice"));
  advice_->setWordWrap(true);
  advice_->setProperty("role", "caption");
  words->addWidget(seen_);
  words->addWidget(advice_);
  words->addStretch(1);
  row->addWidget(map_);
  row->addLayout(words, 1);
  return box;
}

void CheckerboardStep::enter() {
  CalibrationStep::enter();
  if (rig().simulation() && !sized_) {
    // A board that this camera can hold in its picture before the table, coarse enough for few pixels.
    sized_ = true;
    // Without markers: in few pixels they come so near to the corners that they draw them aside.
    Board board;
    board.kind = BoardKind::Checkerboard;
    constexpr int kManyPixels = 480;
    const bool many = rig().simulation()->camera().width >= kManyPixels;
    board.squaresX = many ? 10 : 8;
    board.squaresY = many ? 7 : 5;
    constexpr double kStepMm = 0.5;
    board.squareMm = std::max(
        kStepMm, std::floor(SimulatedHands(rig().simulation()).squareThatFits(board) / kStepMm) * kStepMm);
    boards_->setBoard(board);
    watcher_.setBoards({{board, BoardSide::Direct}});
  }
  showCoverage();
}

void CheckerboardStep::leave() {
  watcher_.forget();
  still_.reset();
  CalibrationStep::leave();
}

void CheckerboardStep::boardChanged() {
  views_.clear();
  result_.reset();
  still_.reset();
  sighting_.reset();
  sized_ = true;
  watcher_.setBoards({{boards_->board(), BoardSide::Direct}});
  rig().settings().set(kBoard, QString::fromStdString(boardText(boards_->board())));
  showResult();
  refresh();
}

void CheckerboardStep::frameCame(const LiveFramePtr& frame) {
  watcher_.look(frame);
}

void CheckerboardStep::saw(const BoardSightingPtr& sighting) {
  if (!entered()) return;
  sighting_ = sighting;
  const BoardDetection& found = sighting->found.front();
  seen_->setText(sightingInWords(found, sighting->boards.front().board));
  atLast_ = false;
  if (!found.found) {
    still_.reset();
  } else if (still_.add(found.view) && auto_->isChecked() && isNew(found.view)) {
    take();
  }
  view()->update();
  refreshControls();
}

bool CheckerboardStep::isNew(const BoardView& view) const {
  for (const CalibrationView& taken : views_) {
    const auto distance = meanCornerDistance(taken.view, view);
    if (distance && *distance < kNewShare * view.imageWidth) return false;
  }
  return true;
}

void CheckerboardStep::take() {
  if (!sighting_ || !sighting_->found.front().found) {
    if (sighting_) say(sightingInWords(sighting_->found.front(), boards_->board()), Tone::Problem);
    return;
  }
  BoardView view = still_.mean();
  if (view.corners.empty()) view = sighting_->found.front().view;
  if (!views_.empty() && (views_.front().view.imageWidth != view.imageWidth ||
                          views_.front().view.imageHeight != view.imageHeight)) {
    views_.clear();  // the camera's format is another one now
    result_.reset();
  }
  views_.push_back({tr("View %1").arg(++taken_).toStdString(), view, true});
  still_.reset();
  atLast_ = true;
  solve();
}

void CheckerboardStep::removeView(int view) {
  if (view < 0 || view >= static_cast<int>(views_.size())) return;
  views_.erase(views_.begin() + view);
  result_.reset();
  solve();
}

void CheckerboardStep::solve() {
  showCoverage();
  if (static_cast<int>(views_.size()) < kFewestViews) {
    showResult();
    return refresh();
  }
  if (solver_.running()) {
    solveAgain_ = true;
    return;
  }
  solver_.start<CameraCalibration>(
      [board = boards_->board(), views = views_](const JobContext& job) {
        return calibrateCamera(board, views, {}, job);
      },
      [this, count = views_.size()](Result<CameraCalibration> outcome) {
        if (outcome && outcome->views.size() == views_.size() && count == views_.size()) {
          result_ = std::move(*outcome);
        } else if (!outcome) {
          result_.reset();
          say(sentencesOf(outcome.error()), Tone::Problem);
        }
        showResult();
        refresh();
        if (std::exchange(solveAgain_, false)) solve();
      });
}

void CheckerboardStep::showCoverage() {
  const LiveFramePtr frame = view()->frame();
  const int width = views_.empty() ? (frame ? frame->linear.width() : 0) : views_.front().view.imageWidth;
  const int height = views_.empty() ? (frame ? frame->linear.height() : 0) : views_.front().view.imageHeight;
  coverage_ = coverageOf(boards_->board(), views_, result_ ? &result_->camera : nullptr);
  std::vector<Eigen::Vector2d> corners;
  for (const CalibrationView& taken : views_)
    for (const BoardCorner& corner : taken.view.corners) corners.push_back(corner.pixel);
  map_->setCoverage(coverage_, std::move(corners), width, height);
  ghost_ = width > 0 ? nextViewOutline(coverage_, boards_->board(), width, height) : QPolygonF();
  QStringList advice;
  for (const std::string& sentence : coverage_.advice) {
    QString text = QString::fromStdString(sentence);
    if (!text.isEmpty()) text[0] = text[0].toUpper();
    advice << text + QLatin1Char('.');
    if (advice.size() == 2) break;
  }
  if (views_.empty())
    advice = {tr("No view is taken yet.")};
  else if (advice.empty())
    advice = {tr("The picture and the tilts are covered.")};
  advice_->setText(advice.join(QLatin1Char(' ')));
  view()->update();
}

void CheckerboardStep::showResult() {
  showCoverage();
  table_->setRowCount(static_cast<int>(views_.size()));
  for (int row = 0; row < table_->rowCount(); ++row) {
    const auto index = static_cast<std::size_t>(row);
    const CalibratedView* solved =
        result_ && result_->views.size() == views_.size() ? &result_->views[index] : nullptr;
    const auto cell = [&](int column, const QString& text) {
      auto* item = new QTableWidgetItem(text);
      if (solved && solved->outlier) item->setForeground(theme::kWarning);
      if (solved && !solved->remark.empty()) item->setToolTip(QString::fromStdString(solved->remark));
      table_->setItem(row, column, item);
    };
    cell(0, QString::fromStdString(views_[index].name));
    cell(1, solved ? QString::number(solved->rmsPx, 'f', 3) : QStringLiteral("\u2013"));
    cell(2, solved ? QStringLiteral("%1\u00b0").arg(solved->tiltDeg, 0, 'f', 0) : QString());
    auto* remove = new QToolButton(table_);
    remove->setIcon(theme::icon(QStringLiteral("close")));
    remove->setObjectName(QStringLiteral("view-remove-%1").arg(row));
    remove->setToolTip(tr("Leave this view out"));
    connect(remove, &QToolButton::clicked, this, [this, row] { removeView(row); });
    table_->setCellWidget(row, 3, remove);
  }
  table_->scrollToBottom();
  if (!result_) {
    lens_->setText(static_cast<int>(views_.size()) < kFewestViews
                       ? tr("%1 of %2 views that are needed at least.").arg(views_.size()).arg(kEnoughViews)
                       : QString());
    return;
  }
  const Eigen::Matrix3d& k = result_->camera.intrinsics;
  QString text =
      tr("Corners are %1 px RMS from where the lens puts them; rays are known to %2 px.\n"
         "Focal length %3 and %4 px, principal point %5, %6 px, k1 %7")
          .arg(result_->rmsPx, 0, 'f', 3)
          .arg(result_->predictionSdPx, 0, 'f', 3)
          .arg(sd(k(0, 0), result_->sd[0], 2), sd(k(1, 1), result_->sd[1], 2), sd(k(0, 2), result_->sd[2], 2),
               sd(k(1, 2), result_->sd[3], 2), sd(result_->camera.distortion[0], result_->sd[4], 4));
  for (const std::string& warning : result_->warnings) {
    QString sentence = QString::fromStdString(warning);
    if (!sentence.isEmpty()) sentence[0] = sentence[0].toUpper();
    text += QStringLiteral("\n") + sentence + QLatin1Char('.');
  }
  lens_->setText(text);
}

void CheckerboardStep::refreshControls() {
  if (!take_) return;
  take_->setEnabled(sighting_ && sighting_->found.front().found);
  const int views = static_cast<int>(views_.size());
  keep_->setEnabled(result_ && views >= kEnoughViews);
  keep_->setToolTip(views < kEnoughViews
                        ? tr("Not now: %1 views are needed at least, 10 to 15 are good").arg(kEnoughViews)
                        : QString());
}

void CheckerboardStep::keepResult() {
  if (!result_) return;
  int used = 0;
  for (const CalibratedView& view : result_->views) used += view.used ? 1 : 0;
  if (keep(StoredCamera{result_->camera, result_->sd, boards_->board(), used}, result_->rmsPx, "px",
           result_->warnings))
    say(tr("Kept. Add views and keep it again to do better, or go on."), Tone::Good);
}

CalibrationStep::Rechecker CheckerboardStep::rechecker() const {
  return [](const CalibrationRecord& record, const Photograph& photo, CameraDevice&, const JobContext&) {
    return recheckCamera(record, photo.image);
  };
}

QString CheckerboardStep::recheckHint() const {
  return tr("Hold the board that it was made with before the camera, still and a little tilted.");
}

void CheckerboardStep::drawOver(QPainter& painter, const QTransform& transform) {
  if (!ghost_.isEmpty() && state() != State::Done && state() != State::Reused)
    live_overlay::drawGhost(painter, transform, ghost_);
  if (!sighting_) return;
  live_overlay::drawBoard(
      painter, transform, boards_->board(), sighting_->found.front(),
      auto_->isChecked() && sighting_->found.front().found && isNew(sighting_->found.front().view)
          ? still_.progress()
          : 0);
  const QRectF within = view()->rect();
  if (atLast_)
    live_overlay::drawSentence(painter, within, tr("Taken. Now hold it elsewhere."), true);
  else if (sighting_->found.front().found && !isNew(sighting_->found.front().view))
    live_overlay::drawSentence(painter, within, tr("This view is taken. Hold the board elsewhere."), false);
}

}  // namespace patina
