#pragma once

#include <QTransform>
#include <QWidget>
#include <array>
#include <functional>
#include <memory>

#include "engine/acquire/frame.h"
#include "engine/image/image.h"

namespace patina {

/// A camera's frame made ready for looking at, and for finding boards in it.
struct LiveFrame {
  Image linear;  ///< R G B, 0 black level, 1 full scale
  FrameFormat format;
  FrameMetadata metadata;
  double clippedShare = 0;                         ///< of the pixels
  std::array<std::array<int, 64>, 3> histogram{};  ///< R G B, of display-encoded values 0..1
  QImage shown;                                    ///< display-encoded, clipped pixels in red
};
using LiveFramePtr = std::shared_ptr<const LiveFrame>;
/// What `LiveFrame` says of a picture. Any thread. Cost: a few ms a megapixel.
LiveFramePtr makeLiveFrame(Image linear, const FrameFormat& format, const FrameMetadata& metadata,
                           double white = 1);

/// The live picture, as large as fits, with what a step draws over it.
class LiveView : public QWidget {
  Q_OBJECT

 public:
  /// Draws in widget coordinates; the transform takes picture coordinates (pixel (i, j) covers [i, i+1) x
  /// [j, j+1)) to them.
  using Overlay = std::function<void(QPainter&, const QTransform& widgetFromPicture)>;
  explicit LiveView(QWidget* parent = nullptr);
  void setFrame(LiveFramePtr frame);
  LiveFramePtr frame() const { return frame_; }
  void setOverlay(Overlay overlay);
  /// Shown while there is no frame.
  void setEmptyText(const QString& text);
  QTransform widgetFromPicture() const;

  QSize sizeHint() const override { return {480, 360}; }
  QSize minimumSizeHint() const override { return {200, 150}; }

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  LiveFramePtr frame_;
  Overlay overlay_;
  QString emptyText_;
};

}  // namespace patina
