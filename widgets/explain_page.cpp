#include "widgets/explain_page.h"

#include <QDataStream>
#include <QFileInfo>
#include <QHeaderView>
#include <QIODevice>
#include <QPushButton>
#include <QScrollArea>
#include <QSplitter>
#include <QStackedWidget>
#include <QTableWidget>

#include "engine/report/explanation_words.h"
#include "widgets/explain_card.h"
#include "widgets/explain_details.h"
#include "widgets/theme.h"

namespace patina {

namespace {

QString shown(const std::string& text) {
  return QString::fromStdString(text);
}

/// How many cards of effects that were not added are worth showing without evidence.
constexpr std::size_t kMostWithoutEvidence = 6;

QPushButton* button(const QString& text, const char* name, const QString& tip, QWidget* parent) {
  auto* made = new QPushButton(text, parent);
  made->setObjectName(QLatin1String(name));
  made->setToolTip(tip);
  return made;
}

QString percentOf(double share) {
  return share >= 0 && std::isfinite(share) ? QString::number(100 * share, 'f', 2) + QStringLiteral(" %")
                                            : QStringLiteral("\u2013");
}

}  // namespace

ExplainPage::ExplainPage(QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("explainPage"));
  pages_ = new QStackedWidget(this);
  buildStart();
  buildResult();
  pages_->addWidget(startPage_);
  pages_->addWidget(resultPage_);
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 0, 0, 0);
  column->addWidget(pages_);
  setFurther({});
  refreshHeader();
}

void ExplainPage::buildStart() {
  startPage_ = new QWidget(this);
  invitation_ = new QLabel(startPage_);
  invitation_->setObjectName(QStringLiteral("explainInvitation"));
  invitation_->setTextFormat(Qt::RichText);
  invitation_->setWordWrap(true);
  invitation_->setMinimumWidth(300);
  invitation_->setMaximumWidth(620);
  furtherLabel_ = new QLabel(startPage_);
  furtherLabel_->setObjectName(QStringLiteral("explainFurther"));
  furtherLabel_->setTextFormat(Qt::PlainText);
  furtherLabel_->setWordWrap(true);
  furtherLabel_->setMaximumWidth(620);
  furtherLabel_->setProperty("role", "caption");
  start_ = button(tr("Explain"), "explainStart",
                  tr("Fit, find what the model lacks, add it, and fit again (Ctrl+E)"), startPage_);
  start_->setProperty("primary", true);
  further_ = button(tr("Add a Bundle\u2026"), "explainAddBundle",
                    tr("Another bundle of the same rig or the same sample: they are explained together"),
                    startPage_);
  clearFurther_ =
      button(tr("Without Them"), "explainClearBundles", tr("Explain the open bundle alone"), startPage_);
  startBack_ = button(tr("Back"), "explainStartBack", tr("Back to the maps and photographs"), startPage_);
  auto* row = new QHBoxLayout;
  row->addWidget(start_);
  row->addWidget(further_);
  row->addWidget(clearFurther_);
  row->addWidget(startBack_);
  row->addStretch(1);
  auto* inner = new QVBoxLayout;
  inner->addStretch(2);
  inner->addWidget(invitation_);
  inner->addSpacing(6);
  inner->addWidget(furtherLabel_);
  inner->addSpacing(12);
  inner->addLayout(row);
  inner->addStretch(3);
  auto* outer = new QHBoxLayout(startPage_);
  outer->addStretch(1);
  outer->addLayout(inner, 4);
  outer->addStretch(1);
  connect(start_, &QPushButton::clicked, this, &ExplainPage::startRequested);
  connect(further_, &QPushButton::clicked, this, &ExplainPage::furtherRequested);
  connect(clearFurther_, &QPushButton::clicked, this, &ExplainPage::furtherCleared);
  connect(startBack_, &QPushButton::clicked, this, &ExplainPage::backRequested);
}

void ExplainPage::buildResult() {
  resultPage_ = new QWidget(this);
  verdict_ = new QLabel(resultPage_);
  verdict_->setObjectName(QStringLiteral("explainVerdict"));
  verdict_->setTextFormat(Qt::PlainText);
  verdict_->setWordWrap(true);
  verdict_->setTextInteractionFlags(Qt::TextSelectableByMouse);
  QFont large = verdict_->font();
  large.setPointSizeF(large.pointSizeF() * 1.25);
  large.setBold(true);
  verdict_->setFont(large);
  numbers_ = new QLabel(resultPage_);
  numbers_->setObjectName(QStringLiteral("explainNumbers"));
  numbers_->setTextFormat(Qt::PlainText);
  numbers_->setWordWrap(true);
  numbers_->setTextInteractionFlags(Qt::TextSelectableByMouse);
  back_ = button(tr("Back"), "explainBack", tr("Back to the maps and photographs"), resultPage_);
  again_ =
      button(tr("Explain Again"), "explainAgain", tr("Find out again what the model lacks"), resultPage_);
  save_ = button(tr("Save Report\u2026"), "explainSave",
                 tr("Write report.html, explain.json and the final fit into a folder"), resultPage_);
  auto* words = new QVBoxLayout;
  words->setSpacing(3);
  words->addWidget(verdict_);
  words->addWidget(numbers_);
  auto* head = new QHBoxLayout;
  head->setContentsMargins(12, 9, 12, 9);
  head->setSpacing(8);
  head->addLayout(words, 1);
  for (QPushButton* one : {back_, again_, save_}) head->addWidget(one, 0, Qt::AlignTop);

  table_ = new QTableWidget(0, 4, resultPage_);
  table_->setObjectName(QStringLiteral("explainPhotographs"));
  table_->setAccessibleName(tr("Photographs, worst predicted first"));
  table_->setEditTriggers(QAbstractItemView::NoEditTriggers);
  table_->setSelectionBehavior(QAbstractItemView::SelectRows);
  table_->setSelectionMode(QAbstractItemView::SingleSelection);
  table_->setShowGrid(false);
  table_->setTabKeyNavigation(false);
  table_->verticalHeader()->hide();
  table_->verticalHeader()->setDefaultSectionSize(fontMetrics().height() + 8);
  table_->setHorizontalHeaderLabels({tr("Photograph"), tr("Noise"), tr("Before"), tr("After")});
  table_->horizontalHeader()->setSectionResizeMode(QHeaderView::ResizeToContents);
  table_->horizontalHeader()->setSectionResizeMode(0, QHeaderView::Stretch);
  table_->horizontalHeaderItem(0)->setToolTip(tr("Worst predicted first; those with a picture are bright"));
  table_->setMinimumWidth(200);
  pictures_ = new ExplainPictures(resultPage_);
  details_ = new ExplainDetails(resultPage_);
  scroll_ = new QScrollArea(resultPage_);
  scroll_->setObjectName(QStringLiteral("explainCards"));
  scroll_->setAccessibleName(tr("Effects that were added and considered"));
  scroll_->setWidgetResizable(true);
  scroll_->setFrameShape(QFrame::NoFrame);
  scroll_->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  scroll_->setMinimumWidth(250);

  const auto splitter = [this](Qt::Orientation orientation) {
    auto* made = new QSplitter(orientation, resultPage_);
    made->setHandleWidth(3);
    made->setChildrenCollapsible(false);
    return made;
  };
  middle_ = splitter(Qt::Vertical);
  middle_->addWidget(pictures_);
  middle_->addWidget(details_);
  middle_->setStretchFactor(0, 3);
  middle_->setStretchFactor(1, 2);
  middle_->setSizes({480, 250});
  columns_ = splitter(Qt::Horizontal);
  columns_->addWidget(table_);
  columns_->addWidget(middle_);
  columns_->addWidget(scroll_);
  columns_->setStretchFactor(0, 2);
  columns_->setStretchFactor(1, 5);
  columns_->setStretchFactor(2, 3);
  columns_->setSizes({290, 620, 370});
  auto* column = new QVBoxLayout(resultPage_);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(0);
  column->addLayout(head);
  column->addWidget(columns_, 1);

  connect(back_, &QPushButton::clicked, this, &ExplainPage::backRequested);
  connect(again_, &QPushButton::clicked, this, &ExplainPage::startRequested);
  connect(save_, &QPushButton::clicked, this, &ExplainPage::saveRequested);
  connect(table_, &QTableWidget::currentCellChanged, this, [this](int row) { showRow(row); });
}

void ExplainPage::setSubject(const QString& name, const QString& summary) {
  name_ = name;
  summary_ = summary;
  refreshHeader();
}

void ExplainPage::setFurther(const QStringList& folders) {
  QStringList names;
  for (const QString& folder : folders) names << QFileInfo(folder).fileName();
  furtherLabel_->setText(names.isEmpty() ? QString()
                                         : tr("Together with: %1").arg(names.join(QStringLiteral(", "))));
  furtherLabel_->setToolTip(folders.join(QLatin1Char('\n')));
  furtherLabel_->setVisible(!names.isEmpty());
  clearFurther_->setVisible(!names.isEmpty());
}

void ExplainPage::setRunning(bool running, const QString& words) {
  running_ = running;
  again_->setEnabled(!running);
  start_->setEnabled(!running && !name_.isEmpty());
  further_->setEnabled(!running && !name_.isEmpty());
  clearFurther_->setEnabled(!running);
  for (ExplainCard* card : cards_)
    if (card->button()) card->button()->setEnabled(!running);
  start_->setText(running && !words.isEmpty() ? words : tr("Explain"));
}

void ExplainPage::setMayGoBack(bool possible) {
  back_->setVisible(possible);
  startBack_->setVisible(possible);
}

void ExplainPage::setExplanation(ExplanationPtr explanation, ResidualViews views, bool mayRefit) {
  explanation_ = std::move(explanation);
  pictures_->setExplanation(explanation_, std::move(views));
  details_->setExplanation(explanation_);
  refreshCards(mayRefit);
  refreshTable();
  refreshHeader();
  pages_->setCurrentWidget(explanation_ ? resultPage_ : startPage_);
}

QString ExplainPage::verdict() const {
  return verdict_->text();
}

QString ExplainPage::numbers() const {
  return numbers_->text();
}

void ExplainPage::refreshHeader() {
  invitation_->setText(name_.isEmpty() ? tr("<p>Open a bundle first.</p>")
                                       : tr("<p style='font-size:large'><b>What does the model "
                                            "lack?</b></p><p>Patina fits <b>%1</b> (%2), looks at "
                                            "what is left of the photographs, and tries every effect of its "
                                            "catalogue on it. What explains it is "
                                            "added, the fit is made again, and the error on photographs that "
                                            "the fit never saw is compared before "
                                            "and after.</p>")
                                             .arg(name_.toHtmlEscaped(), summary_.toHtmlEscaped()));
  start_->setEnabled(!running_ && !name_.isEmpty());
  further_->setEnabled(!running_ && !name_.isEmpty());
  if (!explanation_) {
    verdict_->clear();
    numbers_->clear();
    return;
  }
  const ExplanationVerdict verdict = verdictOf(*explanation_);
  using Mood = ExplanationVerdict::Mood;
  const QColor colour = verdict.mood == Mood::Nothing   ? theme::kGood
                        : verdict.mood == Mood::Unnamed ? theme::kWarning
                                                        : theme::kText;
  verdict_->setStyleSheet(QStringLiteral("color: %1").arg(colour.name()));
  verdict_->setText(shown(verdict.headline));
  numbers_->setText(shown(verdict.detail));
}

void ExplainPage::refreshTable() {
  const QSignalBlocker quiet(table_);
  const std::size_t count = explanation_ ? explanation_->photos.size() : 0;
  table_->setRowCount(static_cast<int>(count));
  table_->setColumnHidden(3, !explanation_ || explanation_->effects.empty());
  const bool several = explanation_ && explanation_->bundles.size() > 1;
  for (std::size_t i = 0; i < count; ++i) {
    const PhotoResidual& photo = explanation_->photos[i];
    const auto picture = std::ranges::find_if(explanation_->pictures, [&](const ResidualPicture& one) {
      return one.bundle == photo.bundle && one.photo == photo.photo;
    });
    const bool has = picture != explanation_->pictures.end();
    QString tip = shown(photo.file);
    if (!photo.what.empty()) tip += QLatin1Char('\n') + shown(photo.what);
    if (photo.holdout) tip += QLatin1Char('\n') + tr("Held out: the fit never saw it");
    if (!has) tip += QLatin1Char('\n') + tr("No picture was kept");
    QString name = photo.what.empty() ? shown(photo.file) : shown(photo.what);
    if (several) name = QStringLiteral("%1: ").arg(photo.bundle + 1) + name;
    if (photo.holdout) name += tr(" \u2022");
    const QString cells[] = {name, percentOf(photo.noise), percentOf(photo.before), percentOf(photo.after)};
    for (int column = 0; column < 4; ++column) {
      auto* item = new QTableWidgetItem(cells[column]);
      item->setToolTip(tip);
      if (column > 0) item->setTextAlignment(Qt::AlignRight | Qt::AlignVCenter);
      if (!has) item->setForeground(theme::kTextDim);
      if (column == 0)
        item->setData(Qt::UserRole, has ? static_cast<int>(picture - explanation_->pictures.begin()) : -1);
      table_->setItem(static_cast<int>(i), column, item);
    }
  }
  if (count > 0) {
    // The worst that there is a picture of.
    int first = 0;
    while (first + 1 < static_cast<int>(count) && table_->item(first, 0)->data(Qt::UserRole).toInt() < 0)
      ++first;
    if (table_->item(first, 0)->data(Qt::UserRole).toInt() < 0) first = 0;
    table_->setCurrentCell(first, 0);
    showRow(first);
  }
}

void ExplainPage::showRow(int row) {
  if (row < 0 || row >= table_->rowCount()) return;
  pictures_->showPicture(table_->item(row, 0)->data(Qt::UserRole).toInt());
}

void ExplainPage::refreshCards(bool mayRefit) {
  cards_.clear();
  auto* content = new QWidget(scroll_);
  auto* column = new QVBoxLayout(content);
  column->setContentsMargins(8, 8, 8, 8);
  column->setSpacing(8);
  const auto heading = [&](const QString& text) {
    auto* label = new QLabel(text, content);
    label->setProperty("role", "caption");
    column->addWidget(label);
  };
  const auto add = [&](const EffectFinding& finding, ExplainCardAction action) {
    auto* card = new ExplainCard(finding, action, content);
    connect(card, &ExplainCard::pressed, this, [this, action, id = shown(finding.id)] {
      action == ExplainCardAction::TakeFit ? takeFitRequested() : refitRequested(id);
    });
    if (card->button()) card->button()->setEnabled(!running_);
    column->addWidget(card);
    cards_.push_back(card);
  };
  if (explanation_) {
    const bool fit = explanation_->fourierAfter || explanation_->twoShotAfter;
    if (!explanation_->effects.empty()) heading(tr("Added to the model, strongest first"));
    for (const EffectFinding& finding : explanation_->effects)
      add(finding, fit ? ExplainCardAction::TakeFit : ExplainCardAction::None);
    if (!explanation_->considered.empty()) heading(tr("Also considered"));
    std::size_t without = 0;
    for (const EffectFinding& finding : explanation_->considered) {
      const bool evidence = finding.correctedP <= 0.05 && finding.sigmas > 0;
      if (!evidence && ++without > kMostWithoutEvidence) continue;
      add(finding, mayRefit && finding.sigmas > 0 ? ExplainCardAction::Refit : ExplainCardAction::None);
    }
    if (without > kMostWithoutEvidence)
      heading(tr("%1 more without evidence are in the report.").arg(without - kMostWithoutEvidence));
  }
  column->addStretch(1);
  scroll_->setWidget(content);  // the old one goes
}

QByteArray ExplainPage::saveLayout() const {
  QByteArray state;
  QDataStream stream(&state, QIODevice::WriteOnly);
  stream << columns_->saveState() << middle_->saveState();
  return state;
}

void ExplainPage::restoreLayout(const QByteArray& state) {
  QDataStream stream(state);
  for (QSplitter* splitter : {columns_, middle_}) {
    QByteArray one;
    stream >> one;
    if (stream.status() != QDataStream::Ok) return;
    splitter->restoreState(one);
  }
}

}  // namespace patina
