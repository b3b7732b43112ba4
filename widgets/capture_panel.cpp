#include "widgets/capture_panel.h"

#include <QListWidget>
#include <QProgressBar>
#include <QPushButton>
#include <QStyle>

#include "widgets/theme.h"

namespace patina {

namespace {

constexpr int kThumb = 72;

/// A thumbnail with the state in its corner.
QIcon thumbOf(const QImage& picture, const PhotoState& state, bool wanted, qreal ratio) {
  QPixmap pixmap(QSize(kThumb, kThumb) * ratio);
  pixmap.setDevicePixelRatio(ratio);
  pixmap.fill(theme::kSunken);
  QPainter painter(&pixmap);
  painter.setRenderHint(QPainter::Antialiasing);
  if (!picture.isNull()) {
    painter.setRenderHint(QPainter::SmoothPixmapTransform);
    const QSizeF size = QSizeF(picture.size()).scaled(kThumb, kThumb, Qt::KeepAspectRatio);
    painter.drawImage(QRectF(QPointF(0.5 * (kThumb - size.width()), 0.5 * (kThumb - size.height())), size),
                      picture);
  }
  const bool waiting = state.stage == PhotoState::Stage::Waiting,
             flawed = state.stage == PhotoState::Stage::Flawed;
  const QColor colour = wanted    ? theme::kAccent
                        : waiting ? theme::kBorder
                        : flawed  ? theme::kWarning
                                  : theme::kGood;
  painter.setPen(QPen(colour, waiting && !wanted ? 1 : 3));
  painter.setBrush(Qt::NoBrush);
  painter.drawRect(QRectF(1, 1, kThumb - 2, kThumb - 2));
  if (flawed || wanted) {
    painter.setPen(Qt::NoPen);
    painter.setBrush(colour);
    painter.drawEllipse(QPointF(kThumb - 13, 13), 9, 9);
    painter.setPen(Qt::black);
    QFont bold = painter.font();
    bold.setBold(true);
    painter.setFont(bold);
    painter.drawText(QRectF(kThumb - 22, 4, 18, 18), Qt::AlignCenter,
                     wanted ? QStringLiteral("\u21bb") : QStringLiteral("!"));
  }
  return QIcon(pixmap);
}

QString wordsOf(const PhotoState& state, bool wanted) {
  if (wanted) return CapturePanel::tr("will be taken again");
  switch (state.stage) {
    case PhotoState::Stage::Waiting:
      return CapturePanel::tr("not taken yet");
    case PhotoState::Stage::Taken:
      return CapturePanel::tr("good");
    case PhotoState::Stage::Flawed:
      return CapturePanel::tr("kept, but not good");
  }
  return {};
}

}  // namespace

CapturePanel::CapturePanel(QWidget* parent) : QWidget(parent) {
  plan_ = new QLabel(this);
  plan_->setObjectName(QStringLiteral("capturePlan"));
  plan_->setWordWrap(true);
  folderWords_ = new QLabel(this);
  folderWords_->setObjectName(QStringLiteral("captureFolder"));
  folderWords_->setWordWrap(true);
  folderWords_->setProperty("role", "caption");
  folder_ = new QPushButton(tr("Another Folder\u2026"), this);
  folder_->setObjectName(QStringLiteral("captureFolderButton"));
  auto* folderRow = new QHBoxLayout;
  folderRow->addWidget(folderWords_, 1);
  folderRow->addWidget(folder_);
  view_ = new LiveView(this);
  view_->setEmptyText(tr("Photographs appear here as they are taken"));
  quality_ = new QLabel(this);
  quality_->setObjectName(QStringLiteral("photoQuality"));
  quality_->setWordWrap(true);
  quality_->setMinimumHeight(2 * fontMetrics().lineSpacing());
  quality_->setAlignment(Qt::AlignTop | Qt::AlignLeft);
  strip_ = new QListWidget(this);
  strip_->setObjectName(QStringLiteral("captureStrip"));
  strip_->setAccessibleName(tr("Photographs of this capture"));
  strip_->setViewMode(QListView::IconMode);
  strip_->setFlow(QListView::LeftToRight);
  strip_->setWrapping(false);
  strip_->setMovement(QListView::Static);
  strip_->setUniformItemSizes(true);
  strip_->setIconSize(QSize(kThumb, kThumb));
  strip_->setGridSize(QSize(kThumb + 10, kThumb + fontMetrics().height() + 12));
  strip_->setFixedHeight(kThumb + fontMetrics().height() + 34);
  strip_->setVerticalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  strip_->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOn);
  now_ = new QLabel(this);
  now_->setObjectName(QStringLiteral("captureNow"));
  left_ = new QLabel(this);
  left_->setObjectName(QStringLiteral("captureLeft"));
  left_->setProperty("role", "caption");
  bar_ = new QProgressBar(this);
  bar_->setObjectName(QStringLiteral("captureProgress"));
  bar_->setAccessibleName(tr("Photographs taken"));
  bar_->setFormat(QStringLiteral("%v / %m"));
  start_ = new QPushButton(this);
  start_->setObjectName(QStringLiteral("captureStart"));
  pause_ = new QPushButton(tr("Pause"), this);
  pause_->setObjectName(QStringLiteral("capturePause"));
  cancel_ = new QPushButton(tr("Cancel"), this);
  cancel_->setObjectName(QStringLiteral("captureCancel"));
  cancel_->setToolTip(tr("Stop; what is finished is kept, and the capture can be gone on with"));
  retake_ = new QPushButton(tr("Take Again"), this);
  retake_->setObjectName(QStringLiteral("captureRetake"));
  auto* buttons = new QHBoxLayout;
  buttons->addWidget(start_);
  buttons->addWidget(pause_);
  buttons->addWidget(cancel_);
  buttons->addStretch(1);
  buttons->addWidget(retake_);
  auto* progress = new QHBoxLayout;
  progress->addWidget(bar_, 3);
  progress->addWidget(now_, 3);
  progress->addWidget(left_, 2);
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(8);
  column->addWidget(plan_);
  column->addLayout(folderRow);
  column->addWidget(view_, 1);
  column->addWidget(quality_);
  column->addWidget(strip_);
  column->addLayout(progress);
  column->addLayout(buttons);
  connect(start_, &QPushButton::clicked, this, &CapturePanel::startRequested);
  connect(pause_, &QPushButton::clicked, this, [this] { Q_EMIT pauseRequested(mode_ != Mode::Paused); });
  connect(cancel_, &QPushButton::clicked, this, &CapturePanel::cancelRequested);
  connect(folder_, &QPushButton::clicked, this, &CapturePanel::folderRequested);
  connect(retake_, &QPushButton::clicked, this, [this] {
    if (strip_->currentRow() >= 0) Q_EMIT retakeRequested(strip_->currentRow());
  });
  connect(strip_, &QListWidget::currentRowChanged, this, [this] { refreshSelected(); });
  setMode(Mode::Ready, false);
}

void CapturePanel::setPlan(const CapturePlan& plan, const QString& words) {
  plan_->setText(words);
  photos_.clear();
  strip_->clear();
  for (std::size_t i = 0; i < plan.photos.size(); ++i) {
    Photo photo;
    photo.name = QString::fromStdString(patternName(plan.photos[i].pattern));
    if (plan.photos[i].holdout) photo.name += tr(", held out");
    photos_.push_back(photo);
    auto* item = new QListWidgetItem(QString::number(i), strip_);
    item->setIcon(thumbOf({}, photo.state, false, devicePixelRatioF()));
    item->setToolTip(photo.name);
    item->setData(Qt::AccessibleTextRole, photo.name + QStringLiteral(": ") + wordsOf(photo.state, false));
  }
  bar_->setRange(0, static_cast<int>(photos_.size()));
  bar_->setValue(0);
}

void CapturePanel::setMode(Mode mode, bool maybeResume) {
  mode_ = mode;
  resume_ = maybeResume;
  refreshButtons();
}

void CapturePanel::setMayStart(const QString& whyNot) {
  whyNot_ = whyNot;
  refreshButtons();
}

void CapturePanel::refreshButtons() {
  const bool running = mode_ == Mode::Running || mode_ == Mode::Paused;
  const bool anyWanted = std::ranges::any_of(photos_, [](const Photo& photo) { return photo.wanted; });
  start_->setText(mode_ == Mode::Done && anyWanted ? tr("Take Them Again")
                  : resume_                        ? tr("Go On")
                                                   : tr("Start the Capture"));
  const QString reason = running                             ? tr("Not now: photographs are being taken.")
                         : mode_ == Mode::Done && !anyWanted ? tr("Every photograph is taken.")
                                                             : whyNot_;
  start_->setEnabled(reason.isEmpty());
  start_->setToolTip(reason.isEmpty() ? tr("The screen shows the patterns one after another") : reason);
  start_->setProperty("primary", reason.isEmpty());
  start_->style()->unpolish(start_);  // has the property looked at again
  start_->style()->polish(start_);
  pause_->setEnabled(running);
  pause_->setText(mode_ == Mode::Paused ? tr("Resume") : tr("Pause"));
  pause_->setToolTip(running ? tr("Hold before the next photograph") : tr("Not now: nothing runs."));
  cancel_->setEnabled(running);
  folder_->setEnabled(!running);
  folder_->setToolTip(running ? tr("Not now: photographs are being taken.") : tr("Where the bundle goes"));
  refreshSelected();
}

void CapturePanel::setProgress(int taken, int total, const QString& now, const QString& left) {
  bar_->setRange(0, std::max(1, total));
  bar_->setValue(taken);
  now_->setText(now);
  left_->setText(left);
}

void CapturePanel::setPhoto(int photo, const PhotoState& state, LiveFramePtr picture, bool kept) {
  if (photo < 0 || photo >= static_cast<int>(photos_.size())) return;
  Photo& one = photos_[static_cast<std::size_t>(photo)];
  one.state = state;
  one.wanted = !kept && state.stage != PhotoState::Stage::Waiting;
  if (picture) one.picture = std::move(picture);
  QListWidgetItem* item = strip_->item(photo);
  item->setIcon(thumbOf(one.picture ? one.picture->shown : QImage(), state, one.wanted, devicePixelRatioF()));
  QString words = one.name + QStringLiteral(": ") + wordsOf(state, one.wanted);
  if (!state.quality.sentence.empty())
    words += QStringLiteral(". ") + QString::fromStdString(state.quality.sentence);
  item->setToolTip(words);
  item->setData(Qt::AccessibleTextRole, words);
  if (mode_ == Mode::Running && one.picture) {
    // The newest is on show while they come, unless the person looks at another one.
    if (!strip_->hasFocus()) {
      const QSignalBlocker quiet(strip_);
      strip_->setCurrentRow(photo);
      strip_->scrollToItem(item);
    }
  }
  refreshSelected();
}

void CapturePanel::setWanted(int photo) {
  if (photo < 0 || photo >= static_cast<int>(photos_.size())) return;
  Photo& one = photos_[static_cast<std::size_t>(photo)];
  one.wanted = true;
  strip_->item(photo)->setIcon(
      thumbOf(one.picture ? one.picture->shown : QImage(), one.state, true, devicePixelRatioF()));
  strip_->item(photo)->setData(Qt::AccessibleTextRole,
                               one.name + QStringLiteral(": ") + wordsOf(one.state, true));
  refreshButtons();
}

void CapturePanel::setFolder(const QString& folder, const QString& words) {
  folderWords_->setText(words);
  folderWords_->setToolTip(folder);
}

void CapturePanel::refreshSelected() {
  const int row = strip_->currentRow();
  const bool any = row >= 0 && row < static_cast<int>(photos_.size());
  const Photo* photo = any ? &photos_[static_cast<std::size_t>(row)] : nullptr;
  const bool taken = photo && photo->state.stage != PhotoState::Stage::Waiting && !photo->wanted;
  const bool running = mode_ == Mode::Running || mode_ == Mode::Paused;
  retake_->setEnabled(taken && !running);
  retake_->setToolTip(!taken ? tr("Choose a photograph that was taken")
                      : mode_ == Mode::Running
                          ? tr("Pause first, or wait until all are taken")
                          : tr("Take this photograph again at the next start; the old one "
                               "counts until then"));
  view_->setFrame(photo ? photo->picture : nullptr);
  if (!photo) return quality_->clear();
  QString text = tr("Photograph %1: %2, %3.").arg(row).arg(photo->name, wordsOf(photo->state, photo->wanted));
  if (!photo->state.quality.sentence.empty())
    text += QLatin1Char(' ') + QString::fromStdString(photo->state.quality.sentence);
  if (photo->state.attempts > 1) text += tr(" It was tried %1 times.").arg(photo->state.attempts);
  quality_->setText(text);
}

QString CapturePanel::planText() const {
  return plan_->text();
}

QString CapturePanel::qualityText() const {
  return quality_->text();
}

}  // namespace patina
