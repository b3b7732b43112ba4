#include "widgets/error_banner.h"

#include <QStyle>

#include "widgets/theme.h"

namespace patina {

namespace {
QString asSentence(QString text) {
  text = text.trimmed();
  if (text.isEmpty()) return text;
  text[0] = text[0].toUpper();
  if (!text.endsWith('.') && !text.endsWith('?') && !text.endsWith('!')) text += '.';
  return text;
}
}  // namespace

ErrorBanner::ErrorBanner(QWidget* parent) : QFrame(parent) {
  setObjectName(QStringLiteral("errorBanner"));
  setAttribute(Qt::WA_StyledBackground);
  const auto label = [this](const QString& name) {
    auto* made = new QLabel(this);
    made->setObjectName(name);
    made->setTextFormat(Qt::PlainText);
    made->setWordWrap(true);
    made->setTextInteractionFlags(Qt::TextSelectableByMouse | Qt::TextSelectableByKeyboard);
    return made;
  };
  what_ = label(QStringLiteral("bannerWhat"));
  where_ = label(QStringLiteral("bannerWhere"));
  tryThis_ = label(QStringLiteral("bannerTry"));
  QFont bold = what_->font();
  bold.setBold(true);
  what_->setFont(bold);
  close_ = new QToolButton(this);
  close_->setIcon(theme::icon(QStringLiteral("close")));
  close_->setToolTip(tr("Close this message"));
  close_->setAccessibleName(tr("Close this message"));
  connect(close_, &QToolButton::clicked, this, &QWidget::hide);

  auto* texts = new QVBoxLayout;
  texts->setSpacing(2);
  texts->addWidget(what_);
  texts->addWidget(where_);
  texts->addWidget(tryThis_);
  auto* row = new QHBoxLayout(this);
  row->setContentsMargins(14, 8, 8, 8);
  row->addLayout(texts, 1);
  row->addWidget(close_, 0, Qt::AlignTop);
  hide();
}

void ErrorBanner::showError(const QString& doing, const Error& error) {
  const QString what = asSentence(QString::fromStdString(error.what));
  what_->setText(doing.isEmpty() ? what : doing + QStringLiteral(": ") + what);
  where_->setText(error.where.empty() ? QString() : tr("Where: %1").arg(QString::fromStdString(error.where)));
  tryThis_->setText(error.tryThis.empty()
                        ? QString()
                        : tr("What to try: %1").arg(asSentence(QString::fromStdString(error.tryThis))));
  present(Kind::Problem);
}

void ErrorBanner::showNotice(const QString& sentence) {
  what_->setText(sentence);
  where_->clear();
  tryThis_->clear();
  present(Kind::Notice);
}

void ErrorBanner::present(Kind kind) {
  kind_ = kind;
  where_->setVisible(!where_->text().isEmpty());
  tryThis_->setVisible(!tryThis_->text().isEmpty());
  const bool problem = kind == Kind::Problem;
  setStyleSheet(QStringLiteral("#errorBanner { background: %1; border-left: 4px solid %2; }")
                    .arg(problem ? QStringLiteral("#472624") : QStringLiteral("#3c3426"),
                         (problem ? theme::kError : theme::kWarning).name()));
  setAccessibleName(text());
  show();
}

QString ErrorBanner::text() const {
  QStringList lines{what_->text()};
  if (!where_->text().isEmpty()) lines << where_->text();
  if (!tryThis_->text().isEmpty()) lines << tryThis_->text();
  return lines.join('\n');
}

}  // namespace patina
