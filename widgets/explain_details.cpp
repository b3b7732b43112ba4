#include "widgets/explain_details.h"

#include <QHeaderView>
#include <QScrollArea>
#include <QTableWidget>

#include "engine/report/explanation_words.h"
#include "widgets/plot_widget.h"
#include "widgets/theme.h"

namespace patina {

namespace {

/// Labels of a breakdown that a small plot has room for.
constexpr std::size_t kMostLabels = 10;

QString shown(const std::string& text) {
  return QString::fromStdString(text);
}

/// Null where there is nothing to draw.
PlotWidget* plotOf(const ResidualBreakdown& breakdown, bool after, QWidget* parent) {
  const auto series = [&](const std::vector<double>& values, const QString& name, const QColor& colour) {
    PlotSeries made;
    made.name = name;
    made.colour = colour;
    made.mark = PlotSeries::Mark::Dots;
    for (std::size_t i = 0; i < std::min(values.size(), breakdown.label.size()); ++i)
      if (std::isfinite(values[i]) && values[i] > 0)
        made.points.emplace_back(static_cast<double>(i), values[i]);
    return made;
  };
  std::vector<PlotSeries> all{series(breakdown.before, ExplainDetails::tr("before"), theme::kWarning)};
  if (after) all.push_back(series(breakdown.after, ExplainDetails::tr("after"), theme::kAccent));
  double low = 1, high = 1;
  bool any = false;
  for (const PlotSeries& one : all)
    for (const QPointF& point : one.points) {
      low = std::min(low, point.y()), high = std::max(high, point.y());
      any = true;
    }
  if (!any) return nullptr;
  const bool logarithmic = high > 12;
  const double count = static_cast<double>(breakdown.label.size());
  PlotSeries noise;
  noise.name = ExplainDetails::tr("noise alone");
  noise.colour = theme::kTextDim;
  noise.mark = PlotSeries::Mark::DashedLine;
  noise.points = {{-0.5, 1}, {count - 0.5, 1}};
  all.insert(all.begin(), noise);
  auto* plot = new PlotWidget(parent);
  PlotAxis horizontal{ExplainDetails::tr("by %1").arg(shown(breakdown.by)), false, -0.5, count - 0.5, {}};
  const std::size_t stride = (breakdown.label.size() + kMostLabels - 1) / kMostLabels;
  for (std::size_t i = 0; i < breakdown.label.size(); i += stride)
    horizontal.ticks.emplace_back(static_cast<double>(i), plot->fontMetrics().elidedText(
                                                              shown(breakdown.label[i]), Qt::ElideRight, 60));
  plot->setAxes(horizontal, {ExplainDetails::tr("residual / noise, squared"),
                             logarithmic,
                             logarithmic ? low * 0.8 : 0,
                             high * (logarithmic ? 1.3 : 1.1),
                             {}});
  plot->setReadout([labels = breakdown.label](const PlotSeries& series, const QPointF& point) {
    const auto index = static_cast<std::size_t>(std::max(0.0, std::round(point.x())));
    return QStringLiteral("%1, %2: %3")
        .arg(index < labels.size() ? shown(labels[index]) : QString(), series.name,
             shown(shortNumber(point.y())));
  });
  plot->setSeries(std::move(all));
  plot->setMinimumWidth(260);
  return plot;
}

}  // namespace

ExplainDetails::ExplainDetails(QWidget* parent) : QTabWidget(parent) {
  setObjectName(QStringLiteral("explainDetails"));
  const auto scrolled = [this](QWidget* inside, const QString& name) {
    auto* scroll = new QScrollArea(this);
    scroll->setWidget(inside);
    scroll->setWidgetResizable(true);
    scroll->setFrameShape(QFrame::NoFrame);
    scroll->setAccessibleName(name);
    return scroll;
  };
  breakdowns_ = new QWidget(this);
  auto* row = new QHBoxLayout(breakdowns_);
  row->setContentsMargins(8, 4, 8, 4);
  addTab(scrolled(breakdowns_, tr("Where the residual sits")), tr("Where it sits"));

  budget_ = new QTableWidget(0, 4, this);
  budget_->setObjectName(QStringLiteral("explainBudget"));
  budget_->setAccessibleName(tr("What could hide in these photographs"));
  budget_->setHorizontalHeaderLabels(
      {tr("Effect"), tr("As large as"), tr("Would shift, median"), tr("In words")});
  budget_->setEditTriggers(QAbstractItemView::NoEditTriggers);
  budget_->setSelectionBehavior(QAbstractItemView::SelectRows);
  budget_->setShowGrid(false);
  budget_->verticalHeader()->hide();
  budget_->horizontalHeader()->setSectionResizeMode(QHeaderView::ResizeToContents);
  budget_->horizontalHeader()->setStretchLastSection(true);
  budget_->setWordWrap(true);
  addTab(budget_, tr("What could hide"));
  setTabToolTip(
      1, tr("How large each effect that was not found could be without being seen (95 %), and how far it "
            "would move the result"));

  remarks_ = new QLabel(this);
  remarks_->setObjectName(QStringLiteral("explainRemarks"));
  remarks_->setTextFormat(Qt::PlainText);
  remarks_->setWordWrap(true);
  remarks_->setAlignment(Qt::AlignTop | Qt::AlignLeft);
  remarks_->setContentsMargins(12, 8, 12, 8);
  remarks_->setTextInteractionFlags(Qt::TextSelectableByMouse | Qt::TextSelectableByKeyboard);
  addTab(scrolled(remarks_, tr("Remarks")), tr("Remarks"));
}

void ExplainDetails::setExplanation(std::shared_ptr<const Explanation> explanation) {
  explanation_ = std::move(explanation);
  refreshBreakdowns();
  refreshBudget();
  refreshRemarks();
}

QString ExplainDetails::remarks() const {
  return remarks_->text();
}

void ExplainDetails::refreshBreakdowns() {
  QLayout* row = breakdowns_->layout();
  while (QLayoutItem* item = row->takeAt(0)) {
    delete item->widget();
    delete item;
  }
  if (!explanation_) return;
  for (const ResidualBreakdown& breakdown : explanation_->breakdowns)
    if (PlotWidget* plot = plotOf(breakdown, !explanation_->effects.empty(), breakdowns_)) {
      // One legend for all of them, where it covers least.
      plot->setLegend(row->count() == 0 ? std::optional(Qt::TopLeftCorner) : std::nullopt);
      row->addWidget(plot);
    }
}

void ExplainDetails::refreshBudget() {
  const std::size_t count = explanation_ ? explanation_->budget.size() : 0;
  budget_->setRowCount(static_cast<int>(count));
  for (std::size_t i = 0; i < count; ++i) {
    const BudgetLine& budget = explanation_->budget[i];
    QStringList shifts;
    for (const BudgetLine::Shift& shift : budget.shifts)
      shifts << shown(shift.quantity + " " + amountText(shift.quantity, shift.value, shift.unit));
    const QString cells[] = {shown(effectTitle(budget.id)),
                             shown(parameterWords(budget.parameter) + " " +
                                   amountText(budget.parameter, budget.largestUnseen, budget.unit)),
                             shifts.join(QStringLiteral(", ")), shown(budget.sentence)};
    for (int column = 0; column < 4; ++column) {
      auto* item = new QTableWidgetItem(cells[column]);
      item->setToolTip(cells[column]);
      budget_->setItem(static_cast<int>(i), column, item);
    }
  }
  setTabVisible(1, count > 0);
}

void ExplainDetails::refreshRemarks() {
  QStringList parts;
  if (explanation_) {
    for (const auto& group : explanation_->confusable) {
      if (group.size() < 2) continue;
      QStringList names;
      for (const std::string& id : group)
        names << QStringLiteral("\u201c%1\u201d").arg(shown(effectTitle(id)));
      parts << tr("Not told apart by these photographs: %1.").arg(names.join(tr(" or ")));
    }
    for (const Suggestion& suggestion : explanation_->suggest)
      parts << tr("To tell \u201c%1\u201d from \u201c%2\u201d: %3")
                   .arg(shown(effectTitle(suggestion.separatesA)), shown(effectTitle(suggestion.separatesB)),
                        shown(suggestion.capture));
    if (explanation_->unexplained.fraction > 0 || !explanation_->unexplained.description.empty())
      parts << tr("Left over: %1 of what was above the noise. %2")
                   .arg(shown(wholePercent(explanation_->unexplained.fraction)),
                        shown(explanation_->unexplained.description));
    for (const std::string& remark : explanation_->remarks) parts << shown(remark);
  }
  remarks_->setText(parts.join(QStringLiteral("\n\n")));
  setTabVisible(2, !parts.isEmpty());
}

}  // namespace patina
