#include "widgets/empty_state.h"

#include <QDir>
#include <QFileInfo>
#include <QPushButton>

#include "widgets/theme.h"

namespace patina {

EmptyState::EmptyState(QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("emptyState"));
  card_ = new QWidget(this);
  card_->setFixedWidth(fontMetrics().averageCharWidth() * 78);
  auto* mark = new QLabel(card_);
  const int side = fontMetrics().height() * 5;
  mark->setPixmap(theme::icon(QStringLiteral("app")).pixmap(QSize(side, side), devicePixelRatioF()));
  mark->setAlignment(Qt::AlignCenter);
  title_ = new QLabel(tr("Open a capture bundle"), card_);
  QFont large = title_->font();
  large.setPointSizeF(large.pointSizeF() * 1.7);
  large.setWeight(QFont::DemiBold);
  title_->setFont(large);
  title_->setAlignment(Qt::AlignCenter);
  text_ = new QLabel(card_);
  text_->setAlignment(Qt::AlignCenter);
  text_->setWordWrap(true);
  text_->setProperty("role", "caption");
  text_->setText(
      tr("Drop a bundle's folder here, or its capture.json. A bundle holds the photographs of a material and "
         "what is "
         "needed to interpret them: under a screen's patterns, from which Patina fits maps of its "
         "reflectance, or "
         "two or three from near by under a distant light, from which it finds the reflectance in all "
         "directions."));
  open_ = new QPushButton(tr("Open Bundle\u2026"), card_);
  open_->setObjectName(QStringLiteral("emptyOpen"));
  open_->setProperty("primary", true);
  open_->setDefault(true);
  open_->setToolTip(tr("Choose a bundle's folder (Ctrl+O)"));
  openFit_ = new QPushButton(tr("Open Fit\u2026"), card_);
  openFit_->setToolTip(tr("Choose the folder of a fit that was saved (Ctrl+Shift+O)"));
  simulate_ = new QPushButton(tr("Try a Simulated Sample"), card_);
  simulate_->setObjectName(QStringLiteral("emptySimulate"));
  simulate_->setToolTip(
      tr("No camera at hand: photograph a made-up sheet with a simulated one (about 10 s). "
         "More, also two-shot samples: File > Simulated Capture"));
  capture_ = new QPushButton(tr("Capture with a Screen\u2026"), card_);
  capture_->setObjectName(QStringLiteral("emptyCapture"));
  capture_->setToolTip(tr("Photograph a sample with your own camera and screen, step by step (Ctrl+K)"));
  captureTwoShot_ = new QPushButton(tr("Capture in Two Shots\u2026"), card_);
  captureTwoShot_->setObjectName(QStringLiteral("emptyCaptureTwoShot"));
  captureTwoShot_->setToolTip(
      tr("Photograph a sample from two directions under a lamp, step by step (Ctrl+Shift+K)"));
  recentTitle_ = new QLabel(tr("Recent"), card_);
  recentTitle_->setProperty("role", "caption");
  recent_ = new QVBoxLayout;
  recent_->setSpacing(2);

  auto* buttons = new QHBoxLayout;
  buttons->addStretch(1);
  buttons->addWidget(open_);
  buttons->addWidget(openFit_);
  buttons->addWidget(simulate_);
  buttons->addStretch(1);
  auto* captures = new QHBoxLayout;
  captures->addStretch(1);
  captures->addWidget(capture_);
  captures->addWidget(captureTwoShot_);
  captures->addStretch(1);
  auto* column = new QVBoxLayout(card_);
  column->setSpacing(12);
  column->addWidget(mark);
  column->addWidget(title_);
  column->addWidget(text_);
  column->addSpacing(6);
  column->addLayout(buttons);
  column->addLayout(captures);
  column->addSpacing(10);
  column->addWidget(recentTitle_, 0, Qt::AlignHCenter);
  column->addLayout(recent_);
  auto* middle = new QHBoxLayout(this);
  middle->addStretch(1);
  middle->addWidget(card_, 0, Qt::AlignVCenter);
  middle->addStretch(1);
  connect(open_, &QPushButton::clicked, this, &EmptyState::openRequested);
  connect(openFit_, &QPushButton::clicked, this, &EmptyState::openFitRequested);
  connect(simulate_, &QPushButton::clicked, this, &EmptyState::simulateRequested);
  connect(capture_, &QPushButton::clicked, this, [this] { Q_EMIT captureRequested(false); });
  connect(captureTwoShot_, &QPushButton::clicked, this, [this] { Q_EMIT captureRequested(true); });
  setRecent({});
}

void EmptyState::setRecent(const QStringList& folders) {
  while (QLayoutItem* item = recent_->takeAt(0)) {
    delete item->widget();
    delete item;
  }
  recentTitle_->setVisible(!folders.isEmpty());
  for (const QString& folder : folders.mid(0, 5)) {
    auto* entry = new QToolButton(card_);
    const QFileInfo file(folder);
    QString parent = file.path();
    if (parent.startsWith(QDir::homePath())) parent.replace(0, QDir::homePath().size(), QStringLiteral("~"));
    const QString text = file.fileName() + QStringLiteral("    ") + parent;
    entry->setText(entry->fontMetrics().elidedText(text, Qt::ElideMiddle, card_->width() - 40));
    entry->setToolTip(folder);
    entry->setCursor(Qt::PointingHandCursor);
    entry->setFocusPolicy(Qt::StrongFocus);
    connect(entry, &QToolButton::clicked, this, [this, folder] { Q_EMIT recentRequested(folder); });
    recent_->addWidget(entry, 0, Qt::AlignHCenter);
  }
}

void EmptyState::setDropHint(bool held) {
  held_ = held;
  title_->setText(held ? tr("Drop to open") : tr("Open a capture bundle"));
  update();
}

void EmptyState::setBusy(const QString& what) {
  title_->setText(what.isEmpty() ? tr("Open a capture bundle") : what);
  open_->setEnabled(what.isEmpty());
  openFit_->setEnabled(what.isEmpty());
  for (QPushButton* button : {simulate_, capture_, captureTwoShot_}) button->setEnabled(what.isEmpty());
}

void EmptyState::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.setRenderHint(QPainter::Antialiasing);
  const QRectF frame = QRectF(rect()).adjusted(24, 24, -24, -24);
  painter.setPen(QPen(held_ ? theme::kAccent : theme::kBorder, held_ ? 2.5 : 1.5, Qt::DashLine));
  painter.setBrush(held_ ? QColor(44, 52, 60) : Qt::transparent);
  painter.drawRoundedRect(frame, 14, 14);
}

}  // namespace patina
