#pragma once

#include <QWidget>
#include <memory>
#include <optional>

#include "widgets/focus_ring.h"
#include "widgets/picture_renderer.h"
#include "widgets/tone.h"

namespace patina {

/// How two pictures are shown together.
enum class ComparisonMode {
  Wipe,        ///< the first left of a divider that can be dragged, the second right of it
  SideBySide,  ///< both whole, with the same zoom and place
  Difference,  ///< (second - first) / first, signed, in colours
};

/// A photograph and its prediction together, with one zoom and one place. Wheel: zoom at the cursor. Drag:
/// move. Drag on the divider, Left, Right, Home, End: wipe; a double click centres the divider. While there
/// is no prediction the photograph is shown alone.
class ComparisonView : public QWidget {
  Q_OBJECT

 public:
  explicit ComparisonView(QWidget* parent = nullptr);

  /// Linear R G B of one size and unit; `rendered` may be null. Zoom and place stay where the size does.
  void setPictures(std::shared_ptr<const Image> captured, std::shared_ptr<const Image> rendered);
  void setEmptyText(const QString& text);
  /// What the two are called; "photograph" and "reconstruction" at first.
  void setNames(const QString& first, const QString& second);
  void setMode(ComparisonMode mode);
  ComparisonMode mode() const { return mode_; }
  /// Of both pictures.
  void setTone(const ToneSettings& tone);
  /// Relative difference at either end of the colours, 0.5: 50 %.
  void setDifferenceRange(double range);
  double differenceRange() const { return differenceRange_; }
  /// Below this value of the photograph a difference is divided by it instead: noise in the dark is not an
  /// error of hundreds of percent.
  void setDarkFloor(float floor);

  const Image* captured() const { return captured_.picture(); }
  const Image* rendered() const { return rendered_.picture(); }
  /// The divider, 0 at the left edge, 1 at the right.
  double divider() const { return divider_; }
  void setDivider(double fraction);

  double zoom() const { return zoom_; }  ///< device-independent pixels a picture pixel
  void zoomToFit();
  void zoomTo(double zoom);
  void zoomBy(double factor, const QPointF& anchor);
  /// In the picture on the left where there are two.
  QPointF widgetFromPicture(const QPointF& place) const { return place * zoom_ + offset_; }
  QPointF pictureFromWidget(const QPointF& position) const;

  /// (rendered - captured) / max(captured, floor), of the channels' means; NaN where both are 0.
  static float relativeDifference(std::span<const float> captured, std::span<const float> rendered,
                                  float floor);

  QSize sizeHint() const override { return {480, 420}; }
  QSize minimumSizeHint() const override { return {180, 150}; }

 Q_SIGNALS:
  void hovered(std::optional<QPoint> pixel);
  void zoomChanged(double zoom);
  void dividerMoved(double fraction);

 protected:
  void paintEvent(QPaintEvent* event) override;
  void resizeEvent(QResizeEvent* event) override;
  void wheelEvent(QWheelEvent* event) override;
  void mousePressEvent(QMouseEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;
  void mouseReleaseEvent(QMouseEvent* event) override;
  void mouseDoubleClickEvent(QMouseEvent* event) override;
  void leaveEvent(QEvent* event) override;
  void keyPressEvent(QKeyEvent* event) override;
  void focusInEvent(QFocusEvent* event) override;
  void focusOutEvent(QFocusEvent* event) override;

 private:
  enum class Drag { None, Undecided, Divider, Picture };
  ComparisonMode shownMode() const { return rendered_.picture() ? mode_ : ComparisonMode::Wipe; }
  bool stacked() const { return height() > width(); }
  QSizeF paneSize() const;
  QPointF secondPane() const;  ///< upper left corner of the second of two panes
  bool overDivider(const QPointF& position) const;
  void setView(double zoom, const QPointF& offset);
  void render();
  void renderDifference(double ratio);
  void paintLabel(QPainter& painter, const QPointF& corner, const QString& text, bool alignRight) const;
  void reportHover(const QPointF& position);

  PictureRenderer captured_, rendered_;
  ComparisonMode mode_ = ComparisonMode::Wipe;
  ToneSettings tone_;
  double differenceRange_ = 0.5;
  float darkFloor_ = 1e-6f;
  QString emptyText_, firstName_, secondName_;
  FocusRing focusRing_;

  QImage canvas_;
  bool stale_ = true;
  double zoom_ = 1, divider_ = 0.5;
  QPointF offset_;
  bool fitted_ = true;  ///< the picture follows the widget's size until the person zooms
  Drag drag_ = Drag::None;
  QPointF last_;
  std::optional<QPoint> hover_;
};

}  // namespace patina
