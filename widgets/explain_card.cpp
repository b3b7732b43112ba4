#include "widgets/explain_card.h"

#include <QPushButton>

#include "engine/effect/effect_info.h"
#include "engine/report/explanation_words.h"
#include "widgets/plot_widget.h"
#include "widgets/theme.h"

namespace patina {

namespace {

QString shown(const std::string& text) {
  return QString::fromStdString(text);
}

/// A bar without a number: the number stands beside it in words.
class ShareBar : public QWidget {
 public:
  ShareBar(double share, const QColor& colour, QWidget* parent)
      : QWidget(parent), share_(std::clamp(std::isfinite(share) ? share : 0.0, 0.0, 1.0)), colour_(colour) {
    setFixedHeight(7);
    setMinimumWidth(60);
  }

 protected:
  void paintEvent(QPaintEvent*) override {
    QPainter painter(this);
    painter.setRenderHint(QPainter::Antialiasing);
    painter.setPen(Qt::NoPen);
    painter.setBrush(theme::kSunken);
    painter.drawRoundedRect(QRectF(rect()), 3, 3);
    if (share_ <= 0) return;
    painter.setBrush(colour_);
    painter.drawRoundedRect(QRectF(0, 0, std::max(4.0, share_ * width()), height()), 3, 3);
  }

 private:
  double share_;
  QColor colour_;
};

QLabel* line(const QString& text, QWidget* parent, const char* role = nullptr) {
  auto* label = new QLabel(text, parent);
  label->setTextFormat(Qt::PlainText);
  label->setWordWrap(true);
  label->setTextInteractionFlags(Qt::TextSelectableByMouse);
  if (role) label->setProperty("role", role);
  return label;
}

/// Null where nothing can be drawn.
PlotWidget* plotOf(const SignaturePlot& plot, QWidget* parent) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const bool names = !plot.xNames.empty();
  const std::size_t count = names ? plot.xNames.size() : plot.x.size();
  PlotSeries expected, seen, spread;
  expected.name = ExplainCard::tr("expected from the effect");
  expected.colour = theme::kAccent;
  expected.mark = names ? PlotSeries::Mark::HollowDots : PlotSeries::Mark::Line;
  expected.penWidth = 2;
  seen.name = ExplainCard::tr("seen");
  seen.colour = theme::kWarning;
  seen.mark = PlotSeries::Mark::Dots;
  spread.colour = theme::kWarning;
  double lowX = 1e300, highX = -1e300, lowY = 1e300, highY = -1e300;
  const auto take = [&](double x, double y) {
    lowX = std::min(lowX, x), highX = std::max(highX, x);
    lowY = std::min(lowY, y), highY = std::max(highY, y);
  };
  for (std::size_t i = 0; i < count; ++i) {
    const double x = names ? static_cast<double>(i) : plot.x[i];
    if (!std::isfinite(x)) continue;
    if (i < plot.expected.size() && std::isfinite(plot.expected[i])) {
      expected.points.emplace_back(x, plot.expected[i]);
      take(x, plot.expected[i]);
    }
    if (i >= plot.seen.size() || !std::isfinite(plot.seen[i])) continue;
    seen.points.emplace_back(x, plot.seen[i]);
    take(x, plot.seen[i]);
    const double sd = i < plot.seenSd.size() ? plot.seenSd[i] : 0;
    if (!(sd > 0) || !std::isfinite(sd)) continue;
    for (const double y : {plot.seen[i] - sd, plot.seen[i] + sd}) {
      spread.points.emplace_back(x, y);
      take(x, y);
    }
    spread.points.emplace_back(x, kNone);
  }
  if (!(lowX <= highX)) return nullptr;
  const double marginY = std::max(0.08 * (highY - lowY), 1e-9 * std::max(std::abs(highY), 1e-6));
  const double marginX = names ? 0.5 : std::max(0.04 * (highX - lowX), 1e-6);
  auto* widget = new PlotWidget(parent);
  PlotAxis horizontal{shown(plot.xLabel), false, lowX - marginX, highX + marginX, {}};
  if (names) {
    const std::size_t stride = (count + 5) / 6;
    for (std::size_t i = 0; i < count; i += stride)
      horizontal.ticks.emplace_back(static_cast<double>(i), widget->fontMetrics().elidedText(
                                                                shown(plot.xNames[i]), Qt::ElideRight, 70));
  }
  widget->setAxes(horizontal, {shown(plot.yLabel), false, lowY - marginY, highY + marginY, {}});
  widget->setSeries({spread, expected, seen});
  widget->setLegend(Qt::TopLeftCorner);
  widget->setFixedHeight(170);
  widget->setToolTip(shown(plot.title));
  widget->setAccessibleName(shown(plot.title));
  return widget;
}

SignaturePlot plotOfCurve(const PhotoCurve& curve) {
  SignaturePlot plot;
  plot.title = curve.name;
  plot.xLabel = "photograph";
  plot.yLabel = curve.unit.empty() ? curve.name : curve.name + ", " + curve.unit;
  plot.x.assign(curve.photo.begin(), curve.photo.end());
  plot.seen = curve.value;
  plot.seenSd = curve.sd;
  return plot;
}

}  // namespace

ExplainCard::ExplainCard(const EffectFinding& finding, ExplainCardAction action, QWidget* parent)
    : QFrame(parent), id_(finding.id) {
  setObjectName(QStringLiteral("explainCard"));
  setStyleSheet(QStringLiteral("#explainCard { background: %1; border: 1px solid %2; border-radius: 7px; }")
                    .arg(theme::kPanel.name(), (finding.added ? theme::kAccentDeep : theme::kBorder).name()));
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(12, 10, 12, 12);
  column->setSpacing(6);
  auto* title = line(shown(effectTitle(finding.id)), this);
  QFont bold = title->font();
  bold.setBold(true);
  title->setFont(bold);
  column->addWidget(title);
  const EffectInfo* info = findEffect(finding.id);
  QString kind = shown(finding.id);
  if (info) kind += QStringLiteral("  \u00b7  ") + QString::fromLatin1(stageName(info->stage));
  kind += QStringLiteral("  \u00b7  ") + (finding.added ? tr("added") : tr("not added"));
  column->addWidget(line(kind, this, "caption"));

  const QColor colour = finding.added ? theme::kAccent : theme::kTextOff;
  column->addWidget(new ShareBar(evidenceShare(finding), colour, this));
  QString evidence = tr("Evidence: %1").arg(shown(evidenceWords(finding)));
  if (finding.sigmas > 0 && std::isfinite(finding.sigmas))
    evidence += tr(", %1 standard deviations").arg(shown(shortNumber(finding.sigmas)));
  if (finding.added && finding.confidence > 0)
    evidence += tr("; confidence %1").arg(shown(wholePercent(finding.confidence)));
  column->addWidget(line(evidence, this, "caption"));

  if (!finding.sentence.empty()) column->addWidget(line(shown(finding.sentence), this));
  QStringList values;
  for (const EffectEstimate& estimate : finding.parameters) values << shown(estimateText(estimate));
  if (!values.isEmpty()) column->addWidget(line(values.join(QStringLiteral("\n")), this));
  if (finding.holdoutRmsWith >= 0 && finding.holdoutRmsWithout >= 0)
    column->addWidget(
        line(tr("Error of prediction: %1 without it, %2 with it.")
                 .arg(shown(percent(finding.holdoutRmsWithout)), shown(percent(finding.holdoutRmsWith))),
             this));
  if (!finding.verdict.empty()) column->addWidget(line(shown(finding.verdict), this));

  // Of the others, those with evidence are worth a picture.
  if (finding.added || evidenceShare(finding) > 0.25) {
    for (const SignaturePlot& plot : finding.plots)
      if (PlotWidget* widget = plotOf(plot, this)) {
        column->addWidget(line(shown(plot.title), this, "caption"));
        column->addWidget(widget);
      }
    for (const PhotoCurve& curve : finding.curves)
      if (PlotWidget* widget = plotOf(plotOfCurve(curve), this)) {
        column->addWidget(line(tr("%1 over the photographs").arg(shown(curve.name)), this, "caption"));
        column->addWidget(widget);
      }
  }
  if (info && finding.added)
    column->addWidget(
        line(tr("At the next capture: %1").arg(shown(std::string(info->remedy))), this, "caption"));
  if (action == ExplainCardAction::None) return;
  button_ = new QPushButton(
      action == ExplainCardAction::TakeFit ? tr("Show the fit with it") : tr("Add and refit"), this);
  button_->setObjectName(
      (action == ExplainCardAction::TakeFit ? QStringLiteral("take-") : QStringLiteral("refit-")) +
      shown(finding.id));
  button_->setAccessibleName(tr("%1: %2").arg(button_->text(), shown(effectTitle(finding.id))));
  button_->setToolTip(
      action == ExplainCardAction::TakeFit
          ? tr("The maps of the fit with the added effects, in the window; undo takes them back")
          : tr("Fit again with this effect in the model, and show the error before and after"));
  auto* row = new QHBoxLayout;
  row->addWidget(button_);
  row->addStretch(1);
  column->addLayout(row);
  connect(button_, &QPushButton::clicked, this, &ExplainCard::pressed);
}

QString ExplainCard::text() const {
  QStringList parts;
  for (const QLabel* label : findChildren<QLabel*>()) parts << label->text();
  return parts.join(QLatin1Char('\n'));
}

}  // namespace patina
