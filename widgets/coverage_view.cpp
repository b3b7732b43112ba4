#include "widgets/coverage_view.h"

#include "widgets/theme.h"

namespace patina {

namespace {

constexpr int kColumns = CalibrationCoverage::kColumns, kRows = CalibrationCoverage::kRows;
constexpr double kWidth = 0.45;  ///< of the picture that the outlined board is wide
constexpr double kLean = 0.3;    ///< by how much the farther side of a tilted one is shorter

/// Outlines of the five tilts: flat, then right, top, left, bottom nearer.
QPolygonF tilted(const QRectF& box, int tilt) {
  const double dx = 0.5 * kLean * box.width(), dy = 0.5 * kLean * box.height();
  QPointF topLeft = box.topLeft(), topRight = box.topRight(), bottomRight = box.bottomRight(),
          bottomLeft = box.bottomLeft();
  // The farther side is shorter, and the board seen at a slant is narrower.
  if (tilt == 1) topLeft += QPointF(dx, dy), bottomLeft += QPointF(dx, -dy);
  if (tilt == 2) bottomLeft += QPointF(dx, -dy), bottomRight += QPointF(-dx, -dy);
  if (tilt == 3) topRight += QPointF(-dx, dy), bottomRight += QPointF(-dx, -dy);
  if (tilt == 4) topLeft += QPointF(dx, dy), topRight += QPointF(-dx, dy);
  return {topLeft, topRight, bottomRight, bottomLeft};
}

int missingTilt(const CalibrationCoverage& coverage) {
  return static_cast<int>(std::ranges::min_element(coverage.tilts) - coverage.tilts.begin());
}

}  // namespace

QPolygonF nextViewOutline(const CalibrationCoverage& coverage, const Board& board, int width, int height) {
  if (coverage.advice.empty()) return {};
  // The board's own size in cells; its best place is where the fewest corners are.
  const double across = std::min(kWidth, 0.8 * height * board.widthMm() / board.heightMm() / width);
  const double down = across * width * board.heightMm() / board.widthMm() / height;
  const int columns = std::clamp(static_cast<int>(std::lround(across * kColumns)), 1, kColumns);
  const int rows = std::clamp(static_cast<int>(std::lround(down * kRows)), 1, kRows);
  int bestColumn = 0, bestRow = 0, most = -1;
  for (int row = 0; row + rows <= kRows; ++row)
    for (int column = 0; column + columns <= kColumns; ++column) {
      int empty = 0;
      for (int y = row; y < row + rows; ++y)
        for (int x = column; x < column + columns; ++x)
          empty += coverage.corners[static_cast<std::size_t>(y * kColumns + x)] == 0 ? 2 : 0;
      // All alike: rather in the middle.
      if (2 * column + columns == kColumns && 2 * row + rows == kRows) ++empty;
      if (empty > most) most = empty, bestColumn = column, bestRow = row;
    }
  const QRectF box(
      width * static_cast<double>(bestColumn) / kColumns, height * static_cast<double>(bestRow) / kRows,
      width * static_cast<double>(columns) / kColumns, height * static_cast<double>(rows) / kRows);
  return tilted(box, missingTilt(coverage));
}

CoverageView::CoverageView(QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("coverageView"));
  setAccessibleName(tr("Where the board has been seen, and how it was tilted"));
  setToolTip(
      tr("Left: where corners were seen. Right: how often the board was held flat, and with its right, "
         "upper, left or lower side nearer to the camera."));
}

void CoverageView::setCoverage(const CalibrationCoverage& coverage, std::vector<Eigen::Vector2d> corners,
                               int width, int height) {
  coverage_ = coverage;
  corners_ = std::move(corners);
  if (width > 0 && height > 0) width_ = width, height_ = height;
  update();
}

void CoverageView::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.setRenderHint(QPainter::Antialiasing);
  const double tiltSide = std::min(height() * 1.0, width() * 0.42);
  const QRectF room(0.5, 0.5, width() - tiltSide - 14, height() - 1.0);
  const double zoom = std::min(room.width() / width_, room.height() / height_);
  const QRectF picture(room.left(), room.top() + 0.5 * (room.height() - zoom * height_), zoom * width_,
                       zoom * height_);
  painter.setPen(Qt::NoPen);
  const double cellWidth = picture.width() / kColumns, cellHeight = picture.height() / kRows;
  for (int row = 0; row < kRows; ++row)
    for (int column = 0; column < kColumns; ++column) {
      const int count = coverage_.corners[static_cast<std::size_t>(row * kColumns + column)];
      constexpr double kEnough = 12;  // corners after which a cell is as green as it gets
      const double share = std::min(1.0, count / kEnough);
      QColor colour = theme::kGood;
      colour.setAlphaF(count == 0 ? 0 : 0.2 + 0.45 * share);
      painter.fillRect(QRectF(picture.left() + column * cellWidth, picture.top() + row * cellHeight,
                              cellWidth, cellHeight),
                       theme::kSunken);
      painter.fillRect(
          QRectF(picture.left() + column * cellWidth, picture.top() + row * cellHeight, cellWidth, cellHeight)
              .adjusted(0.5, 0.5, -0.5, -0.5),
          colour);
    }
  painter.setPen(QPen(QColor(255, 255, 255, 150), 1.6, Qt::SolidLine, Qt::RoundCap));
  for (const Eigen::Vector2d& corner : corners_)
    painter.drawPoint(picture.topLeft() + zoom * QPointF(corner.x() + 0.5, corner.y() + 0.5));
  painter.setPen(QPen(theme::kBorder, 1));
  painter.setBrush(Qt::NoBrush);
  painter.drawRect(picture);

  // Tilts as a cross of five little boards.
  const QPointF middle(width() - 0.5 * tiltSide, 0.5 * height());
  const double step = tiltSide * 0.33;
  constexpr std::array<std::array<int, 2>, 5> kPlace = {{{0, 0}, {1, 0}, {0, -1}, {-1, 0}, {0, 1}}};
  painter.setFont(theme::captionFont());
  for (std::size_t i = 0; i < kPlace.size(); ++i) {
    const QPointF at = middle + step * QPointF(kPlace[i][0], kPlace[i][1]);
    const QRectF box(at.x() - 0.4 * step, at.y() - 0.3 * step, 0.8 * step, 0.6 * step);
    const bool any = coverage_.tilts[i] > 0;
    painter.setPen(QPen(any ? theme::kGood : theme::kTextOff, 1.4, any ? Qt::SolidLine : Qt::DashLine));
    QColor fill = theme::kGood;
    fill.setAlphaF(any ? 0.25 : 0);
    painter.setBrush(fill);
    painter.drawPolygon(tilted(box, static_cast<int>(i)));
    painter.setPen(any ? theme::kText : theme::kTextOff);
    painter.drawText(box, Qt::AlignCenter, QString::number(coverage_.tilts[i]));
  }
}

}  // namespace patina
