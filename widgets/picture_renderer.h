#pragma once

#include <QImage>
#include <QPointF>
#include <QRect>
#include <cmath>
#include <memory>
#include <vector>

#include "widgets/tone.h"

namespace patina {

/// Turns the visible part of a float picture into colours, at any zoom: squares from two device pixels a
/// picture pixel on, interpolated below that, from 2 x 2 averages (made when first wanted) below one.
/// Belongs to one thread.
class PictureRenderer {
 public:
  static constexpr double kNearestFromZoom = 2;  ///< device pixels a picture pixel

  void setPicture(std::shared_ptr<const Image> image);
  const Image* picture() const { return image_.get(); }

  /// Draws into `target` (Format_RGB32) what of the picture lies inside `clip`, device pixels; the rest of
  /// `target` is left alone. The picture's corner is at `origin`, one of its pixels is `scale` device pixels
  /// wide.
  void draw(QImage& target, const QRect& clip, const QPointF& origin, double scale, ToneStyle style,
            const ToneSettings& tone);
  /// The samples that `draw` would show, before they become colours, all channels, row by row of `clip`; NaN
  /// beside the picture.
  void sample(std::vector<float>& out, const QRect& clip, const QPointF& origin, double scale);

 private:
  const Image& level(int index);
  const Image& levelFor(double scale) {
    const int wanted = scale < 1 ? static_cast<int>(std::floor(std::log2(1 / scale))) : 0;
    return level(std::min(wanted, 12));
  }

  std::shared_ptr<const Image> image_;
  std::vector<Image> smaller_;
};

}  // namespace patina
