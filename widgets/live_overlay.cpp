#include "widgets/live_overlay.h"

#include <numbers>

#include "widgets/theme.h"

namespace patina::live_overlay {

namespace {

QPointF placeOf(const QTransform& transform, const Eigen::Vector2d& pixel) {
  return transform.map(QPointF(pixel.x() + 0.5, pixel.y() + 0.5));  // pixel (i, j) covers [i, i+1) x [j, j+1)
}

}  // namespace

void drawBoard(QPainter& painter, const QTransform& transform, const Board& board,
               const BoardDetection& found, double share) {
  const std::vector<BoardCorner>& corners = found.view.corners;
  painter.setBrush(Qt::NoBrush);
  painter.setPen(QPen(QColor(226, 168, 72, 150), 3, Qt::SolidLine, Qt::RoundCap));
  for (const Eigen::Vector2d& pixel : found.loose) painter.drawPoint(placeOf(transform, pixel));
  const QColor colour = !found.found ? theme::kWarning : found.view.mirrored ? theme::kAccent : theme::kGood;
  QPointF middle;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const QPointF at = placeOf(transform, corners[i].pixel);
    middle += at / static_cast<double>(corners.size());
    const int row = corners[i].id / board.cornersX();
    if (i > 0 && corners[i - 1].id == corners[i].id - 1 && corners[i - 1].id / board.cornersX() == row) {
      painter.setPen(QPen(
          row == 0 ? QColor(255, 255, 255, 220) : QColor(colour.red(), colour.green(), colour.blue(), 130),
          row == 0 ? 2 : 1.2));
      painter.drawLine(placeOf(transform, corners[i - 1].pixel), at);
    }
  }
  for (const auto& [pen, width] : {std::pair(QColor(0, 0, 0, 150), 3.2), std::pair(colour, 1.6)}) {
    painter.setPen(QPen(pen, width));
    for (const BoardCorner& corner : corners) painter.drawEllipse(placeOf(transform, corner.pixel), 3.5, 3.5);
  }
  if (!(share > 0) || corners.empty()) return;
  constexpr double kRadius = 18;
  const QRectF ring(middle.x() - kRadius, middle.y() - kRadius, 2 * kRadius, 2 * kRadius);
  painter.setPen(QPen(QColor(0, 0, 0, 160), 7));
  painter.drawEllipse(ring);
  painter.setPen(QPen(theme::kText, 4, Qt::SolidLine, Qt::FlatCap));
  painter.drawArc(ring, 90 * 16, static_cast<int>(-360 * 16 * share));
}

void drawGhost(QPainter& painter, const QTransform& transform, const QPolygonF& outline) {
  const QPolygonF placed = transform.map(outline);
  painter.setBrush(Qt::NoBrush);
  painter.setPen(QPen(QColor(0, 0, 0, 140), 4));
  painter.drawPolygon(placed);
  painter.setPen(QPen(QColor(255, 255, 255, 230), 1.8, Qt::DashLine));
  painter.drawPolygon(placed);
}

void drawSentence(QPainter& painter, const QRectF& within, const QString& text, bool good) {
  if (text.isEmpty()) return;
  QFont font = painter.font();
  font.setPointSizeF(font.pointSizeF() * 1.25);
  font.setWeight(QFont::DemiBold);
  painter.setFont(font);
  const QRectF room = within.adjusted(18, 12, -18, -12);
  const QRectF needed =
      painter.boundingRect(room, static_cast<int>(Qt::AlignHCenter | Qt::AlignTop) | Qt::TextWordWrap, text);
  painter.setPen(Qt::NoPen);
  painter.setBrush(QColor(20, 20, 20, 205));
  painter.drawRoundedRect(needed.adjusted(-12, -6, 12, 6), 6, 6);
  painter.setPen(good ? theme::kGood : theme::kText);
  painter.drawText(room, static_cast<int>(Qt::AlignHCenter | Qt::AlignTop) | Qt::TextWordWrap, text);
}

void drawArrow(QPainter& painter, const QRectF& within, double right, double up) {
  const double length = std::hypot(right, up);
  if (!(length > 0)) return;
  const double shrink = std::min(1.0, 1 / length);
  const double reach = 0.4 * std::min(within.width(), within.height());
  const QPointF from = within.center();
  const QPointF to = from + reach * shrink * QPointF(right, -up);
  const QPointF along = (to - from) / std::max(1.0, std::hypot(to.x() - from.x(), to.y() - from.y()));
  const QPointF across(-along.y(), along.x());
  for (const auto& [colour, width] : {std::pair(QColor(0, 0, 0, 170), 9.0), std::pair(theme::kAccent, 5.0)}) {
    painter.setPen(QPen(colour, width, Qt::SolidLine, Qt::RoundCap, Qt::RoundJoin));
    painter.drawLine(from, to);
    painter.drawPolyline(QPolygonF{to - 16 * along + 11 * across, to, to - 16 * along - 11 * across});
  }
}

}  // namespace patina::live_overlay
