#pragma once

#include <Eigen/Core>
#include <QTimer>
#include <QWidget>

#include "widgets/document.h"
#include "widgets/focus_ring.h"

namespace patina {

/// A sphere of one texel's material under a distant light, or in a grey room as well, made by the engine.
/// Drag on it to move the light.
class SphereView : public QWidget {
  Q_OBJECT

 public:
  explicit SphereView(QWidget* parent = nullptr);
  /// The material; none: an empty outline.
  void setMaterial(const std::optional<SvbrdfParameters>& material);
  void setExposure(double stops);
  /// Also a grey room with two soft boxes round it.
  void setStudio(bool studio);
  /// Unit, towards the light; x right, y up, z to the eye.
  void setToLight(const Eigen::Vector3f& toLight);
  Eigen::Vector3f toLight() const { return toLight_; }
  QImage picture();

  QSize sizeHint() const override { return {150, 150}; }
  QSize minimumSizeHint() const override { return {64, 64}; }
  bool hasHeightForWidth() const override { return true; }
  int heightForWidth(int width) const override { return width; }

 protected:
  void paintEvent(QPaintEvent* event) override;
  void mousePressEvent(QMouseEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;
  void keyPressEvent(QKeyEvent* event) override;
  void resizeEvent(QResizeEvent* event) override;
  void focusInEvent(QFocusEvent* event) override;
  void focusOutEvent(QFocusEvent* event) override;

 private:
  void aim(const QPointF& position);
  QRectF ball() const;

  std::optional<SvbrdfParameters> material_;
  double exposureEv_ = 0;
  bool studio_ = false;
  FocusRing focusRing_;
  Eigen::Vector3f toLight_ = Eigen::Vector3f(-0.45f, 0.55f, 0.7f).normalized();
  QImage rendered_;
  bool stale_ = true;
};

}  // namespace patina
