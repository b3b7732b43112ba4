#include "widgets/live_view.h"

#include "widgets/theme.h"

namespace patina {

namespace {

/// sRGB's curve by a table over light: live pictures are many.
const std::array<std::uint8_t, 4097>& encodingTable() {
  static const std::array<std::uint8_t, 4097> table = [] {
    std::array<std::uint8_t, 4097> made{};
    for (std::size_t i = 0; i < made.size(); ++i) {
      const double light = static_cast<double>(i) / 4096;
      const double value = light <= 0.0031308 ? 12.92 * light : 1.055 * std::pow(light, 1 / 2.4) - 0.055;
      made[i] = static_cast<std::uint8_t>(std::lround(255 * value));
    }
    return made;
  }();
  return table;
}

}  // namespace

LiveFramePtr makeLiveFrame(Image linear, const FrameFormat& format, const FrameMetadata& metadata,
                           double white) {
  auto frame = std::make_shared<LiveFrame>();
  frame->format = format;
  frame->metadata = metadata;
  const auto& table = encodingTable();
  const int width = linear.width(), height = linear.height(), channels = linear.channels();
  frame->shown = QImage(width, height, QImage::Format_RGB32);
  const auto clipsAt = static_cast<float>(0.98 * white);  // what noise takes off full scale
  std::size_t clipped = 0;
  for (int y = 0; y < height; ++y) {
    auto* line = reinterpret_cast<QRgb*>(frame->shown.scanLine(y));
    for (int x = 0; x < width; ++x) {
      std::array<std::uint8_t, 3> value{};
      bool full = false;
      for (int c = 0; c < 3; ++c) {
        const float light = linear.at(x, y, std::min(c, channels - 1));
        full |= light >= clipsAt;
        value[static_cast<std::size_t>(c)] =
            table[static_cast<std::size_t>(std::lround(4096 * std::clamp(light, 0.0f, 1.0f)))];
        ++frame->histogram[static_cast<std::size_t>(c)][value[static_cast<std::size_t>(c)] / 4u];
      }
      clipped += full ? 1 : 0;
      line[x] = full ? qRgb(235, 64, 52) : qRgb(value[0], value[1], value[2]);
    }
  }
  if (width > 0 && height > 0)
    frame->clippedShare = static_cast<double>(clipped) / (static_cast<double>(width) * height);
  frame->linear = std::move(linear);
  return frame;
}

LiveView::LiveView(QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("liveView"));
  setAccessibleName(tr("Live picture of the camera"));
  setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Expanding);
  emptyText_ = tr("No picture yet");
}

void LiveView::setFrame(LiveFramePtr frame) {
  frame_ = std::move(frame);
  update();
}

void LiveView::setOverlay(Overlay overlay) {
  overlay_ = std::move(overlay);
  update();
}

void LiveView::setEmptyText(const QString& text) {
  emptyText_ = text;
  update();
}

QTransform LiveView::widgetFromPicture() const {
  if (!frame_ || frame_->shown.isNull()) return {};
  const QSizeF picture = frame_->shown.size();
  const double zoom = std::min(width() / picture.width(), height() / picture.height());
  return QTransform::fromTranslate(0.5 * (width() - zoom * picture.width()),
                                   0.5 * (height() - zoom * picture.height()))
      .scale(zoom, zoom);
}

void LiveView::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.fillRect(rect(), theme::kCanvas);
  if (!frame_) {
    painter.setPen(theme::kTextDim);
    painter.drawText(rect().adjusted(12, 12, -12, -12), static_cast<int>(Qt::AlignCenter) | Qt::TextWordWrap,
                     emptyText_);
    return;
  }
  const QTransform transform = widgetFromPicture();
  painter.save();
  painter.setRenderHint(QPainter::SmoothPixmapTransform, transform.m11() < 2);
  painter.setTransform(transform, true);
  painter.drawImage(QPointF(), frame_->shown);
  painter.restore();
  if (!overlay_) return;
  painter.setRenderHint(QPainter::Antialiasing);
  overlay_(painter, transform);
}

}  // namespace patina
