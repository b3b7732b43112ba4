#include "widgets/colour_bar.h"

#include "widgets/theme.h"

namespace patina {

std::vector<double> roundTicks(double low, double high, int wanted) {
  std::vector<double> ticks;
  if (!(high > low) || !std::isfinite(high - low) || wanted < 1) return ticks;
  const double raw = (high - low) / wanted;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  double step = 10 * power;
  for (const double candidate : {1.0, 2.0, 5.0})
    if (candidate * power >= raw) {
      step = candidate * power;
      break;
    }
  for (double k = std::ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; ++k)
    ticks.push_back(k * step);
  return ticks;
}

QString tickText(double value, double step) {
  if (std::abs(value) < 1e-9 * step) return QStringLiteral("0");
  const double size = std::max(std::abs(value), step);
  if (size >= 1e5 || size < 1e-4) return QString::number(value, 'g', 3);
  const int decimals = std::clamp(static_cast<int>(-std::floor(std::log10(step) + 1e-9)), 0, 6);
  return QString::number(value, 'f', decimals);
}

ColourBar::ColourBar(QWidget* parent) : QWidget(parent) {
  setSizePolicy(QSizePolicy::Fixed, QSizePolicy::Expanding);
  setAccessibleName(tr("Colour bar"));
}

QSize ColourBar::sizeHint() const {
  const QFontMetrics metrics(theme::captionFont());
  if (style_ == ToneStyle::Status)
    return {metrics.horizontalAdvance(QStringLiteral("mirror point off screen")) + 40, 220};
  const int unit = metrics.horizontalAdvance(unit_) + 12;
  return {std::max(unit, 18 + 10 + metrics.horizontalAdvance(QStringLiteral("-0.0000")) + 12), 220};
}

QSize ColourBar::minimumSizeHint() const {
  return {sizeHint().width(), 80};
}

void ColourBar::setScale(ToneStyle style, const ToneSettings& tone, const QString& unit) {
  const QSize before = sizeHint();
  style_ = style;
  tone_ = tone;
  unit_ = unit;
  if (sizeHint() != before) updateGeometry();
  update();
}

void ColourBar::setStatusCounts(const std::array<std::size_t, kStatusCount>& counts) {
  counts_ = counts;
  update();
}

void ColourBar::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.setRenderHint(QPainter::Antialiasing);
  painter.setFont(theme::captionFont());
  if (style_ == ToneStyle::Normal)
    paintNormals(painter);
  else if (style_ == ToneStyle::Status)
    paintLegend(painter);
  else
    paintRamp(painter);
}

void ColourBar::paintRamp(QPainter& painter) {
  const QFontMetrics metrics = painter.fontMetrics();
  painter.setPen(theme::kTextDim);
  painter.drawText(QRect(6, 6, width() - 8, metrics.height()), Qt::AlignLeft, unit_);
  const QRect bar(6, 6 + metrics.height() * 2, 18, height() - 12 - metrics.height() * 3);
  if (bar.height() < 20) return;
  const ToneMapper mapper(style_, tone_);
  for (int y = 0; y < bar.height(); ++y) {
    painter.fillRect(bar.left(), bar.top() + y, bar.width(), 1,
                     QColor(mapper.atFraction(1.0 - (y + 0.5) / bar.height())));
  }
  painter.setPen(theme::kBorder);
  painter.setBrush(Qt::NoBrush);
  painter.drawRect(QRectF(bar).adjusted(-0.5, -0.5, 0.5, 0.5));
  // With an exposure, the ramp's ends are reached by values that are as many stops away.
  const double gain = style_ == ToneStyle::LinearRgb ? std::exp2(tone_.exposureEv) : 1.0;
  const double low = tone_.low / gain, high = tone_.high / gain;
  const auto ticks = roundTicks(low, high, std::clamp(bar.height() / 44, 2, 8));
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : high - low;
  painter.setPen(theme::kText);
  for (const double tick : ticks) {
    const double y = bar.bottom() + 1 - (tick - low) / (high - low) * bar.height();
    painter.drawLine(QPointF(bar.right() + 2, y), QPointF(bar.right() + 6, y));
    painter.drawText(
        QRectF(bar.right() + 9, y - metrics.height() / 2.0, width() - bar.right() - 9, metrics.height()),
        Qt::AlignLeft | Qt::AlignVCenter, tickText(tick, step));
  }
}

void ColourBar::paintNormals(QPainter& painter) {
  const QFontMetrics metrics = painter.fontMetrics();
  const int side = std::min(width() - 16, height() - 4 * metrics.height());
  if (side < 24) return;
  const QRect square(6, 6 + 2 * metrics.height(), side, side);
  const ToneMapper mapper(style_, tone_);
  QImage disc(side, side, QImage::Format_ARGB32_Premultiplied);
  disc.fill(Qt::transparent);
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      const double u = 2 * (x + 0.5) / side - 1, v = 1 - 2 * (y + 0.5) / side;
      if (u * u + v * v > 1) continue;
      const std::array<float, 3> normal{static_cast<float>(u * tone_.high),
                                        static_cast<float>(v * tone_.high), 1.0f};
      disc.setPixel(x, y, mapper(normal) | 0xff000000u);
    }
  painter.drawImage(square.topLeft(), disc);
  painter.setPen(theme::kTextDim);
  painter.drawText(QRect(6, 6, width() - 8, metrics.height()), Qt::AlignLeft, tr("leans to"));
  painter.setPen(theme::kText);
  painter.drawText(QRect(square.left(), square.bottom() + 4, side, metrics.height()), Qt::AlignHCenter,
                   QStringLiteral("±%1").arg(tickText(tone_.high, 0.001)));
  painter.setPen(QColor(0, 0, 0, 150));
  const QPoint middle = square.center();
  painter.drawLine(middle.x() - 4, middle.y(), middle.x() + 4, middle.y());
  painter.drawLine(middle.x(), middle.y() - 4, middle.x(), middle.y() + 4);
  painter.setPen(theme::kTextDim);
  painter.drawText(QRect(square.left(), square.bottom() + 6 + metrics.height(), side, metrics.height() * 2),
                   Qt::AlignHCenter | Qt::TextWordWrap, tr("x right\ny up"));
}

void ColourBar::paintLegend(QPainter& painter) {
  const QFontMetrics metrics = painter.fontMetrics();
  const int row = metrics.height() * 2 + 8;
  int y = 6;
  for (int status = 0; status < kStatusCount && y + row < height() + 8; ++status, y += row) {
    const bool present = counts_[status] > 0;
    painter.setPen(Qt::NoPen);
    painter.setBrush(QColor(statusColour(status)));
    painter.setOpacity(present ? 1.0 : 0.35);
    painter.drawRoundedRect(QRectF(6, y + 3, 14, 14), 3, 3);
    painter.setOpacity(1.0);
    painter.setPen(present ? theme::kText : theme::kTextOff);
    painter.drawText(QRect(28, y, width() - 30, metrics.height()), Qt::AlignLeft, statusName(status));
    painter.setPen(present ? theme::kTextDim : theme::kTextOff);
    painter.drawText(QRect(28, y + metrics.height(), width() - 30, metrics.height()), Qt::AlignLeft,
                     present ? tr("%L1 texels").arg(counts_[status]) : tr("none"));
  }
}

}  // namespace patina
