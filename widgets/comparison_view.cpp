#include "widgets/comparison_view.h"

#include <QKeyEvent>
#include <QWheelEvent>
#include <limits>

#include "widgets/theme.h"

namespace patina {

namespace {
constexpr double kLargestZoom = 256, kSmallestZoom = 1.0 / 64;
constexpr int kMargin = 14;
constexpr double kGrabPx = 9;  ///< to either side of the divider
constexpr double kDividerStep = 0.02;
constexpr int kGap = 6;  ///< between two pictures
}  // namespace

ComparisonView::ComparisonView(QWidget* parent) : QWidget(parent) {
  firstName_ = tr("photograph");
  secondName_ = tr("reconstruction");
  setObjectName(QStringLiteral("comparisonView"));
  setMouseTracking(true);
  setFocusPolicy(Qt::StrongFocus);
  setCursor(Qt::CrossCursor);
  setAccessibleName(tr("Photograph against reconstruction"));
}

void ComparisonView::setPictures(std::shared_ptr<const Image> captured,
                                 std::shared_ptr<const Image> rendered) {
  const Image* before = captured_.picture();
  const bool sameSize =
      captured && before && captured->width() == before->width() && captured->height() == before->height();
  const bool paired = rendered_.picture() != nullptr;
  captured_.setPicture(std::move(captured));
  rendered_.setPicture(std::move(rendered));
  stale_ = true;
  if (!sameSize || (fitted_ && paired != (rendered_.picture() != nullptr))) zoomToFit();
  if (!captured_.picture() && hover_) {
    hover_.reset();
    Q_EMIT hovered(hover_);
  }
  update();
}

void ComparisonView::setNames(const QString& first, const QString& second) {
  firstName_ = first;
  secondName_ = second;
  update();
}

void ComparisonView::setEmptyText(const QString& text) {
  emptyText_ = text;
  update();
}

void ComparisonView::setMode(ComparisonMode mode) {
  if (mode == mode_) return;
  const QSizeF before = paneSize();
  mode_ = mode;
  const QSizeF after = paneSize();
  if (fitted_)
    zoomToFit();
  else  // what was in the middle stays there
    setView(zoom_, offset_ + QPointF(after.width() - before.width(), after.height() - before.height()) / 2);
  stale_ = true;
  update();
}

void ComparisonView::setTone(const ToneSettings& tone) {
  if (tone == tone_) return;
  tone_ = tone;
  stale_ = true;
  update();
}

void ComparisonView::setDifferenceRange(double range) {
  if (range == differenceRange_ || !(range > 0)) return;
  differenceRange_ = range;
  stale_ = true;
  update();
}

void ComparisonView::setDarkFloor(float floor) {
  darkFloor_ = std::max(floor, 1e-12f);
  stale_ = true;
  update();
}

void ComparisonView::setDivider(double fraction) {
  fraction = std::clamp(fraction, 0.0, 1.0);
  if (fraction == divider_) return;
  divider_ = fraction;
  stale_ = true;
  update();
  Q_EMIT dividerMoved(divider_);
}

QSizeF ComparisonView::paneSize() const {
  if (shownMode() != ComparisonMode::SideBySide) return size();
  return stacked() ? QSizeF(width(), (height() - kGap) / 2.0) : QSizeF((width() - kGap) / 2.0, height());
}

QPointF ComparisonView::secondPane() const {
  const QSizeF pane = paneSize();
  return stacked() ? QPointF(0, pane.height() + kGap) : QPointF(pane.width() + kGap, 0);
}

QPointF ComparisonView::pictureFromWidget(const QPointF& position) const {
  QPointF inPane = position;
  if (shownMode() == ComparisonMode::SideBySide) {
    const QPointF second = secondPane();
    if (stacked() ? position.y() >= second.y() : position.x() >= second.x()) inPane -= second;
  }
  return (inPane - offset_) / zoom_;
}

void ComparisonView::setView(double zoom, const QPointF& offset) {
  zoom_ = std::clamp(zoom, kSmallestZoom, kLargestZoom);
  offset_ = offset;
  if (const Image* image = captured_.picture()) {  // a strip of the picture always stays in sight
    const double keep = 40;
    const QSizeF pane = paneSize();
    offset_.setX(std::clamp(offset_.x(), std::min(0.0, keep - image->width() * zoom_),
                            std::max(0.0, pane.width() - keep)));
    offset_.setY(std::clamp(offset_.y(), std::min(0.0, keep - image->height() * zoom_),
                            std::max(0.0, pane.height() - keep)));
  }
  stale_ = true;
  update();
  Q_EMIT zoomChanged(zoom_);
}

void ComparisonView::zoomToFit() {
  fitted_ = true;
  const Image* image = captured_.picture();
  if (!image || image->empty()) return;
  const QSizeF pane = paneSize();
  const double zoom = std::clamp(std::min((pane.width() - 2.0 * kMargin) / image->width(),
                                          (pane.height() - 2.0 * kMargin) / image->height()),
                                 kSmallestZoom, kLargestZoom);
  setView(zoom, QPointF(pane.width() - image->width() * zoom, pane.height() - image->height() * zoom) / 2);
}

void ComparisonView::zoomTo(double zoom) {
  const QSizeF pane = paneSize();
  zoomBy(zoom / zoom_, QPointF(pane.width(), pane.height()) / 2);
}

void ComparisonView::zoomBy(double factor, const QPointF& anchor) {
  const double zoom = std::clamp(zoom_ * factor, kSmallestZoom, kLargestZoom);
  const QPointF place = pictureFromWidget(anchor);
  const QPointF inPane = place * zoom_ + offset_;
  fitted_ = false;
  setView(zoom, inPane - place * zoom);
}

float ComparisonView::relativeDifference(std::span<const float> captured, std::span<const float> rendered,
                                         float floor) {
  float from = 0, to = 0;
  for (const float value : captured) from += value;
  for (const float value : rendered) to += value;
  from /= static_cast<float>(std::max<std::size_t>(1, captured.size()));
  to /= static_cast<float>(std::max<std::size_t>(1, rendered.size()));
  if (from == 0 && to == 0) return std::numeric_limits<float>::quiet_NaN();
  return (to - from) / std::max(from, floor);
}

void ComparisonView::renderDifference(double ratio) {
  const QRect all = canvas_.rect();
  std::vector<float> from, to;
  captured_.sample(from, all, offset_ * ratio, zoom_ * ratio);
  rendered_.sample(to, all, offset_ * ratio, zoom_ * ratio);
  if (from.size() != to.size()) return;
  const std::size_t channels = captured_.picture()->channels();
  ToneSettings range;
  range.low = -differenceRange_;
  range.high = differenceRange_;
  const ToneMapper tone(ToneStyle::Diverging, range);
  std::size_t i = 0;
  for (int y = 0; y < all.height(); ++y) {
    auto* line = reinterpret_cast<QRgb*>(canvas_.scanLine(y));
    for (int x = 0; x < all.width(); ++x, i += channels) {
      if (std::isnan(from[i])) continue;
      const std::array<float, 1> value{relativeDifference(std::span(from).subspan(i, channels),
                                                          std::span(to).subspan(i, channels), darkFloor_)};
      line[x] = tone(value);
    }
  }
}

void ComparisonView::render() {
  stale_ = false;
  const double ratio = devicePixelRatioF();
  const QSize size(std::max(1, static_cast<int>(std::ceil(width() * ratio))),
                   std::max(1, static_cast<int>(std::ceil(height() * ratio))));
  if (canvas_.size() != size) canvas_ = QImage(size, QImage::Format_RGB32);
  canvas_.setDevicePixelRatio(ratio);
  canvas_.fill(theme::kCanvas);
  if (!captured_.picture()) return;
  const double scale = zoom_ * ratio;
  const QRect all(QPoint(), size);
  if (!rendered_.picture()) {
    captured_.draw(canvas_, all, offset_ * ratio, scale, ToneStyle::LinearRgb, tone_);
    return;
  }
  switch (mode_) {
    case ComparisonMode::Wipe: {
      const int cut = static_cast<int>(std::lround(divider_ * size.width()));
      captured_.draw(canvas_, QRect(0, 0, cut, size.height()), offset_ * ratio, scale, ToneStyle::LinearRgb,
                     tone_);
      rendered_.draw(canvas_, QRect(cut, 0, size.width() - cut, size.height()), offset_ * ratio, scale,
                     ToneStyle::LinearRgb, tone_);
      break;
    }
    case ComparisonMode::SideBySide: {
      const QSizeF pane = paneSize();
      const QPointF second = secondPane();
      captured_.draw(canvas_, QRectF(QPointF(), pane * ratio).toRect(), offset_ * ratio, scale,
                     ToneStyle::LinearRgb, tone_);
      rendered_.draw(canvas_, QRectF(second * ratio, pane * ratio).toRect(), (offset_ + second) * ratio,
                     scale, ToneStyle::LinearRgb, tone_);
      break;
    }
    case ComparisonMode::Difference:
      renderDifference(ratio);
      break;
  }
}

void ComparisonView::paintLabel(QPainter& painter, const QPointF& corner, const QString& text,
                                bool alignRight) const {
  const QFontMetrics metrics = painter.fontMetrics();
  const double width = metrics.horizontalAdvance(text) + 14;
  const QRectF tag(alignRight ? corner.x() - width : corner.x(), corner.y(), width, metrics.height() + 5);
  painter.setPen(Qt::NoPen);
  painter.setBrush(QColor(0, 0, 0, 150));
  painter.drawRoundedRect(tag, 4, 4);
  painter.setPen(theme::kText);
  painter.drawText(tag, Qt::AlignCenter, text);
}

void ComparisonView::paintEvent(QPaintEvent*) {
  if (stale_) render();
  QPainter painter(this);
  painter.drawImage(QPointF(0, 0), canvas_);
  painter.setRenderHint(QPainter::Antialiasing);
  if (!captured_.picture()) {
    painter.setPen(theme::kTextDim);
    painter.drawText(rect().adjusted(24, 8, -24, -8), Qt::AlignCenter | Qt::TextWordWrap, emptyText_);
    focusRing_.paint(painter, *this);
    return;
  }
  painter.setFont(theme::captionFont());
  const QString &photograph = firstName_, &rendered = secondName_;
  if (!rendered_.picture()) {
    paintLabel(painter, {8, 8}, photograph, false);
  } else if (mode_ == ComparisonMode::Wipe) {
    const double x = divider_ * width();
    painter.setPen(QPen(QColor(0, 0, 0, 140), 3));
    painter.drawLine(QPointF(x, 0), QPointF(x, height()));
    painter.setPen(QPen(hasFocus() ? theme::kAccent : QColor(235, 235, 235), 1.4));
    painter.drawLine(QPointF(x, 0), QPointF(x, height()));
    const QPointF middle(x, height() / 2.0);
    painter.setBrush(QColor(30, 30, 30, 220));
    painter.drawEllipse(middle, 11, 11);
    for (const double side : {-1.0, 1.0}) {
      painter.drawLine(middle + QPointF(side * 6.5, 0), middle + QPointF(side * 3, -3.5));
      painter.drawLine(middle + QPointF(side * 6.5, 0), middle + QPointF(side * 3, 3.5));
    }
    const QFontMetrics metrics = painter.fontMetrics();
    if (x > metrics.horizontalAdvance(photograph) + 30) paintLabel(painter, {x - 8, 8}, photograph, true);
    if (width() - x > metrics.horizontalAdvance(rendered) + 30)
      paintLabel(painter, {x + 8, 8}, rendered, false);
  } else if (mode_ == ComparisonMode::SideBySide) {
    const QPointF second = secondPane();
    painter.fillRect(stacked() ? QRectF(0, second.y() - kGap, width(), kGap)
                               : QRectF(second.x() - kGap, 0, kGap, height()),
                     theme::kSunken);
    paintLabel(painter, {8, 8}, photograph, false);
    paintLabel(painter, second + QPointF(8, 8), rendered, false);
  } else {
    paintLabel(painter, {8, 8}, tr("(%2 \u2212 %1) / %1").arg(firstName_, secondName_), false);
  }
  focusRing_.paint(painter, *this);
}

void ComparisonView::resizeEvent(QResizeEvent* event) {
  stale_ = true;
  if (fitted_)
    zoomToFit();
  else if (event->oldSize().isValid())
    setView(zoom_,
            offset_ + QPointF(width() - event->oldSize().width(), height() - event->oldSize().height()) / 2);
}

void ComparisonView::wheelEvent(QWheelEvent* event) {
  if (!captured_.picture()) return;
  zoomBy(std::pow(1.25, event->angleDelta().y() / 120.0), event->position());
  reportHover(event->position());
  event->accept();
}

bool ComparisonView::overDivider(const QPointF& position) const {
  return rendered_.picture() && mode_ == ComparisonMode::Wipe &&
         std::abs(position.x() - divider_ * width()) <= kGrabPx;
}

void ComparisonView::mousePressEvent(QMouseEvent* event) {
  last_ = event->position();
  drag_ =
      event->button() == Qt::LeftButton && overDivider(event->position()) ? Drag::Divider : Drag::Undecided;
}

void ComparisonView::mouseMoveEvent(QMouseEvent* event) {
  if (event->buttons() == Qt::NoButton) drag_ = Drag::None;
  if (drag_ == Drag::Undecided && (event->position() - last_).manhattanLength() > 4) drag_ = Drag::Picture;
  if (drag_ == Drag::Divider) {
    setDivider(event->position().x() / std::max(1, width()));
  } else if (drag_ == Drag::Picture && captured_.picture()) {
    setCursor(Qt::ClosedHandCursor);
    fitted_ = false;
    setView(zoom_, offset_ + event->position() - last_);
    last_ = event->position();
  } else {
    setCursor(overDivider(event->position()) ? Qt::SplitHCursor : Qt::CrossCursor);
  }
  reportHover(event->position());
}

void ComparisonView::mouseReleaseEvent(QMouseEvent* event) {
  drag_ = Drag::None;
  setCursor(overDivider(event->position()) ? Qt::SplitHCursor : Qt::CrossCursor);
}

void ComparisonView::mouseDoubleClickEvent(QMouseEvent* event) {
  if (event->button() == Qt::LeftButton && rendered_.picture() && mode_ == ComparisonMode::Wipe)
    setDivider(0.5);
}

void ComparisonView::reportHover(const QPointF& position) {
  std::optional<QPoint> pixel;
  if (const Image* image = captured_.picture()) {
    const QPointF place = pictureFromWidget(position);
    const QPoint candidate(static_cast<int>(std::floor(place.x())), static_cast<int>(std::floor(place.y())));
    if (QRect(0, 0, image->width(), image->height()).contains(candidate)) pixel = candidate;
  }
  if (pixel == hover_) return;
  hover_ = pixel;
  Q_EMIT hovered(hover_);
}

void ComparisonView::leaveEvent(QEvent*) {
  if (!hover_) return;
  hover_.reset();
  Q_EMIT hovered(hover_);
}

void ComparisonView::keyPressEvent(QKeyEvent* event) {
  const QPointF middle(width() / 2.0, height() / 2.0);
  const bool wipes = rendered_.picture() && mode_ == ComparisonMode::Wipe;
  const double step = event->modifiers() & Qt::ShiftModifier ? 5 * kDividerStep : kDividerStep;
  switch (event->key()) {
    case Qt::Key_Left:
      if (!wipes) return QWidget::keyPressEvent(event);
      return setDivider(divider_ - step);
    case Qt::Key_Right:
      if (!wipes) return QWidget::keyPressEvent(event);
      return setDivider(divider_ + step);
    case Qt::Key_Home:
      if (!wipes) return QWidget::keyPressEvent(event);
      return setDivider(0);
    case Qt::Key_End:
      if (!wipes) return QWidget::keyPressEvent(event);
      return setDivider(1);
    case Qt::Key_Plus:
    case Qt::Key_Equal:
      return zoomBy(1.25, middle);
    case Qt::Key_Minus:
      return zoomBy(0.8, middle);
    case Qt::Key_0:
      return zoomToFit();
    case Qt::Key_1:
      return zoomTo(1 / devicePixelRatioF());
    default:
      QWidget::keyPressEvent(event);
  }
}

void ComparisonView::focusInEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  update();
}

void ComparisonView::focusOutEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  update();
}

}  // namespace patina
