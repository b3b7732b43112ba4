#pragma once

#include <Eigen/Core>
#include <QTimer>
#include <QWidget>

#include "widgets/document.h"

namespace patina {

/// A sphere of one texel's material under a distant light and nothing else, shaded with the engine's BRDF.
/// Drag on it to move the light.
class SphereView : public QWidget {
  Q_OBJECT

 public:
  explicit SphereView(QWidget* parent = nullptr);
  /// The material; none: an empty outline.
  void setMaterial(const std::optional<SvbrdfParameters>& material);
  void setExposure(double stops);
  /// Unit, towards the light; x right, y up, z to the eye.
  void setToLight(const Eigen::Vector3f& toLight);
  Eigen::Vector3f toLight() const { return toLight_; }
  QImage picture();

  QSize sizeHint() const override { return {150, 150}; }
  QSize minimumSizeHint() const override { return {90, 90}; }
  bool hasHeightForWidth() const override { return true; }
  int heightForWidth(int width) const override { return width; }

 protected:
  void paintEvent(QPaintEvent* event) override;
  void mousePressEvent(QMouseEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;
  void keyPressEvent(QKeyEvent* event) override;
  void resizeEvent(QResizeEvent* event) override;

 private:
  void aim(const QPointF& position);
  QRectF ball() const;

  std::optional<SvbrdfParameters> material_;
  double exposureEv_ = 0;
  Eigen::Vector3f toLight_ = Eigen::Vector3f(-0.45f, 0.55f, 0.7f).normalized();
  QImage rendered_;
  bool stale_ = true;
};

}  // namespace patina
