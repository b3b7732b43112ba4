#include "widgets/sphere_view.h"

#include <Eigen/Dense>
#include <QKeyEvent>
#include <numbers>

#include "engine/render/brdf_sphere.h"
#include "engine/render/tone_map.h"
#include "widgets/theme.h"
#include "widgets/tone.h"

namespace patina {

namespace {

constexpr int kStudioSamples = 24;  ///< enough for a small sphere, and quick enough to follow the cursor

QImage bytesOf(const Image& displayEncoded) {
  QImage out(displayEncoded.width(), displayEncoded.height(), QImage::Format_RGB32);
  for (int y = 0; y < out.height(); ++y) {
    auto* line = reinterpret_cast<QRgb*>(out.scanLine(y));
    for (int x = 0; x < out.width(); ++x) {
      const auto pixel = displayEncoded.pixel(x, y);
      const auto part = [&](int c) { return static_cast<int>(pixel[c] * 255.0f + 0.5f); };
      line[x] = qRgb(part(0), part(1), part(2));
    }
  }
  return out;
}

}  // namespace

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

void SphereView::setStudio(bool studio) {
  studio_ = studio;
  stale_ = true;
  update();
}

void SphereView::focusInEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  update();
}

void SphereView::focusOutEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
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
  const auto exposure = static_cast<float>(std::exp2(exposureEv_));
  SphereLighting lighting;
  lighting.studio = studio_;
  lighting.toLight = toLight_;
  // Alone, the light makes a white matt sphere just white where it faces it; in the room it is one of three.
  lighting.lightIrradiance = Eigen::Array3f::Constant(studio_ ? 1.0f : std::numbers::pi_v<float>);
  const float surround = linearFromSrgb(theme::kWindow.redF()) / exposure;
  const Image radiance = brdfSphere(*material_, side, lighting, kStudioSamples, surround);
  rendered_ = bytesOf(toneMap(radiance, exposure, Highlights::Shoulder));
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
  focusRing_.paint(painter, *this);
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
