#pragma once

#include <QPainter>
#include <QPolygonF>
#include <QTransform>

#include "engine/calibration/board_detection.h"

namespace patina {

/// What is drawn over a live picture. All take picture coordinates through the view's transform; widths and
/// text are in widget pixels, so that they are the same at every zoom.
namespace live_overlay {

/// Corners as rings joined row by row, the first row bright, mirrored ones in another colour; loose corners
/// as faint dots. `share`: how long it has stood still, drawn as a closing ring at the board's middle; 0:
/// none.
void drawBoard(QPainter& painter, const QTransform& widgetFromPicture, const Board& board,
               const BoardDetection& found, double share = 0);
/// A dashed outline: where something should go.
void drawGhost(QPainter& painter, const QTransform& widgetFromPicture, const QPolygonF& outline);
/// Text on a dark plate at the top of the picture.
void drawSentence(QPainter& painter, const QRectF& within, const QString& text, bool good);
/// Where something should move: an arrow from the middle of `within`; `right` and `up` in shares of its
/// smaller half, at most 1 long.
void drawArrow(QPainter& painter, const QRectF& within, double right, double up);

}  // namespace live_overlay
}  // namespace patina
