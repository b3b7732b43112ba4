#pragma once

#include <QTimer>
#include <QWidget>

#include "widgets/document.h"
#include "widgets/photo_library.h"

class QDoubleSpinBox;
class QLabel;
class QSlider;
class QTabBar;
class QToolButton;

namespace patina {

class ColourBar;
class ImageView;

/// The picture in the middle: photographs and maps under one row of tabs, with exposure, range, colour bar
/// and the value under the cursor.
class MapPanel : public QWidget {
  Q_OBJECT

 public:
  MapPanel(Document* document, PhotoLibrary* library, QWidget* parent = nullptr);

  ViewKind kind() const { return kind_; }
  void setKind(ViewKind kind);
  /// Shows a photograph of the bundle (and switches to the photo tab).
  void showPhoto(int photo);
  /// Shows parameters' standard deviations in their place, or the parameters again.
  void showUncertainty(bool shown);
  bool uncertaintyShown() const { return uncertaintyShown_; }
  int photo() const { return photo_; }
  ImageView* view() { return view_; }

  void automaticRange();
  void resetTone();

 Q_SIGNALS:
  void kindChanged(patina::ViewKind kind);
  void uncertaintyShownChanged(bool shown);
  /// The map texel under the cursor, on a map or through the camera on a photograph; none outside or without
  /// a fit.
  void texelHovered(std::optional<QPoint> texel);

 private:
  void refreshPicture();
  void refreshTone();
  void refreshMarker();
  void refreshReadout(std::optional<QPoint> pixel);
  void applyTone(const ToneSettings& tone);
  std::optional<QPoint> texelFromPhoto(const QPointF& place) const;
  std::optional<QPoint> texelAt(const QPointF& place) const;
  QString placeText(const QPoint& pixel) const;

  Document* document_;
  PhotoLibrary* library_;
  ViewKind kind_ = ViewKind::Photo;
  int photo_ = -1;
  std::shared_ptr<const Image> photoImage_;
  bool updating_ = false, uncertaintyShown_ = false;
  QTimer gesture_;

  QTabBar* tabs_;
  ImageView* view_;
  ColourBar* bar_;
  QLabel *caption_, *readout_, *zoom_;
  QLabel *exposureLabel_, *lowLabel_, *highLabel_;
  QSlider* exposureSlider_;
  QDoubleSpinBox *exposure_, *low_, *high_;
  QToolButton *auto_, *reset_, *zoomFit_, *zoomActual_, *uncertainty_;
};

}  // namespace patina
