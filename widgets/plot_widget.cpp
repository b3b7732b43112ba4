#include "widgets/plot_widget.h"

#include <QEvent>

#include "widgets/colour_bar.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr double kDotRadius = 3.2;

double along(const PlotAxis& axis, double value) {
  if (axis.logarithmic) {
    // Nothing below the axis has a place; far below is as good as any.
    if (!(value > 0)) return -10;
    return std::log(value / axis.low) / std::log(axis.high / axis.low);
  }
  return (value - axis.low) / (axis.high - axis.low);
}

QString superscript(int power) {
  static const QString digits =
      QStringLiteral("\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079");
  QString text = QStringLiteral("10");
  if (power < 0) text += QStringLiteral("\u207b");
  for (const QChar digit : QString::number(std::abs(power))) text += digits[digit.digitValue()];
  return text;
}

std::vector<std::pair<double, QString>> ticksOf(const PlotAxis& axis, int wanted) {
  if (!axis.ticks.empty()) return axis.ticks;
  std::vector<std::pair<double, QString>> ticks;
  if (axis.logarithmic) {
    const int first = static_cast<int>(std::ceil(std::log10(axis.low) - 1e-9));
    const int last = static_cast<int>(std::floor(std::log10(axis.high) + 1e-9));
    const int step = std::max(1, (last - first + 1 + wanted - 1) / std::max(1, wanted));
    for (int power = first; power <= last; power += step)
      ticks.emplace_back(std::pow(10.0, power), superscript(power));
    return ticks;
  }
  const auto values = roundTicks(axis.low, axis.high, wanted);
  const double step = values.size() > 1 ? values[1] - values[0] : axis.high - axis.low;
  for (const double value : values) {
    QString text = tickText(value, step);
    if (text.startsWith('-')) text[0] = QChar(0x2212);
    ticks.emplace_back(value, text);
  }
  return ticks;
}

QString readable(double value) {
  const double size = std::abs(value);
  if (size != 0 && (size < 1e-3 || size >= 1e5)) return QString::number(value, 'e', 2);
  return QString::number(value, 'g', 4);
}

}  // namespace

PlotWidget::PlotWidget(QWidget* parent) : QWidget(parent) {
  setMouseTracking(true);
  setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Expanding);
}

void PlotWidget::setAxes(PlotAxis horizontal, PlotAxis vertical) {
  horizontal_ = std::move(horizontal);
  vertical_ = std::move(vertical);
  update();
}

void PlotWidget::setSeries(std::vector<PlotSeries> series) {
  series_ = std::move(series);
  update();
}

void PlotWidget::setGuides(std::vector<std::pair<double, QString>> guides) {
  guides_ = std::move(guides);
  update();
}

void PlotWidget::setEmptyText(const QString& text) {
  emptyText_ = text;
  update();
}

void PlotWidget::setLegend(std::optional<Qt::Corner> corner) {
  legend_ = corner;
  update();
}

void PlotWidget::setReadout(std::function<QString(const PlotSeries&, const QPointF&)> readout) {
  readout_ = std::move(readout);
}

void PlotWidget::clear() {
  series_.clear();
  guides_.clear();
  update();
}

QRectF PlotWidget::frame() const {
  const QFontMetricsF metrics(theme::captionFont());
  const double left = metrics.horizontalAdvance(QStringLiteral("\u22120.000")) + metrics.height() + 10;
  const double below =
      metrics.height() * (horizontal_.title.isEmpty() ? 1 : 2) + (horizontal_.title.isEmpty() ? 5 : 9);
  return QRectF(rect()).adjusted(left, 6, -12, -below);
}

QPointF PlotWidget::place(const QPointF& value) const {
  const QRectF area = frame();
  return {area.left() + along(horizontal_, value.x()) * area.width(),
          area.bottom() - along(vertical_, value.y()) * area.height()};
}

void PlotWidget::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.setFont(theme::captionFont());
  if (series_.empty()) {
    painter.setPen(theme::kTextDim);
    painter.drawText(rect().adjusted(16, 8, -16, -8), Qt::AlignCenter | Qt::TextWordWrap, emptyText_);
    return;
  }
  const QRectF area = frame();
  if (area.width() < 40 || area.height() < 24) return;
  painter.fillRect(area, theme::kSunken);
  paintAxes(painter, area);
  painter.setRenderHint(QPainter::Antialiasing);
  painter.save();
  painter.setClipRect(area.adjusted(-1, -1, 1, 1));
  for (const auto& [value, text] : guides_) {
    const double x = place({value, 1}).x();
    painter.setPen(QPen(theme::kTextOff, 1, Qt::DotLine));
    painter.drawLine(QPointF(x, area.top()), QPointF(x, area.bottom()));
    painter.setPen(theme::kTextOff);
    const bool nearRight = x > area.center().x();
    const QRectF box(nearRight ? x - 154 : x + 4, area.bottom() - painter.fontMetrics().height() - 2, 150,
                     painter.fontMetrics().height());
    painter.drawText(box, nearRight ? Qt::AlignRight : Qt::AlignLeft, text);
  }
  for (const PlotSeries& series : series_) paintSeries(painter, series);
  painter.restore();
  if (legend_) paintLegend(painter, area);
  if (cursor_) {
    const PlotSeries* of = nullptr;
    if (const auto value = nearest(*cursor_, &of)) {
      const QPointF at = place(*value);
      painter.setPen(QPen(Qt::white, 1.2));
      painter.setBrush(Qt::NoBrush);
      painter.drawEllipse(at, kDotRadius + 2.5, kDotRadius + 2.5);
      QString across = readable(value->x());
      for (const auto& [tick, name] : horizontal_.ticks)  // a tick's name may differ from its place
        if (tick == value->x()) across = name;
      const QString text = readout_
                               ? readout_(*of, *value)
                               : of->name + QStringLiteral("  (%1, %2)").arg(across, readable(value->y()));
      const QFontMetricsF metrics(painter.font());
      QRectF box(0, 0, metrics.horizontalAdvance(text) + 12, metrics.height() + 6);
      box.moveCenter(at - QPointF(0, metrics.height() + 8));
      box.moveLeft(std::clamp(box.left(), 2.0, std::max(2.0, width() - box.width() - 2)));
      if (box.top() < 2) box.moveTop(at.y() + 10);
      painter.setPen(theme::kBorder);
      painter.setBrush(QColor(60, 60, 60, 240));
      painter.drawRoundedRect(box, 4, 4);
      painter.setPen(theme::kText);
      painter.drawText(box, Qt::AlignCenter, text);
    }
  }
}

void PlotWidget::paintAxes(QPainter& painter, const QRectF& area) {
  const QFontMetricsF metrics(painter.font());
  painter.setRenderHint(QPainter::Antialiasing, false);
  double lastEnd = -1e9;
  for (const auto& [value, text] : ticksOf(horizontal_, std::max(2, static_cast<int>(area.width() / 64)))) {
    const double part = along(horizontal_, value);
    if (part < -1e-6 || part > 1 + 1e-6) continue;
    const double x = area.left() + part * area.width();
    painter.setPen(QColor(52, 52, 52));
    painter.drawLine(QPointF(x, area.top()), QPointF(x, area.bottom()));
    const double wide = metrics.horizontalAdvance(text);
    if (x - wide / 2 < lastEnd + 4) continue;  // no room
    lastEnd = x + wide / 2;
    painter.setPen(theme::kTextDim);
    painter.drawText(QRectF(x - wide / 2 - 2, area.bottom() + 3, wide + 4, metrics.height()), Qt::AlignCenter,
                     text);
  }
  for (const auto& [value, text] : ticksOf(vertical_, std::max(2, static_cast<int>(area.height() / 30)))) {
    const double part = along(vertical_, value);
    if (part < -1e-6 || part > 1 + 1e-6) continue;
    const double y = area.bottom() - part * area.height();
    painter.setPen(QColor(52, 52, 52));
    painter.drawLine(QPointF(area.left(), y), QPointF(area.right(), y));
    painter.setPen(theme::kTextDim);
    painter.drawText(QRectF(0, y - metrics.height() / 2, area.left() - 5, metrics.height()),
                     Qt::AlignRight | Qt::AlignVCenter, text);
  }
  painter.setPen(theme::kBorder);
  painter.setBrush(Qt::NoBrush);
  painter.drawRect(area);
  painter.setPen(theme::kTextDim);
  painter.drawText(
      QRectF(area.left() - 40, area.bottom() + metrics.height() + 4, area.width() + 52, metrics.height()),
      Qt::AlignCenter, metrics.elidedText(horizontal_.title, Qt::ElideRight, area.width() + 48));
  painter.save();
  painter.translate(metrics.height() / 2 + 2, area.center().y());
  painter.rotate(-90);
  painter.drawText(QRectF(-height() / 2.0, -metrics.height() / 2, height(), metrics.height()),
                   Qt::AlignCenter, metrics.elidedText(vertical_.title, Qt::ElideRight, area.height() + 16));
  painter.restore();
}

void PlotWidget::paintSeries(QPainter& painter, const PlotSeries& series) {
  using Mark = PlotSeries::Mark;
  if (series.mark == Mark::Band) {
    QPolygonF outline;
    const double far = 4 * height();
    for (const QPointF& point : series.points) {
      if (!std::isfinite(point.y())) continue;
      QPointF at = place(point);
      at.setY(std::clamp(at.y(), -far, far));
      outline << at;
    }
    QColor fill = series.colour;
    fill.setAlpha(44);
    painter.setPen(Qt::NoPen);
    painter.setBrush(fill);
    painter.drawPolygon(outline);
    return;
  }
  if (series.mark == Mark::Dots || series.mark == Mark::HollowDots) {
    const bool hollow = series.mark == Mark::HollowDots;
    painter.setPen(QPen(hollow ? series.colour : QColor(20, 20, 20), hollow ? 1.5 : 0.8));
    painter.setBrush(hollow ? QBrush(theme::kSunken) : QBrush(series.colour));
    for (const QPointF& point : series.points)
      if (std::isfinite(point.y())) painter.drawEllipse(place(point), kDotRadius, kDotRadius);
    return;
  }
  QPen pen(series.colour, series.penWidth, Qt::SolidLine, Qt::FlatCap, Qt::RoundJoin);
  if (series.mark == Mark::DashedLine) pen.setDashPattern({5, 3});
  if (series.mark == Mark::DottedLine) pen.setDashPattern({1.5, 3});
  painter.setPen(pen);
  QPolygonF line;
  const double far = 4 * height();
  for (const QPointF& point : series.points) {
    if (!std::isfinite(point.y())) {
      painter.drawPolyline(line);
      line.clear();
      continue;
    }
    QPointF at = place(point);
    at.setY(std::clamp(at.y(), -far, far));
    line << at;
  }
  painter.drawPolyline(line);
}

void PlotWidget::paintLegend(QPainter& painter, const QRectF& area) {
  using Mark = PlotSeries::Mark;
  const QFontMetricsF metrics(painter.font());
  double widest = 0;
  int rows = 0;
  for (const PlotSeries& series : series_)
    if (const QString text = series.legend.value_or(series.name); !text.isEmpty()) {
      widest = std::max(widest, metrics.horizontalAdvance(text));
      ++rows;
    }
  if (rows == 0 || rows * metrics.height() + 10 > area.height() * 0.9) return;
  QRectF box(0, 0, widest + 38, rows * metrics.height() + 6);
  if (*legend_ == Qt::BottomLeftCorner)
    box.moveBottomLeft(area.bottomLeft() + QPointF(6, -6));
  else
    box.moveTopRight(area.topRight() + QPointF(-6, 6));
  painter.setPen(Qt::NoPen);
  painter.setBrush(QColor(28, 28, 28, 215));
  painter.drawRoundedRect(box, 4, 4);
  double y = box.top() + 3 + metrics.height() / 2;
  for (const PlotSeries& series : series_) {
    const QString text = series.legend.value_or(series.name);
    if (text.isEmpty()) continue;
    const double x0 = box.left() + 6, x1 = x0 + 20;
    if (series.mark == Mark::Dots || series.mark == Mark::HollowDots) {
      const bool hollow = series.mark == Mark::HollowDots;
      painter.setPen(hollow ? QPen(series.colour, 1.5) : QPen(Qt::NoPen));
      painter.setBrush(hollow ? QBrush(theme::kSunken) : QBrush(series.colour));
      painter.drawEllipse(QPointF((x0 + x1) / 2, y), kDotRadius, kDotRadius);
    } else {
      QPen pen(series.colour, series.penWidth, Qt::SolidLine, Qt::FlatCap);
      if (series.mark == Mark::DashedLine) pen.setDashPattern({5, 3});
      if (series.mark == Mark::DottedLine) pen.setDashPattern({1.5, 3});
      painter.setPen(pen);
      painter.drawLine(QPointF(x0, y), QPointF(x1, y));
    }
    painter.setPen(theme::kText);
    painter.drawText(QRectF(x1 + 6, y - metrics.height() / 2, widest + 4, metrics.height()), Qt::AlignVCenter,
                     text);
    y += metrics.height();
  }
}

std::optional<QPointF> PlotWidget::nearest(const QPointF& cursor, const PlotSeries** of) const {
  std::optional<QPointF> best;
  double bestDistance = 14;
  for (const PlotSeries& series : series_)
    for (const QPointF& point : series.points) {
      if (series.mark == PlotSeries::Mark::Band || !std::isfinite(point.y())) continue;
      const QPointF away = place(point) - cursor;
      // Dots win over the lines that run through them.
      const bool dots = series.mark == PlotSeries::Mark::Dots || series.mark == PlotSeries::Mark::HollowDots;
      const double distance = std::hypot(away.x(), away.y()) + (dots ? 0 : 5);
      if (distance < bestDistance && frame().adjusted(-4, -4, 4, 4).contains(place(point))) {
        bestDistance = distance;
        best = point;
        *of = &series;
      }
    }
  return best;
}

void PlotWidget::mouseMoveEvent(QMouseEvent* event) {
  cursor_ = event->position();
  update();
}

void PlotWidget::leaveEvent(QEvent*) {
  cursor_.reset();
  update();
}

bool PlotWidget::event(QEvent* event) {
  if (event->type() == QEvent::FontChange) update();
  return QWidget::event(event);
}

}  // namespace patina
