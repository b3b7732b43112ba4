#include "widgets/slice_picture.h"

#include <QKeyEvent>
#include <numbers>

#include "engine/render/measured_sphere.h"
#include "engine/render/tone_map.h"
#include "widgets/certainty_bar.h"
#include "widgets/theme.h"
#include "widgets/tone.h"

namespace patina {

namespace {

constexpr int kSide = 180;  ///< of the picture: two pixels a cell of the table
constexpr double kDegree = std::numbers::pi / 180;
constexpr ThetaHAxis kAxis = ThetaHAxis::Root;
constexpr std::array kTicksH{0.0, 1.0, 5.0, 15.0, 30.0, 60.0, 90.0};
constexpr std::array kTicksD{0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0};
constexpr std::array kContourPercents{5.0, 10.0, 20.0, 50.0, 100.0};

double luminance(std::span<const float> pixel) {
  return 0.2126 * pixel[0] + 0.7152 * pixel[1] + 0.0722 * pixel[2];
}

QString powerText(int power) {
  static const QString digits =
      QStringLiteral("\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079");
  QString text = QStringLiteral("10");
  if (power < 0) text += QStringLiteral("\u207b");
  for (const QChar digit : QString::number(std::abs(power))) text += digits[digit.digitValue()];
  return text;
}

}  // namespace

SlicePicture::SlicePicture(QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("slicePicture"));
  setMouseTracking(true);
  setFocusPolicy(Qt::StrongFocus);
  setAccessibleName(tr("Slice of the BRDF over theta h and theta d"));
  setToolTip(
      tr("The BRDF at \u03c6d = 90\u00b0: highlight at the left, grazing at the top, back-scatter at the "
         "bottom.\n"
         "Point at a place to read it; click to see the curve through it. Arrow keys move a cross."));
  setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Expanding);
}

void SlicePicture::setMaterial(std::shared_ptr<const TabulatedBrdf> brdf,
                               std::shared_ptr<const std::vector<float>> posteriorSd, double priorSd) {
  brdf_ = std::move(brdf);
  posteriorSd_ = std::move(posteriorSd);
  priorSd_ = priorSd > 0 ? priorSd : 1;
  slice_ = brdf_ ? brdfSlice(*brdf_, kSide, kSide, kAxis) : Image();
  sd_ = brdf_ && posteriorSd_ ? sdSlice(*posteriorSd_, kSide, kSide, kAxis) : Image();
  if (!brdf_) cursor_.reset();
  makeContours();
  render();
}

void SlicePicture::setLook(Look look) {
  look_ = look;
  render();
}

void SlicePicture::setContours(bool shown) {
  contours_ = shown;
  update();
}

void SlicePicture::setMeasured(const std::vector<HalfDiffAngles>& angles) {
  measured_.clear();
  // A dot a fine cell: thousands on top of each other say nothing more.
  constexpr int kCells = 240;
  std::vector<bool> taken(static_cast<std::size_t>(kCells) * kCells, false);
  for (const HalfDiffAngles& at : angles) {
    const double x = partOfThetaH(at.thetaHRad / kDegree, kAxis), y = at.thetaDRad / kDegree / 90;
    if (!(x >= 0 && x <= 1 && y >= 0 && y <= 1)) continue;
    const auto cell = static_cast<std::size_t>(std::min(kCells - 1, static_cast<int>(y * kCells))) * kCells +
                      static_cast<std::size_t>(std::min(kCells - 1, static_cast<int>(x * kCells)));
    if (taken[cell]) continue;
    taken[cell] = true;
    measured_.emplace_back(x, y);
  }
  update();
}

void SlicePicture::setCurves(std::vector<std::pair<double, QColor>> thetaDDeg) {
  curves_ = std::move(thetaDDeg);
  update();
}

void SlicePicture::render() {
  shown_ = {};
  if (slice_.empty()) return update();
  std::vector<float> lights;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const double light = luminance(slice_.pixel(x, y));
      if (light > 0 && std::isfinite(light)) lights.push_back(static_cast<float>(std::log10(light)));
    }
  if (!lights.empty()) {
    std::sort(lights.begin(), lights.end());
    logLow_ = lights[lights.size() / 100];
    logHigh_ = lights.back();
    if (logHigh_ - logLow_ < 0.5) {  // a nearly flat BRDF: don't blow up its rounding
      const double middle = 0.5 * (logLow_ + logHigh_);
      logLow_ = middle - 0.25;
      logHigh_ = middle + 0.25;
    }
  }
  shown_ = QImage(kSide, kSide, QImage::Format_RGB32);
  const ToneMapper ramp(ToneStyle::Scalar, {0, logLow_, logHigh_});
  Image seen;
  if (look_ == Look::Colours) {
    // Like a photograph: pi times the BRDF of a white matt surface is 1.
    seen = slice_;
    for (float& value : seen.samples()) value *= std::numbers::pi_v<float>;
    seen = toneMap(seen, 1.0f, Highlights::Shoulder);
  }
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const auto pixel = slice_.pixel(x, y);
      QRgb colour = theme::kCanvas.rgb();
      if (!std::isfinite(pixel[0])) {
        // not known
      } else if (look_ == Look::Colours) {
        const auto part = [&](int c) { return static_cast<int>(seen.at(x, y, c) * 255.0f + 0.5f); };
        colour = qRgb(part(0), part(1), part(2));
      } else if (look_ == Look::Certainty && !sd_.empty()) {
        if (sd_.at(x, y) >= 0) {
          const auto mapped = certaintyColour(static_cast<float>(sd_.at(x, y) / priorSd_));
          colour = QColor::fromRgbF(mapped[0], mapped[1], mapped[2]).rgb();
        }
      } else {
        const double light = luminance(pixel);
        const float value = static_cast<float>(light > 0 ? std::log10(light) : logLow_);
        colour = ramp(std::span(&value, 1));
      }
      shown_.setPixel(x, y, colour);
    }
  update();
}

void SlicePicture::makeContours() {
  // Marching squares over the pixels' centres.
  contourLines_.clear();
  if (sd_.empty()) return;
  for (const double percent : kContourPercents) {
    Contour contour;
    contour.percent = percent;
    const float level = static_cast<float>(std::log1p(percent / 100));
    for (int y = 0; y + 1 < kSide; ++y)
      for (int x = 0; x + 1 < kSide; ++x) {
        const std::array<float, 4> v{sd_.at(x, y), sd_.at(x + 1, y), sd_.at(x + 1, y + 1), sd_.at(x, y + 1)};
        if (std::any_of(v.begin(), v.end(), [](float value) { return value < 0; })) continue;
        static constexpr std::array<std::array<int, 2>, 4> kCorners{{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
        std::array<QPointF, 4> cuts;
        int count = 0;
        for (std::size_t edge = 0; edge < 4; ++edge) {
          const std::size_t next = (edge + 1) % 4;
          if ((v[edge] < level) == (v[next] < level)) continue;
          const double t = (level - v[edge]) / (v[next] - v[edge]);
          const double px = x + 0.5 + kCorners[edge][0] + t * (kCorners[next][0] - kCorners[edge][0]),
                       py = y + 0.5 + kCorners[edge][1] + t * (kCorners[next][1] - kCorners[edge][1]);
          cuts[static_cast<std::size_t>(count++)] = {px / kSide, 1 - py / kSide};
        }
        for (int i = 0; i + 1 < count; i += 2)
          contour.lines.emplace_back(cuts[static_cast<std::size_t>(i)],
                                     cuts[static_cast<std::size_t>(i) + 1]);
      }
    if (!contour.lines.empty()) contourLines_.push_back(std::move(contour));
  }
}

QRectF SlicePicture::frame() const {
  const QFontMetricsF metrics(theme::captionFont());
  const double left = metrics.horizontalAdvance(QStringLiteral("90\u00b0")) + metrics.height() + 10;
  return QRectF(rect()).adjusted(left, 6, -metrics.horizontalAdvance(QStringLiteral("±100\u202f%")) - 24,
                                 -2 * metrics.height() - 9);
}

QRectF SlicePicture::bar() const {
  const QRectF area = frame();
  return {area.right() + 8, area.top(), 9, area.height()};
}

QPointF SlicePicture::place(double thetaHDeg, double thetaDDeg) const {
  const QRectF area = frame();
  return {area.left() + partOfThetaH(thetaHDeg, kAxis) * area.width(),
          area.bottom() - thetaDDeg / 90 * area.height()};
}

std::optional<HalfDiffAngles> SlicePicture::anglesAt(const QPointF& position) const {
  const QRectF area = frame();
  if (!brdf_ || !area.contains(position)) return std::nullopt;
  return HalfDiffAngles{thetaHDegAt((position.x() - area.left()) / area.width(), kAxis) * kDegree,
                        90 * (area.bottom() - position.y()) / area.height() * kDegree, 90 * kDegree};
}

void SlicePicture::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.setFont(theme::captionFont());
  if (shown_.isNull()) {
    painter.setPen(theme::kTextDim);
    painter.drawText(rect().adjusted(16, 8, -16, -8), Qt::AlignCenter | Qt::TextWordWrap,
                     tr("The whole slice of the BRDF appears here"));
    return focusRing_.paint(painter, *this);
  }
  const QRectF area = frame();
  if (area.width() < 40 || area.height() < 40) return;
  painter.setRenderHint(QPainter::SmoothPixmapTransform);
  painter.drawImage(area, shown_);
  painter.save();
  painter.setClipRect(area);
  painter.setRenderHint(QPainter::Antialiasing);
  const auto inside = [&](const QPointF& part) {
    return QPointF(area.left() + part.x() * area.width(), area.bottom() - part.y() * area.height());
  };
  painter.setPen(Qt::NoPen);
  painter.setBrush(QColor(255, 255, 255, 120));
  for (const QPointF& dot : measured_) painter.drawEllipse(inside(dot), 0.75, 0.75);
  std::vector<QRectF> labels;
  if (contours_)
    for (const Contour& contour : contourLines_) {
      QPointF highest = inside(contour.lines.front().p1());
      for (const QColor& ink : {QColor(0, 0, 0, 150), QColor(255, 255, 255, 230)}) {
        painter.setPen(QPen(ink, ink.red() ? 1.1 : 2.6, Qt::SolidLine, Qt::RoundCap));
        for (const QLineF& line : contour.lines) {
          const QPointF from = inside(line.p1()), to = inside(line.p2());
          painter.drawLine(from, to);
          if (from.y() < highest.y()) highest = from;
        }
      }
      const QString text = QStringLiteral("±%1\u202f%").arg(contour.percent);
      const QFontMetricsF metrics(painter.font());
      QRectF box(0, 0, metrics.horizontalAdvance(text) + 6, metrics.height());
      box.moveCenter(highest + QPointF(0, metrics.height() * 0.7));
      box.moveLeft(
          std::clamp(box.left(), area.left() + 2, std::max(area.left() + 2, area.right() - box.width() - 2)));
      if (std::any_of(labels.begin(), labels.end(),
                      [&](const QRectF& other) { return other.intersects(box); }))
        continue;  // no room: the bar beside the certainty's own colours says it
      labels.push_back(box);
      painter.setPen(Qt::NoPen);
      painter.setBrush(QColor(20, 20, 20, 170));
      painter.drawRoundedRect(box, 3, 3);
      painter.setPen(Qt::white);
      painter.drawText(box, Qt::AlignCenter, text);
    }
  for (const auto& [thetaD, colour] : curves_) {
    const double y = place(0, thetaD).y();
    painter.setPen(QPen(QColor(0, 0, 0, 140), 3));
    painter.drawLine(QPointF(area.left(), y), QPointF(area.left() + 12, y));
    painter.setPen(QPen(colour, 2));
    painter.drawLine(QPointF(area.left(), y), QPointF(area.left() + 12, y));
  }
  if (cursor_) {
    const QPointF at = place(cursor_->x(), cursor_->y());
    for (const QColor& ink : {QColor(0, 0, 0, 180), QColor(Qt::white)}) {
      painter.setPen(QPen(ink, ink == QColor(Qt::white) ? 1.2 : 3));
      painter.drawLine(at - QPointF(7, 0), at + QPointF(7, 0));
      painter.drawLine(at - QPointF(0, 7), at + QPointF(0, 7));
    }
  }
  painter.restore();
  paintAxes(painter, area);
  paintBar(painter);
  focusRing_.paint(painter, *this);
}

void SlicePicture::paintAxes(QPainter& painter, const QRectF& area) {
  const QFontMetricsF metrics(painter.font());
  painter.setRenderHint(QPainter::Antialiasing, false);
  painter.setBrush(Qt::NoBrush);
  painter.setPen(theme::kBorder);
  painter.drawRect(area);
  double lastEnd = -1e9;
  for (const double tick : kTicksH) {
    const double x = place(tick, 0).x();
    painter.setPen(theme::kBorder);
    painter.drawLine(QPointF(x, area.bottom()), QPointF(x, area.bottom() + 3));
    const QString text = QStringLiteral("%1\u00b0").arg(tick);
    const double wide = metrics.horizontalAdvance(text);
    if (x - wide / 2 < lastEnd + 4) continue;
    lastEnd = x + wide / 2;
    painter.setPen(theme::kTextDim);
    painter.drawText(QRectF(x - wide / 2 - 2, area.bottom() + 4, wide + 4, metrics.height()), Qt::AlignCenter,
                     text);
  }
  double lastTop = 1e9;
  for (const double tick : kTicksD) {
    const double y = place(0, tick).y();
    painter.setPen(theme::kBorder);
    painter.drawLine(QPointF(area.left() - 3, y), QPointF(area.left(), y));
    if (y + metrics.height() / 2 > lastTop) continue;
    lastTop = y - metrics.height() / 2;
    painter.setPen(theme::kTextDim);
    painter.drawText(QRectF(0, y - metrics.height() / 2, area.left() - 6, metrics.height()),
                     Qt::AlignRight | Qt::AlignVCenter, QStringLiteral("%1\u00b0").arg(tick));
  }
  painter.setPen(theme::kTextDim);
  const QString across = tr("\u03b8h, half-vector to normal");
  painter.drawText(
      QRectF(area.left() - 30, area.bottom() + metrics.height() + 5, area.width() + 30, metrics.height()),
      Qt::AlignCenter, metrics.elidedText(across, Qt::ElideRight, area.width() + 26));
  painter.save();
  painter.translate(metrics.height() / 2 + 2, area.center().y());
  painter.rotate(-90);
  painter.drawText(
      QRectF(-height() / 2.0, -metrics.height() / 2, height(), metrics.height()), Qt::AlignCenter,
      metrics.elidedText(tr("\u03b8d, light to half-vector"), Qt::ElideRight, area.height() + 12));
  painter.restore();
}

void SlicePicture::paintBar(QPainter& painter) {
  if (look_ == Look::Colours || (look_ == Look::Certainty && sd_.empty())) return;
  const QRectF area = bar();
  const QFontMetricsF metrics(painter.font());
  const bool certainty = look_ == Look::Certainty;
  const ToneMapper ramp(ToneStyle::Scalar, {0, 0, 1});
  for (int y = 0; y < static_cast<int>(area.height()); ++y) {
    const double part = 1 - (y + 0.5) / area.height();
    QColor colour(ramp.atFraction(part));
    if (certainty) {
      const auto mapped = certaintyColour(static_cast<float>(part));
      colour = QColor::fromRgbF(mapped[0], mapped[1], mapped[2]);
    }
    painter.fillRect(QRectF(area.left(), area.top() + y, area.width(), 1.5), colour);
  }
  painter.setPen(theme::kText);
  double last = 1e9;
  const auto tick = [&](double part, const QString& text) {
    if (part < -1e-6 || part > 1 + 1e-6) return;
    const double y = area.bottom() - part * area.height();
    if (y + metrics.height() > last) return;
    last = y;
    painter.drawLine(QPointF(area.right() + 1, y), QPointF(area.right() + 4, y));
    const double top = std::clamp(y - metrics.height() / 2, 0.0, height() - metrics.height());
    painter.drawText(QRectF(area.right() + 6, top, width() - area.right() - 6, metrics.height()),
                     Qt::AlignLeft | Qt::AlignVCenter, text);
  };
  if (certainty)
    for (const double percent : {0.0, 5.0, 10.0, 20.0, 40.0, 70.0, 100.0, 150.0, 250.0, 500.0})
      tick(std::log1p(percent / 100) / priorSd_, QStringLiteral("±%1\u202f%").arg(percent));
  else if (std::floor(logHigh_) - std::ceil(logLow_) >= 1)
    for (int power = static_cast<int>(std::ceil(logLow_)); power <= std::floor(logHigh_); ++power)
      tick((power - logLow_) / (logHigh_ - logLow_), powerText(power));
  else
    for (const double part : {0.0, 0.5, 1.0})
      tick(part, QString::number(std::pow(10.0, logLow_ + part * (logHigh_ - logLow_)), 'g', 2));
  if (!certainty) {
    painter.setPen(theme::kTextDim);
    painter.drawText(QRectF(area.left() - 30, area.bottom() + metrics.height() + 5,
                            width() - area.left() + 26, metrics.height()),
                     Qt::AlignRight, tr("1/sr"));
  }
}

void SlicePicture::mouseMoveEvent(QMouseEvent* event) {
  Q_EMIT hovered(anglesAt(event->position()));
}

void SlicePicture::mousePressEvent(QMouseEvent* event) {
  if (event->button() != Qt::LeftButton) return;
  if (const auto angles = anglesAt(event->position())) {
    cursor_ = QPointF(angles->thetaHRad / kDegree, angles->thetaDRad / kDegree);
    update();
    Q_EMIT picked(*angles);
  }
}

void SlicePicture::leaveEvent(QEvent*) {
  Q_EMIT hovered(std::nullopt);
}

void SlicePicture::keyPressEvent(QKeyEvent* event) {
  QPointF step;
  switch (event->key()) {
    case Qt::Key_Left:
      step = {-1, 0};
      break;
    case Qt::Key_Right:
      step = {1, 0};
      break;
    case Qt::Key_Up:
      step = {0, 1};
      break;
    case Qt::Key_Down:
      step = {0, -1};
      break;
    default:
      return QWidget::keyPressEvent(event);
  }
  if (!brdf_) return;
  const QPointF from = cursor_.value_or(QPointF(10, 45));
  // Across in the table's own steps, up by degrees.
  const double part = std::clamp(partOfThetaH(from.x(), kAxis) + step.x() / 90, 0.0, 1.0);
  cursor_ = QPointF(thetaHDegAt(part, kAxis), std::clamp(from.y() + step.y(), 0.0, 90.0));
  update();
  const HalfDiffAngles angles{cursor_->x() * kDegree, cursor_->y() * kDegree, 90 * kDegree};
  Q_EMIT hovered(angles);
  Q_EMIT picked(angles);
}

void SlicePicture::focusInEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  update();
}

void SlicePicture::focusOutEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  update();
}

}  // namespace patina
