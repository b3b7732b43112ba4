#pragma once

#include <QPolygonF>
#include <QWidget>
#include <memory>
#include <optional>
#include <vector>

#include "widgets/focus_ring.h"
#include "widgets/picture_renderer.h"
#include "widgets/tone.h"

namespace patina {

/// Shows one float picture: zoom at the cursor (wheel), pan (drag), value under the cursor. Only what is
/// visible is turned into colours, so that large pictures cost what the screen costs. Pixels are squares from
/// a zoom of two on; below, averaged levels are interpolated.
///
/// Picture coordinates: pixel (i, j) covers [i, i+1) x [j, j+1).
class ImageView : public QWidget {
  Q_OBJECT

 public:
  explicit ImageView(QWidget* parent = nullptr);

  /// Shows a picture; null shows `emptyText`. The view (zoom, place) is kept where the size is the same.
  void setPicture(std::shared_ptr<const Image> image, ToneStyle style);
  void setTone(const ToneSettings& tone);
  void setEmptyText(const QString& text);
  /// The texel that the inspector shows, in picture pixels; drawn as an outlined square or, on photographs, a
  /// ring.
  void setMarker(std::optional<QPointF> place, bool asRing = false);
  /// Pixels to hatch because they hold no measurement: those whose value here is one of `states` (bit i:
  /// value i). Same size as the picture.
  void setMask(std::shared_ptr<const Image> status, unsigned states);
  /// Drawn over the picture, in picture coordinates: the sample's outline on a photograph.
  void setOutline(const QPolygonF& outline);

  const Image* picture() const { return image_.get(); }
  double zoom() const { return zoom_; }  ///< device-independent pixels a picture pixel
  void zoomToFit();
  void zoomTo(double zoom);
  void zoomBy(double factor, const QPointF& anchor);
  QPointF widgetFromPicture(const QPointF& place) const { return place * zoom_ + offset_; }
  QPointF pictureFromWidget(const QPointF& place) const { return (place - offset_) / zoom_; }

  QSize sizeHint() const override { return {480, 480}; }
  QSize minimumSizeHint() const override { return {160, 140}; }

 Q_SIGNALS:
  /// The pixel under the cursor; none when the cursor leaves the picture.
  void hovered(std::optional<QPoint> pixel);
  /// A click (not the end of a drag), continuous picture coordinates.
  void clicked(QPointF place);
  /// Arrow keys: move the marker by whole pixels.
  void stepRequested(QPoint step);
  void zoomChanged(double zoom);

 protected:
  void paintEvent(QPaintEvent* event) override;
  void resizeEvent(QResizeEvent* event) override;
  void wheelEvent(QWheelEvent* event) override;
  void mousePressEvent(QMouseEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;
  void mouseReleaseEvent(QMouseEvent* event) override;
  void leaveEvent(QEvent* event) override;
  void focusInEvent(QFocusEvent* event) override;
  void focusOutEvent(QFocusEvent* event) override;
  void keyPressEvent(QKeyEvent* event) override;

 private:
  void render();
  void setView(double zoom, const QPointF& offset);
  void reportHover(const QPointF& position);
  bool masked(double x, double y) const;

  std::shared_ptr<const Image> image_;
  PictureRenderer renderer_;
  ToneStyle style_ = ToneStyle::LinearRgb;
  ToneSettings tone_;
  QString emptyText_;
  std::optional<QPointF> marker_;
  bool markerIsRing_ = false;
  QPolygonF outline_;
  std::shared_ptr<const Image> mask_;
  unsigned maskedStates_ = 0;
  FocusRing focusRing_;

  QImage rendered_;
  bool stale_ = true;
  double zoom_ = 1;
  QPointF offset_;
  bool fitted_ = true;  ///< the picture follows the widget's size until the person zooms
  std::optional<QPoint> hover_;
  QPointF pressed_, dragged_;
  bool dragging_ = false;
};

}  // namespace patina
