#include "widgets/certainty_bar.h"

#include "engine/render/measured_sphere.h"
#include "widgets/theme.h"

namespace patina {

CertaintyBar::CertaintyBar(QWidget* parent) : QWidget(parent) {
  setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Fixed);
  setAccessibleName(tr("Colours of the certainty"));
  setPriorSd(priorSd_);
}

void CertaintyBar::setPriorSd(double priorSd) {
  priorSd_ = priorSd > 0 ? priorSd : 1;
  setToolTip(
      tr("How far the radiance may be off (one standard deviation). Blue: the photographs measured it. "
         "Orange: they did not; it is what materials usually do, %1.")
          .arg(certaintyText(priorSd_)));
  update();
}

QSize CertaintyBar::sizeHint() const {
  const QFontMetrics metrics(theme::captionFont());
  return {220, 2 * metrics.height() + 16};
}

QSize CertaintyBar::minimumSizeHint() const {
  return {140, sizeHint().height()};
}

void CertaintyBar::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.setFont(theme::captionFont());
  const QFontMetricsF metrics(painter.font());
  const QRectF bar(6, metrics.height() + 3, width() - 12, 9);
  if (bar.width() < 40) return;
  for (int x = 0; x < static_cast<int>(bar.width()); ++x) {
    const auto colour = certaintyColour(static_cast<float>((x + 0.5) / bar.width()));
    painter.fillRect(QRectF(bar.left() + x, bar.top(), 1.5, bar.height()),
                     QColor::fromRgbF(colour[0], colour[1], colour[2]));
  }
  painter.setPen(theme::kTextDim);
  const QRectF above(bar.left(), 1, bar.width(), metrics.height());
  const QString left = tr("measured"), right = tr("extrapolated");
  painter.drawText(above, Qt::AlignLeft, left);
  if (metrics.horizontalAdvance(left + right) + 12 < bar.width())
    painter.drawText(above, Qt::AlignRight, right);
  painter.setPen(theme::kText);
  double lastEnd = -1e9;
  for (const double percent : {0.0, 5.0, 10.0, 20.0, 40.0, 70.0, 100.0, 150.0, 200.0, 300.0, 500.0, 1000.0}) {
    const double part = std::log1p(percent / 100) / priorSd_;
    if (part > 1.001) break;
    const QString text = QStringLiteral("±%1\u202f%").arg(percent);
    const double wide = metrics.horizontalAdvance(text), at = bar.left() + part * bar.width();
    const double from = std::clamp(at - wide / 2, 1.0, std::max(1.0, width() - wide - 1));
    if (from < lastEnd + 6) continue;
    lastEnd = from + wide;
    painter.drawLine(QPointF(at, bar.bottom()), QPointF(at, bar.bottom() + 3));
    painter.drawText(QRectF(from, bar.bottom() + 3, wide + 1, metrics.height()), Qt::AlignLeft, text);
  }
}

QString certaintyText(double sd) {
  if (sd < 0) return QObject::tr("not known");
  const double percent = 100 * std::expm1(sd);
  if (percent > 100) return QObject::tr("a factor of %1 either way").arg(std::exp(sd), 0, 'f', 1);
  return QStringLiteral("±\u202f%1\u202f%").arg(percent, 0, 'f', percent < 9.95 ? 1 : 0);
}

}  // namespace patina
