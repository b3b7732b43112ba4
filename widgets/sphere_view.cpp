#include "widgets/sphere_view.h"

#include <Eigen/Dense>
#include <QKeyEvent>
#include <numbers>

#include "engine/surface/svbrdf.h"
#include "widgets/theme.h"
#include "widgets/tone.h"

namespace patina {

SphereView::SphereView(QWidget* parent) : QWidget(parent) {
  setFocusPolicy(Qt::StrongFocus);
  setAccessibleName(tr("Sphere of the texel's material"));
  setToolTip(
      tr("The texel's material on a sphere under a distant light. Drag, or use the arrow keys, to move the "
         "light"));
  setCursor(Qt::OpenHandCursor);
}

void SphereView::setMaterial(const std::optional<SvbrdfParameters>& material) {
  material_ = material;
  stale_ = true;
  update();
}

void SphereView::setExposure(double stops) {
  if (stops == exposureEv_) return;
  exposureEv_ = stops;
  stale_ = true;
  update();
}

void SphereView::setToLight(const Eigen::Vector3f& toLight) {
  toLight_ = toLight.normalized();
  stale_ = true;
  update();
}

QRectF SphereView::ball() const {
  const double side = std::min(width(), height()) - 6.0;
  return {(width() - side) / 2, (height() - side) / 2, side, side};
}

QImage SphereView::picture() {
  const int side = std::max(8, static_cast<int>(std::lround(ball().width() * devicePixelRatioF())));
  if (!stale_ && rendered_.width() == side) return rendered_;
  stale_ = false;
  rendered_ = QImage(side, side, QImage::Format_ARGB32_Premultiplied);
  rendered_.fill(Qt::transparent);
  if (!material_) return rendered_;
  SvbrdfParameters material = *material_;
  const Eigen::Vector3f toView = Eigen::Vector3f::UnitZ();
  // A light of irradiance pi: a white matt sphere has radiance 1 where it faces the light.
  const float irradiance = static_cast<float>(std::numbers::pi * std::exp2(exposureEv_));
  const float radius = side / 2.0f;
  for (int y = 0; y < side; ++y) {
    auto* line = reinterpret_cast<QRgb*>(rendered_.scanLine(y));
    for (int x = 0; x < side; ++x) {
      const float u = (x + 0.5f - radius) / radius, v = (radius - y - 0.5f) / radius, r = std::hypot(u, v);
      // The last pixel of the rim fades, so that the outline is smooth.
      const float cover = std::clamp((1 - r) * radius + 0.5f, 0.0f, 1.0f);
      if (cover <= 0) continue;
      const float inside = std::min(1.0f, 0.9995f / std::max(r, 1e-6f));
      material.normal = Eigen::Vector3f(u * inside, v * inside, 0);
      material.normal.z() = std::sqrt(std::max(1e-3f, 1 - material.normal.squaredNorm()));
      material.normal.normalize();
      const Eigen::Array3f radiance = svbrdfBrdfTimesCos(toLight_, toView, material) * irradiance;
      const auto part = [&](int c) { return static_cast<int>(encodeSrgb8(radiance[c]) * cover + 0.5f); };
      line[x] = qRgba(part(0), part(1), part(2), static_cast<int>(255 * cover + 0.5f));
    }
  }
  return rendered_;
}

void SphereView::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.setRenderHint(QPainter::Antialiasing);
  if (!material_) {
    painter.setPen(QPen(theme::kBorder, 1.2, Qt::DashLine));
    painter.drawEllipse(ball().adjusted(6, 6, -6, -6));
    painter.setPen(theme::kTextOff);
    painter.setFont(theme::captionFont());
    painter.drawText(ball().adjusted(14, 14, -14, -14), Qt::AlignCenter | Qt::TextWordWrap,
                     tr("sphere of a texel"));
  } else {
    painter.drawImage(ball(), picture());
  }
  if (hasFocus()) {
    painter.setPen(theme::kAccent);
    painter.setBrush(Qt::NoBrush);
    painter.drawRect(rect().adjusted(0, 0, -1, -1));
  }
}

void SphereView::aim(const QPointF& position) {
  if (!material_) return;
  // The highlight goes to the cursor: the surface there has normal n, and the light is where n mirrors the
  // eye.
  const QRectF area = ball();
  Eigen::Vector2f at((position.x() - area.center().x()) / (area.width() / 2),
                     (area.center().y() - position.y()) / (area.height() / 2));
  if (at.norm() > 0.98f) at *= 0.98f / at.norm();
  const Eigen::Vector3f normal(at.x(), at.y(), std::sqrt(1 - at.squaredNorm()));
  setToLight(2 * normal.z() * normal - Eigen::Vector3f::UnitZ());
}

void SphereView::mousePressEvent(QMouseEvent* event) {
  aim(event->position());
}

void SphereView::mouseMoveEvent(QMouseEvent* event) {
  if (event->buttons() & Qt::LeftButton) aim(event->position());
}

void SphereView::keyPressEvent(QKeyEvent* event) {
  Eigen::Vector3f turn = Eigen::Vector3f::Zero();
  switch (event->key()) {
    case Qt::Key_Left:
      turn.x() = -0.12f;
      break;
    case Qt::Key_Right:
      turn.x() = 0.12f;
      break;
    case Qt::Key_Up:
      turn.y() = 0.12f;
      break;
    case Qt::Key_Down:
      turn.y() = -0.12f;
      break;
    default:
      return QWidget::keyPressEvent(event);
  }
  setToLight(toLight_ + turn);
}

void SphereView::resizeEvent(QResizeEvent*) {
  stale_ = true;
}

}  // namespace patina
