#include "widgets/checklist_panel.h"

#include <QGridLayout>
#include <QPushButton>
#include <QScrollArea>
#include <QStyle>

#include "widgets/theme.h"

namespace patina {

namespace {

struct Look {
  const char* mark;
  QColor colour;
  QString words;
};

Look lookOf(CheckItem::State state) {
  switch (state) {
    case CheckItem::State::Good:
      return {"\u2713", theme::kGood, ChecklistPanel::tr("good")};
    case CheckItem::State::Warning:
      return {"!", theme::kWarning, ChecklistPanel::tr("to be mended if you can")};
    case CheckItem::State::Bad:
      return {"\u2717", theme::kError, ChecklistPanel::tr("must be mended")};
    case CheckItem::State::NotKnown:
      break;
  }
  return {"?", theme::kTextDim, ChecklistPanel::tr("can't be told")};
}

}  // namespace

ChecklistPanel::ChecklistPanel(QWidget* parent) : QWidget(parent) {
  list_ = new QWidget(this);
  grid_ = new QGridLayout(list_);
  grid_->setContentsMargins(0, 0, 6, 0);
  grid_->setHorizontalSpacing(12);
  grid_->setVerticalSpacing(8);
  grid_->setColumnStretch(2, 1);
  auto* scroll = new QScrollArea(this);
  scroll->setWidget(list_);
  scroll->setWidgetResizable(true);
  scroll->setFrameShape(QFrame::NoFrame);
  words_ = new QLabel(this);
  words_->setObjectName(QStringLiteral("checklistWords"));
  words_->setWordWrap(true);
  words_->setProperty("role", "caption");
  check_ = new QPushButton(this);
  check_->setObjectName(QStringLiteral("checkRig"));
  auto* foot = new QHBoxLayout;
  foot->addWidget(check_);
  foot->addWidget(words_, 1);
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 0, 0, 0);
  column->addWidget(scroll, 1);
  column->addLayout(foot);
  connect(check_, &QPushButton::clicked, this, &ChecklistPanel::checkRequested);
  setChecking(false);
}

void ChecklistPanel::clear(const QString& words) {
  for (const Row& row : rows_)
    for (QLabel* label : {row.mark, row.title, row.found, row.mend}) delete label;
  rows_.clear();
  checked_ = false;
  words_->setText(words);
  setChecking(checking_);
}

void ChecklistPanel::setChecklist(const Checklist& list, const QString& words) {
  clear(words);
  checked_ = true;
  for (const CheckItem& item : list.items) {
    const Look look = lookOf(item.state);
    Row row;
    const auto label = [this](const QString& text) {
      auto* made = new QLabel(text, list_);
      made->setWordWrap(true);
      made->setAlignment(Qt::AlignTop | Qt::AlignLeft);
      made->setTextInteractionFlags(Qt::TextSelectableByMouse);
      return made;
    };
    row.mark = label(QString::fromUtf8(look.mark));
    row.mark->setStyleSheet(QStringLiteral("color: %1; font-weight: bold;").arg(look.colour.name()));
    row.mark->setAccessibleName(look.words);
    row.mark->setToolTip(look.words);
    row.title = label(QString::fromStdString(item.title));
    row.title->setWordWrap(false);
    QFont bold = row.title->font();
    bold.setBold(true);
    row.title->setFont(bold);
    row.found = label(QString::fromStdString(item.sentence));
    row.mend =
        label(item.tryThis.empty() ? QString() : tr("Try: %1.").arg(QString::fromStdString(item.tryThis)));
    row.mend->setStyleSheet(QStringLiteral("color: %1;").arg(look.colour.name()));
    auto* text = new QVBoxLayout;
    text->setSpacing(1);
    text->addWidget(row.found);
    text->addWidget(row.mend);
    row.mend->setVisible(!item.tryThis.empty());
    const int line = static_cast<int>(rows_.size());
    grid_->addWidget(row.mark, line, 0);
    grid_->addWidget(row.title, line, 1);
    grid_->addLayout(text, line, 2);
    rows_.push_back(row);
  }
  for (int line = 0; line < grid_->rowCount(); ++line) grid_->setRowStretch(line, 0);
  grid_->setRowStretch(static_cast<int>(rows_.size()), 1);
  setChecking(false);
}

void ChecklistPanel::setChecking(bool checking, double share) {
  checking_ = checking;
  if (checking)
    check_->setText(tr("Looking\u2026 %1 %").arg(static_cast<int>(100 * share)));
  else
    check_->setText(checked_ ? tr("Check Again") : tr("Check the Rig"));
}

void ChecklistPanel::setMayCheck(bool possible, const QString& whyNot) {
  check_->setEnabled(possible);
  check_->setToolTip(possible ? tr("Takes some seconds; the screen shows test pictures") : whyNot);
  check_->setProperty("primary", possible && !checked_);
  check_->style()->unpolish(check_);  // has the property looked at again
  check_->style()->polish(check_);
}

QString ChecklistPanel::lineText(int line) const {
  if (line < 0 || line >= lines()) return {};
  const Row& row = rows_[static_cast<std::size_t>(line)];
  return row.title->text() + QStringLiteral(": ") + row.found->text() +
         (row.mend->text().isEmpty() ? QString() : QLatin1Char(' ') + row.mend->text());
}

}  // namespace patina
