#include "widgets/image_view.h"

#include <QKeyEvent>
#include <QWheelEvent>

#include "widgets/theme.h"

namespace patina {

namespace {
constexpr double kLargestZoom = 256, kSmallestZoom = 1.0 / 64;
constexpr double kGridFromZoom = 24;  ///< from here single pixels are outlined
constexpr int kMargin = 14;
}  // namespace

ImageView::ImageView(QWidget* parent) : QWidget(parent) {
  setMouseTracking(true);
  setFocusPolicy(Qt::StrongFocus);
  setCursor(Qt::CrossCursor);
  setAccessibleName(tr("Picture"));
}

void ImageView::setPicture(std::shared_ptr<const Image> image, ToneStyle style) {
  const bool sameSize =
      image && image_ && image->width() == image_->width() && image->height() == image_->height();
  image_ = std::move(image);
  style_ = style;
  renderer_.setPicture(image_);
  stale_ = true;
  if (!sameSize) zoomToFit();
  if (!image_ && hover_) {
    hover_.reset();
    Q_EMIT hovered(hover_);
  }
  update();
}

void ImageView::setTone(const ToneSettings& tone) {
  if (tone == tone_) return;
  tone_ = tone;
  stale_ = true;
  update();
}

void ImageView::setEmptyText(const QString& text) {
  emptyText_ = text;
  update();
}

void ImageView::setMarker(std::optional<QPointF> place, bool asRing) {
  marker_ = place;
  markerIsRing_ = asRing;
  update();
}

void ImageView::setMask(std::shared_ptr<const Image> status, unsigned states) {
  mask_ = std::move(status);
  maskedStates_ = states;
  stale_ = true;
  update();
}

bool ImageView::masked(double x, double y) const {
  if (!mask_ || mask_->width() != image_->width() || mask_->height() != image_->height()) return false;
  const int column = std::clamp(static_cast<int>(x), 0, mask_->width() - 1);
  const int row = std::clamp(static_cast<int>(y), 0, mask_->height() - 1);
  const int state = static_cast<int>(mask_->at(column, row));
  return state >= 0 && state < 32 && (maskedStates_ >> state & 1u);
}

void ImageView::focusInEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  update();
}

void ImageView::focusOutEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  update();
}

void ImageView::setOutline(const QPolygonF& outline) {
  outline_ = outline;
  update();
}

void ImageView::setView(double zoom, const QPointF& offset) {
  zoom_ = std::clamp(zoom, kSmallestZoom, kLargestZoom);
  offset_ = offset;
  if (image_) {  // a strip of the picture always stays in sight
    const double keep = 40;
    offset_.setX(std::clamp(offset_.x(), keep - image_->width() * zoom_, width() - keep));
    offset_.setY(std::clamp(offset_.y(), keep - image_->height() * zoom_, height() - keep));
  }
  stale_ = true;
  update();
  Q_EMIT zoomChanged(zoom_);
}

void ImageView::zoomToFit() {
  fitted_ = true;
  if (!image_ || image_->empty()) return;
  const double zoom =
      std::min((width() - 2.0 * kMargin) / image_->width(), (height() - 2.0 * kMargin) / image_->height());
  const double kept = std::clamp(zoom, kSmallestZoom, kLargestZoom);
  setView(kept, QPointF(width() - image_->width() * kept, height() - image_->height() * kept) / 2);
}

void ImageView::zoomTo(double zoom) {
  zoomBy(zoom / zoom_, QPointF(width(), height()) / 2);
}

void ImageView::zoomBy(double factor, const QPointF& anchor) {
  const double zoom = std::clamp(zoom_ * factor, kSmallestZoom, kLargestZoom);
  const QPointF place = pictureFromWidget(anchor);
  fitted_ = false;
  setView(zoom, anchor - place * zoom);
}

void ImageView::render() {
  stale_ = false;
  const double ratio = devicePixelRatioF();
  const QSize size(std::max(1, static_cast<int>(std::ceil(width() * ratio))),
                   std::max(1, static_cast<int>(std::ceil(height() * ratio))));
  if (rendered_.size() != size) rendered_ = QImage(size, QImage::Format_RGB32);
  rendered_.setDevicePixelRatio(ratio);
  rendered_.fill(theme::kCanvas);
  if (!image_ || image_->empty()) return;

  const double scale = zoom_ * ratio;  // device pixels a picture pixel
  const QPointF origin = offset_ * ratio;
  renderer_.draw(rendered_, rendered_.rect(), origin, scale, style_, tone_);
  if (!mask_ || maskedStates_ == 0) return;
  const int left = std::max(0, static_cast<int>(std::ceil(origin.x() - 0.5)));
  const int right =
      std::min(size.width(), static_cast<int>(std::ceil(origin.x() + image_->width() * scale - 0.5)));
  const int top = std::max(0, static_cast<int>(std::ceil(origin.y() - 0.5)));
  const int bottom =
      std::min(size.height(), static_cast<int>(std::ceil(origin.y() + image_->height() * scale - 0.5)));
  // Diagonal hatching in device pixels: plainly not a value of any ramp.
  for (int py = top; py < bottom; ++py) {
    auto* line = reinterpret_cast<QRgb*>(rendered_.scanLine(py));
    const double y = (py + 0.5 - origin.y()) / scale;
    for (int px = left; px < right; ++px)
      if (masked((px + 0.5 - origin.x()) / scale, y))
        line[px] = (px + py) % 8 < 2 ? qRgb(104, 104, 104) : qRgb(66, 66, 66);
  }
}

void ImageView::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  if (stale_ || rendered_.devicePixelRatio() != devicePixelRatioF()) render();
  painter.drawImage(0, 0, rendered_);
  if (!image_) {
    painter.setPen(theme::kTextDim);
    painter.drawText(rect().adjusted(20, 20, -20, -20), Qt::AlignCenter | Qt::TextWordWrap, emptyText_);
    focusRing_.paint(painter, *this);
    return;
  }
  painter.setRenderHint(QPainter::Antialiasing);
  if (!outline_.isEmpty()) {
    QPolygonF onScreen;
    for (const QPointF& corner : outline_) onScreen << widgetFromPicture(corner);
    painter.setPen(QPen(QColor(0, 0, 0, 120), 3));
    painter.drawPolygon(onScreen);
    painter.setPen(QPen(QColor(255, 255, 255, 190), 1, Qt::DashLine));
    painter.drawPolygon(onScreen);
  }
  painter.setRenderHint(QPainter::Antialiasing, false);
  if (hover_ && zoom_ >= kGridFromZoom) {
    const QPointF corner = widgetFromPicture(*hover_);
    painter.setPen(QPen(QColor(255, 255, 255, 110), 1));
    painter.drawRect(QRectF(corner, QSizeF(zoom_, zoom_)));
  }
  if (marker_) {
    painter.setRenderHint(QPainter::Antialiasing);
    const QPointF middle = widgetFromPicture(*marker_ + QPointF(0.5, 0.5));
    const double half = std::max(5.0, zoom_ / 2 + 1);
    for (const auto& [colour, penWidth] :
         {std::pair(QColor(0, 0, 0, 200), 3.5), std::pair(QColor(255, 255, 255), 1.5)}) {
      painter.setPen(QPen(colour, penWidth));
      if (markerIsRing_)
        painter.drawEllipse(middle, 7.0, 7.0);
      else
        painter.drawRect(QRectF(middle.x() - half, middle.y() - half, 2 * half, 2 * half));
      const double reach = (markerIsRing_ ? 7.0 : half);
      for (const QPointF& way : {QPointF(1, 0), QPointF(-1, 0), QPointF(0, 1), QPointF(0, -1)})
        painter.drawLine(middle + way * (reach + 2), middle + way * (reach + 8));
    }
  }
  focusRing_.paint(painter, *this);
}

void ImageView::resizeEvent(QResizeEvent* event) {
  stale_ = true;
  if (fitted_)
    zoomToFit();
  else if (event->oldSize().isValid())
    setView(zoom_,
            offset_ + QPointF(width() - event->oldSize().width(), height() - event->oldSize().height()) / 2);
}

void ImageView::wheelEvent(QWheelEvent* event) {
  if (!image_) return;
  const double notches = event->angleDelta().y() / 120.0;
  zoomBy(std::pow(1.25, notches), event->position());
  reportHover(event->position());
  event->accept();
}

void ImageView::mousePressEvent(QMouseEvent* event) {
  pressed_ = dragged_ = event->position();
  dragging_ = false;
}

void ImageView::mouseMoveEvent(QMouseEvent* event) {
  if (event->buttons() & (Qt::LeftButton | Qt::MiddleButton | Qt::RightButton)) {
    if (!dragging_ && (event->position() - pressed_).manhattanLength() > 4) {
      dragging_ = true;
      setCursor(Qt::ClosedHandCursor);
    }
    if (dragging_ && image_) {
      fitted_ = false;
      setView(zoom_, offset_ + event->position() - dragged_);
      dragged_ = event->position();
    }
  }
  reportHover(event->position());
}

void ImageView::mouseReleaseEvent(QMouseEvent* event) {
  if (dragging_) {
    dragging_ = false;
    setCursor(Qt::CrossCursor);
    return;
  }
  if (event->button() != Qt::LeftButton || !image_) return;
  const QPointF place = pictureFromWidget(event->position());
  if (QRectF(0, 0, image_->width(), image_->height()).contains(place)) Q_EMIT clicked(place);
}

void ImageView::reportHover(const QPointF& position) {
  std::optional<QPoint> pixel;
  if (image_) {
    const QPointF place = pictureFromWidget(position);
    const QPoint candidate(static_cast<int>(std::floor(place.x())), static_cast<int>(std::floor(place.y())));
    if (QRect(0, 0, image_->width(), image_->height()).contains(candidate)) pixel = candidate;
  }
  if (pixel == hover_) return;
  hover_ = pixel;
  if (zoom_ >= kGridFromZoom) update();
  Q_EMIT hovered(hover_);
}

void ImageView::leaveEvent(QEvent*) {
  if (!hover_) return;
  hover_.reset();
  update();
  Q_EMIT hovered(hover_);
}

void ImageView::keyPressEvent(QKeyEvent* event) {
  const QPointF middle(width() / 2.0, height() / 2.0);
  switch (event->key()) {
    case Qt::Key_Left:
      Q_EMIT stepRequested({-1, 0});
      break;
    case Qt::Key_Right:
      Q_EMIT stepRequested({1, 0});
      break;
    case Qt::Key_Up:
      Q_EMIT stepRequested({0, -1});
      break;
    case Qt::Key_Down:
      Q_EMIT stepRequested({0, 1});
      break;
    case Qt::Key_Plus:
    case Qt::Key_Equal:
      zoomBy(1.25, middle);
      break;
    case Qt::Key_Minus:
      zoomBy(0.8, middle);
      break;
    case Qt::Key_0:
      zoomToFit();
      break;
    case Qt::Key_1:
      zoomTo(1 / devicePixelRatioF());
      break;
    default:
      QWidget::keyPressEvent(event);
  }
}

}  // namespace patina
