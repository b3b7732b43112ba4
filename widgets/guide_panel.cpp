#include "widgets/guide_panel.h"

#include <QListWidget>
#include <QPushButton>
#include <QStackedWidget>

#include "widgets/theme.h"

namespace patina {

namespace {

enum class Mark { ToDo, Current, Done, Reused, Failed };

QIcon markOf(Mark mark, int number, qreal ratio) {
  constexpr int kSide = 22;
  QPixmap pixmap(QSize(kSide, kSide) * ratio);
  pixmap.setDevicePixelRatio(ratio);
  pixmap.fill(Qt::transparent);
  QPainter painter(&pixmap);
  painter.setRenderHint(QPainter::Antialiasing);
  const QRectF disc(1.5, 1.5, kSide - 3, kSide - 3);
  const QColor colour = mark == Mark::Done || mark == Mark::Reused ? theme::kGood
                        : mark == Mark::Failed                     ? theme::kError
                        : mark == Mark::Current                    ? theme::kAccent
                                                                   : theme::kTextOff;
  painter.setPen(QPen(colour, 1.6));
  painter.setBrush(mark == Mark::Current ? QBrush(theme::kAccentDeep) : Qt::NoBrush);
  painter.drawEllipse(disc);
  painter.setPen(QPen(mark == Mark::Current ? theme::kText : colour, 2, Qt::SolidLine, Qt::RoundCap));
  if (mark == Mark::Done || mark == Mark::Reused) {
    painter.drawPolyline(QPolygonF{{6.5, 11.5}, {9.8, 14.8}, {15.8, 7.8}});
  } else if (mark == Mark::Failed) {
    painter.drawLine(QPointF(11, 6), QPointF(11, 12));
    painter.drawPoint(QPointF(11, 15.8));
  } else {
    painter.drawText(disc, Qt::AlignCenter, QString::number(number));
  }
  return QIcon(pixmap);
}

}  // namespace

GuidePanel::GuidePanel(const QString& title, QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("guidePanel"));
  auto* side = new QWidget(this);
  side->setObjectName(QStringLiteral("guideSide"));
  side->setAttribute(Qt::WA_StyledBackground);
  side->setStyleSheet(QStringLiteral("#guideSide { background: %1; border-right: 1px solid #1c1c1c; }")
                          .arg(theme::kPanel.name()));
  side->setFixedWidth(fontMetrics().averageCharWidth() * 38);
  auto* task = new QLabel(title, side);
  QFont large = task->font();
  large.setPointSizeF(large.pointSizeF() * 1.25);
  large.setWeight(QFont::DemiBold);
  task->setFont(large);
  task->setWordWrap(true);
  list_ = new QListWidget(side);
  list_->setObjectName(QStringLiteral("guideSteps"));
  list_->setAccessibleName(tr("Steps"));
  list_->setFrameShape(QFrame::NoFrame);
  list_->setIconSize(QSize(22, 22));
  list_->setSpacing(3);
  list_->setWordWrap(true);
  list_->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  list_->setStyleSheet(QStringLiteral("QListWidget { background: transparent; outline: none; }"
                                      "QListWidget::item { padding: 5px 4px; border-radius: 5px; }"
                                      "QListWidget::item:selected { background: %1; color: %2; }"
                                      "QListWidget::item:focus { border: 1px solid %3; }")
                           .arg(theme::kControl.name(), theme::kText.name(), theme::kAccent.name()));
  close_ = new QPushButton(tr("Leave"), side);
  close_->setObjectName(QStringLiteral("guideClose"));
  close_->setToolTip(tr("Back to what was open; what is done here is kept"));
  auto* sideColumn = new QVBoxLayout(side);
  sideColumn->setContentsMargins(14, 14, 10, 12);
  sideColumn->setSpacing(10);
  sideColumn->addWidget(task);
  sideColumn->addWidget(list_, 1);
  sideColumn->addWidget(close_, 0, Qt::AlignLeft);

  title_ = new QLabel(this);
  title_->setObjectName(QStringLiteral("guideTitle"));
  QFont heading = title_->font();
  heading.setPointSizeF(heading.pointSizeF() * 1.5);
  heading.setWeight(QFont::DemiBold);
  title_->setFont(heading);
  sentence_ = new QLabel(this);
  sentence_->setObjectName(QStringLiteral("guideSentence"));
  sentence_->setWordWrap(true);
  sentence_->setTextFormat(Qt::PlainText);
  stack_ = new QStackedWidget(this);
  whyNot_ = new QLabel(this);
  whyNot_->setObjectName(QStringLiteral("guideWhyNot"));
  whyNot_->setWordWrap(true);
  whyNot_->setAlignment(Qt::AlignRight | Qt::AlignVCenter);
  whyNot_->setProperty("role", "caption");
  back_ = new QPushButton(tr("Back"), this);
  back_->setObjectName(QStringLiteral("guideBack"));
  next_ = new QPushButton(tr("Next"), this);
  next_->setObjectName(QStringLiteral("guideNext"));
  next_->setProperty("primary", true);
  auto* foot = new QHBoxLayout;
  foot->setSpacing(10);
  foot->addWidget(back_);
  foot->addWidget(whyNot_, 1);
  foot->addWidget(next_);
  auto* column = new QVBoxLayout;
  column->setContentsMargins(20, 14, 20, 14);
  column->setSpacing(8);
  column->addWidget(title_);
  column->addWidget(sentence_);
  column->addWidget(stack_, 1);
  column->addLayout(foot);
  auto* row = new QHBoxLayout(this);
  row->setContentsMargins(0, 0, 0, 0);
  row->setSpacing(0);
  row->addWidget(side);
  row->addLayout(column, 1);

  connect(back_, &QPushButton::clicked, this, [this] { goTo(current_ - 1); });
  connect(next_, &QPushButton::clicked, this, [this] {
    if (current_ < 0 || !steps_[static_cast<std::size_t>(current_)]->canGoOn()) return;
    if (current_ + 1 == static_cast<int>(steps_.size()))
      Q_EMIT finished();
    else
      goTo(current_ + 1);
  });
  connect(close_, &QPushButton::clicked, this, &GuidePanel::closeRequested);
  connect(list_, &QListWidget::currentRowChanged, this, [this](int step) {
    if (step >= 0 && step != current_ && !goTo(step)) refreshList();
  });
}

GuidePanel::~GuidePanel() {
  // Steps say that they changed while they are taken down; nobody is left to be told.
  for (GuideStep* step : steps_) step->disconnect(this);
}

void GuidePanel::addStep(GuideStep* step) {
  step->setParent(this);
  steps_.push_back(step);
  bodies_.push_back(nullptr);
  connect(step, &GuideStep::changed, this, &GuidePanel::refresh);
  refreshList();
}

bool GuidePanel::mayEnter(int step) const {
  if (step < 0 || step >= static_cast<int>(steps_.size())) return false;
  for (int before = 0; before < step; ++before)
    if (!steps_[static_cast<std::size_t>(before)]->canGoOn()) return false;
  return true;
}

bool GuidePanel::goTo(int step) {
  if (!mayEnter(step)) return false;
  if (step == current_) return true;
  if (current_ >= 0 && shown_) steps_[static_cast<std::size_t>(current_)]->leave();
  current_ = step;
  remembered_ = step;
  const auto index = static_cast<std::size_t>(step);
  if (!bodies_[index]) {
    bodies_[index] = steps_[index]->body(stack_);
    stack_->addWidget(bodies_[index]);
  }
  stack_->setCurrentWidget(bodies_[index]);
  if (shown_) steps_[index]->enter();
  refresh();
  Q_EMIT stepChanged(step);
  return true;
}

void GuidePanel::enter() {
  if (shown_ || steps_.empty()) return;
  shown_ = true;
  current_ = -1;
  // What was done may count no more: a camera that is gone.
  int step = remembered_;
  while (step > 0 && !mayEnter(step)) --step;
  goTo(step);
}

void GuidePanel::leave() {
  if (!shown_) return;
  if (current_ >= 0) steps_[static_cast<std::size_t>(current_)]->leave();
  shown_ = false;
}

QString GuidePanel::sentence() const {
  return sentence_->text();
}

void GuidePanel::refresh() {
  refreshList();
  if (current_ < 0) return;
  const GuideStep& step = *steps_[static_cast<std::size_t>(current_)];
  title_->setText(step.title());
  sentence_->setText(step.sentence());
  const bool on = step.canGoOn();
  const QString reason = on ? QString() : step.whyNot();
  const bool last = current_ + 1 == static_cast<int>(steps_.size());
  next_->setText(!step.goOnText().isEmpty() ? step.goOnText() : last ? tr("Finish") : tr("Next"));
  next_->setEnabled(on);
  next_->setToolTip(on && !last
                        ? tr("Go on with: %1").arg(steps_[static_cast<std::size_t>(current_) + 1]->title())
                        : reason);
  whyNot_->setText(reason);
  back_->setEnabled(current_ > 0);
  back_->setToolTip(current_ > 0
                        ? tr("Back to: %1").arg(steps_[static_cast<std::size_t>(current_) - 1]->title())
                        : tr("This is the first step"));
}

void GuidePanel::refreshList() {
  const QSignalBlocker quiet(list_);
  while (list_->count() < static_cast<int>(steps_.size())) new QListWidgetItem(list_);
  for (int i = 0; i < list_->count(); ++i) {
    const GuideStep& step = *steps_[static_cast<std::size_t>(i)];
    QListWidgetItem* item = list_->item(i);
    const bool open = mayEnter(i);
    const GuideStep::State state = step.state();
    const Mark mark = state == GuideStep::State::Done     ? Mark::Done
                      : state == GuideStep::State::Reused ? Mark::Reused
                      : state == GuideStep::State::Failed ? Mark::Failed
                      : i == current_                     ? Mark::Current
                                                          : Mark::ToDo;
    const QString words = mark == Mark::Done      ? tr("done")
                          : mark == Mark::Reused  ? tr("reused")
                          : mark == Mark::Failed  ? tr("not good yet")
                          : mark == Mark::Current ? tr("now")
                                                  : tr("to do");
    QString second = mark == Mark::ToDo && step.note().isEmpty() ? QString() : words;
    if (mark == Mark::ToDo && step.note().isEmpty() && step.canGoOn()) second = tr("of use, not needed");
    if (!step.note().isEmpty()) second += (second.isEmpty() ? QString() : QStringLiteral(", ")) + step.note();
    item->setText(second.isEmpty() ? step.title() : step.title() + QLatin1Char('\n') + second);
    item->setIcon(markOf(mark, i + 1, devicePixelRatioF()));
    item->setFlags(open ? Qt::ItemIsEnabled | Qt::ItemIsSelectable : Qt::NoItemFlags);
    item->setData(Qt::AccessibleTextRole,
                  step.title() + QStringLiteral(": ") + (second.isEmpty() ? words : second));
    QString whyNot;
    for (int before = 0; before < i && whyNot.isEmpty(); ++before)
      if (!steps_[static_cast<std::size_t>(before)]->canGoOn())
        whyNot = tr("First: %1").arg(steps_[static_cast<std::size_t>(before)]->title());
    item->setToolTip(whyNot);
  }
  list_->setCurrentRow(current_);
}

}  // namespace patina
