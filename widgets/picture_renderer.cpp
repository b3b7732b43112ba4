#include "widgets/picture_renderer.h"

#include <limits>

namespace patina {

void PictureRenderer::setPicture(std::shared_ptr<const Image> image) {
  image_ = std::move(image);
  smaller_.clear();
}

const Image& PictureRenderer::level(int index) {
  const Image* from = image_.get();
  for (int i = 0; i < index; ++i) {
    if (from->width() < 2 || from->height() < 2) break;
    if (i >= static_cast<int>(smaller_.size())) {
      Image half(from->width() / 2, from->height() / 2, from->channels());
      for (int y = 0; y < half.height(); ++y)
        for (int x = 0; x < half.width(); ++x)
          for (int c = 0; c < half.channels(); ++c)
            half.at(x, y, c) = 0.25f * (from->at(2 * x, 2 * y, c) + from->at(2 * x + 1, 2 * y, c) +
                                        from->at(2 * x, 2 * y + 1, c) + from->at(2 * x + 1, 2 * y + 1, c));
      smaller_.reserve(16);  // references into it stay good
      smaller_.push_back(std::move(half));
    }
    from = &smaller_[i];
  }
  return *from;
}

void PictureRenderer::draw(QImage& target, const QRect& clip, const QPointF& origin, double scale,
                           ToneStyle style, const ToneSettings& settings) {
  if (!image_ || image_->empty()) return;
  const bool averaged = style != ToneStyle::Status;
  const Image& from = averaged ? levelFor(scale) : *image_;
  const double toLevelX = static_cast<double>(from.width()) / image_->width() / scale;
  const double toLevelY = static_cast<double>(from.height()) / image_->height() / scale;
  const bool nearest = !averaged || scale >= kNearestFromZoom;
  const ToneMapper tone(style, settings);
  const QRect inside = clip & target.rect();
  const int left = std::max(inside.left(), static_cast<int>(std::ceil(origin.x() - 0.5)));
  const int right =
      std::min(inside.right() + 1, static_cast<int>(std::ceil(origin.x() + image_->width() * scale - 0.5)));
  const int top = std::max(inside.top(), static_cast<int>(std::ceil(origin.y() - 0.5)));
  const int bottom =
      std::min(inside.bottom() + 1, static_cast<int>(std::ceil(origin.y() + image_->height() * scale - 0.5)));
  if (left >= right) return;
  std::vector<float> mixed(from.channels());
  std::vector<int> columns;
  if (nearest)
    for (int px = left; px < right; ++px)
      columns.push_back(
          std::clamp(static_cast<int>((px + 0.5 - origin.x()) * toLevelX), 0, from.width() - 1));
  int previousRow = -1, previousLine = -1;
  for (int py = top; py < bottom; ++py) {
    auto* line = reinterpret_cast<QRgb*>(target.scanLine(py));
    const double y = (py + 0.5 - origin.y()) * toLevelY;
    if (nearest) {
      const int row = std::clamp(static_cast<int>(y), 0, from.height() - 1);
      if (row == previousRow) {  // magnified rows repeat
        const auto* same = reinterpret_cast<const QRgb*>(target.constScanLine(previousLine));
        std::copy(same + left, same + right, line + left);
        continue;
      }
      int previousColumn = -1;
      QRgb colour = 0;
      for (int px = left; px < right; ++px) {
        const int column = columns[px - left];
        if (column != previousColumn) colour = tone(from.pixel(column, row));
        previousColumn = column;
        line[px] = colour;
      }
      previousRow = row;
      previousLine = py;
      continue;
    }
    const double cy = std::clamp(y - 0.5, 0.0, from.height() - 1.0);
    const int y0 = static_cast<int>(cy), y1 = std::min(y0 + 1, from.height() - 1);
    const auto fy = static_cast<float>(cy - y0);
    for (int px = left; px < right; ++px) {
      const double cx = std::clamp((px + 0.5 - origin.x()) * toLevelX - 0.5, 0.0, from.width() - 1.0);
      const int x0 = static_cast<int>(cx), x1 = std::min(x0 + 1, from.width() - 1);
      const auto fx = static_cast<float>(cx - x0);
      for (int c = 0; c < from.channels(); ++c)
        mixed[c] = (1 - fy) * ((1 - fx) * from.at(x0, y0, c) + fx * from.at(x1, y0, c)) +
                   fy * ((1 - fx) * from.at(x0, y1, c) + fx * from.at(x1, y1, c));
      line[px] = tone(mixed);
    }
  }
}

void PictureRenderer::sample(std::vector<float>& out, const QRect& clip, const QPointF& origin,
                             double scale) {
  if (!image_ || image_->empty()) return out.clear();
  const int channels = image_->channels();
  out.assign(static_cast<std::size_t>(clip.width()) * clip.height() * channels,
             std::numeric_limits<float>::quiet_NaN());
  const Image& from = levelFor(scale);
  const double toLevelX = static_cast<double>(from.width()) / image_->width() / scale;
  const double toLevelY = static_cast<double>(from.height()) / image_->height() / scale;
  const bool nearest = scale >= kNearestFromZoom;
  auto to = out.begin();
  for (int py = clip.top(); py <= clip.bottom(); ++py) {
    const double y = (py + 0.5 - origin.y()) * toLevelY;
    for (int px = clip.left(); px <= clip.right(); ++px, to += channels) {
      const double x = (px + 0.5 - origin.x()) * toLevelX;
      if (x < 0 || y < 0 || x >= from.width() || y >= from.height()) continue;
      if (nearest) {
        const auto pixel = from.pixel(static_cast<int>(x), static_cast<int>(y));
        std::copy(pixel.begin(), pixel.end(), to);
        continue;
      }
      const double cx = std::clamp(x - 0.5, 0.0, from.width() - 1.0);
      const double cy = std::clamp(y - 0.5, 0.0, from.height() - 1.0);
      const int x0 = static_cast<int>(cx), x1 = std::min(x0 + 1, from.width() - 1);
      const int y0 = static_cast<int>(cy), y1 = std::min(y0 + 1, from.height() - 1);
      const auto fx = static_cast<float>(cx - x0), fy = static_cast<float>(cy - y0);
      for (int c = 0; c < channels; ++c)
        to[c] = (1 - fy) * ((1 - fx) * from.at(x0, y0, c) + fx * from.at(x1, y0, c)) +
                fy * ((1 - fx) * from.at(x0, y1, c) + fx * from.at(x1, y1, c));
    }
  }
}

}  // namespace patina
