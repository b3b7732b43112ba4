#include "widgets/brdf_sphere_canvas.h"

#include <vtkCamera.h>
#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkMatrix4x4.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkSphereSource.h>

#include <Eigen/Geometry>
#include <QKeyEvent>
#include <QWheelEvent>
#include <cstring>
#include <numbers>

#include "widgets/certainty_bar.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr double kViewAngleDeg = 30;
constexpr double kMargin = 1.22;        ///< of the view's half-height at zoom 1, in radii: room for the lamp
constexpr double kLampDistance = 1.13;  ///< of the lamp from the sphere's middle, in radii
constexpr double kLampGrabPx = 15;
constexpr double kLeastZoom = 0.5, kMostZoom = 4;
constexpr int kLeastSize = 64, kMostSize = 960;  ///< of the sphere's picture, device pixels
constexpr float kMostPitchRad = 1.5f;
constexpr int kSettleMs = 90;  ///< after the last change of size the picture is made anew
const Eigen::Vector3f kStartToLight = Eigen::Vector3f(-0.5f, 0.55f, 0.67f).normalized();

vtkSmartPointer<vtkActor> unlitActor(vtkPolyDataMapper* mapper) {
  auto actor = vtkSmartPointer<vtkActor>::New();
  actor->SetMapper(mapper);
  actor->GetProperty()->SetLighting(false);
  return actor;
}

/// The inside of a large sphere, its texture a latitude-longitude picture.
vtkSmartPointer<vtkPolyData> skyDome(double radius) {
  constexpr int kTurns = 96, kRings = 48;
  auto points = vtkSmartPointer<vtkPoints>::New();
  auto places = vtkSmartPointer<vtkFloatArray>::New();
  places->SetNumberOfComponents(2);
  for (int i = 0; i <= kRings; ++i)
    for (int j = 0; j <= kTurns; ++j) {
      const double u = static_cast<double>(j) / kTurns, v = static_cast<double>(i) / kRings;
      const double turn = (u - 0.5) * 2 * std::numbers::pi, fromUp = v * std::numbers::pi;
      points->InsertNextPoint(radius * std::sin(fromUp) * std::sin(turn), radius * std::cos(fromUp),
                              -radius * std::sin(fromUp) * std::cos(turn));
      places->InsertNextTuple2(u, 1 - v);
    }
  auto cells = vtkSmartPointer<vtkCellArray>::New();
  for (int i = 0; i < kRings; ++i)
    for (int j = 0; j < kTurns; ++j) {
      const vtkIdType a = i * (kTurns + 1) + j, b = a + kTurns + 1;
      const vtkIdType corners[] = {a, a + 1, b + 1, b};
      cells->InsertNextCell(4, corners);
    }
  auto dome = vtkSmartPointer<vtkPolyData>::New();
  dome->SetPoints(points);
  dome->SetPolys(cells);
  dome->GetPointData()->SetTCoords(places);
  return dome;
}

vtkSmartPointer<vtkTexture> textureOf(vtkImageData* pixels) {
  auto texture = vtkSmartPointer<vtkTexture>::New();
  texture->SetInputData(pixels);
  texture->InterpolateOn();
  texture->RepeatOff();
  texture->EdgeClampOn();
  return texture;
}

void copyInto(vtkImageData* pixels, const QImage& picture) {
  pixels->SetDimensions(picture.width(), picture.height(), 1);
  pixels->AllocateScalars(VTK_UNSIGNED_CHAR, 4);
  auto* bytes = static_cast<unsigned char*>(pixels->GetScalarPointer());
  const std::size_t line = static_cast<std::size_t>(picture.width()) * 4;
  for (int y = 0; y < picture.height(); ++y)  // textures begin at the bottom
    std::memcpy(bytes + line * static_cast<std::size_t>(picture.height() - 1 - y), picture.constScanLine(y),
                line);
  pixels->Modified();
}

}  // namespace

/// What is written over the scene; see SheetViewport.
class BrdfSphereCanvas::Overlay : public QWidget {
 public:
  explicit Overlay(BrdfSphereCanvas* of) : QWidget(of), of_(of) {
    setAttribute(Qt::WA_TransparentForMouseEvents);
  }

 protected:
  void paintEvent(QPaintEvent*) override {
    QPainter painter(this);
    of_->paintOver(painter);
  }

 private:
  BrdfSphereCanvas* of_;
};

BrdfSphereCanvas::BrdfSphereCanvas(QWidget* parent) : VtkWidget(parent) {
  setObjectName(QStringLiteral("brdfSphereCanvas"));
  overlay_ = new Overlay(this);
  connect(this, &VtkWidget::becameUnusable, overlay_, [this] { overlay_->update(); });
  worker_ = new SphereWorker(this);
  connect(worker_, &SphereWorker::shown, this, &BrdfSphereCanvas::show);
  setFocusPolicy(Qt::StrongFocus);
  setMouseTracking(true);
  setCursor(Qt::OpenHandCursor);
  setAccessibleName(tr("Sphere of the measured material"));
  setToolTip(
      tr("Drag: turn the room. Right drag, or Shift and drag: move the highlight. Drag the lamp: move the "
         "light.\n"
         "Wheel: zoom. Middle drag: pan. Double click: as at the start.\n"
         "Keys: arrows turn the room, with Shift they move the light; + and \u2212 zoom; Home: as at the "
         "start."));
  scene_.toLight = kStartToLight;
  settle_.setSingleShot(true);
  settle_.setInterval(kSettleMs);
  connect(&settle_, &QTimer::timeout, this, [this] {
    if (scene_.size != wantedSize()) wish();
  });
  buildScene();
}

BrdfSphereCanvas::~BrdfSphereCanvas() = default;

void BrdfSphereCanvas::buildScene() {
  renderer()->SetBackground(0.145, 0.145, 0.145);
  renderer()->GetActiveCamera()->SetViewAngle(kViewAngleDeg);
  QImage nothing(2, 2, QImage::Format_RGBA8888);
  nothing.fill(Qt::transparent);

  domePixels_ = vtkSmartPointer<vtkImageData>::New();
  copyInto(domePixels_, nothing);
  domeTexture_ = textureOf(domePixels_);
  auto domeMapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  domeMapper->SetInputData(skyDome(100));
  dome_ = unlitActor(domeMapper);
  dome_->SetTexture(domeTexture_);
  dome_->ForceOpaqueOn();

  // The engine's picture shows the sphere from afar; on a plane through its middle it is seen as such.
  auto plane = vtkSmartPointer<vtkPlaneSource>::New();
  const double side = 0.5 / kMeasuredSphereRadius;
  plane->SetOrigin(-side, -side, 0);
  plane->SetPoint1(side, -side, 0);
  plane->SetPoint2(-side, side, 0);
  auto planeMapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  planeMapper->SetInputConnection(plane->GetOutputPort());
  ballPixels_ = vtkSmartPointer<vtkImageData>::New();
  copyInto(ballPixels_, nothing);
  ballTexture_ = textureOf(ballPixels_);
  ball_ = unlitActor(planeMapper);
  ball_->SetTexture(ballTexture_);
  ball_->ForceTranslucentOn();

  auto bulb = vtkSmartPointer<vtkSphereSource>::New();
  bulb->SetThetaResolution(24);
  bulb->SetPhiResolution(16);
  bulb->SetRadius(1);
  auto bulbMapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  bulbMapper->SetInputConnection(bulb->GetOutputPort());
  lamp_ = unlitActor(bulbMapper);
  for (vtkActor* actor : {dome_.Get(), ball_.Get(), lamp_.Get()}) {
    actor->SetVisibility(false);
    renderer()->AddActor(actor);
  }
  applyCamera();
}

bool BrdfSphereCanvas::lit() const {
  return (scene_.lightIrradiance > 0).any();
}

void BrdfSphereCanvas::setMaterial(std::shared_ptr<const TabulatedBrdf> brdf,
                                   std::shared_ptr<const std::vector<float>> posteriorSd, double priorSd) {
  scene_.brdf = std::move(brdf);
  scene_.posteriorSd = std::move(posteriorSd);
  scene_.priorSd = priorSd;
  if (scene_.brdf) return wish();
  worker_->abandon();
  sphere_ = {};
  ball_->SetVisibility(false);
  dome_->SetVisibility(false);
  placeLamp();
  overlay_->update();
  update();
}

void BrdfSphereCanvas::setEnvironment(const std::string& id, EnvironmentPtr opened) {
  scene_.environmentId = id;
  scene_.environment = id == "file" ? std::move(opened) : nullptr;
  wish();
}

void BrdfSphereCanvas::setLight(const Eigen::Array3f& irradiance) {
  scene_.lightIrradiance = irradiance;
  placeLamp();
  wish();
}

void BrdfSphereCanvas::setLook(const SphereLook& look) {
  if (look == look_) return;
  look_ = look;
  wish();
}

void BrdfSphereCanvas::setSurround(bool shown) {
  surround_ = shown;
  dome_->SetVisibility(surround_ && scene_.brdf && !scene_.environmentId.empty() &&
                       !sphere_.picture.isNull());
  update();
}

void BrdfSphereCanvas::setToLight(const Eigen::Vector3f& toLight) {
  if (toLight.norm() < 1e-6f) return;
  scene_.toLight = toLight.normalized();
  placeLamp();
  wish();
  Q_EMIT toLightChanged();
}

void BrdfSphereCanvas::resetView() {
  scene_.yawRad = scene_.pitchRad = 0;
  zoom_ = 1;
  pan_ = {};
  applyCamera();
  turn(0, 0);
  setToLight(kStartToLight);
}

int BrdfSphereCanvas::wantedSize() const {
  const double pixels = height() * devicePixelRatioF() / halfHeight() / (2 * kMeasuredSphereRadius);
  // In steps, so that a slow resize does not begin anew at every pixel.
  return std::clamp(static_cast<int>(std::ceil(pixels / 32)) * 32, kLeastSize, kMostSize);
}

void BrdfSphereCanvas::wish() {
  if (!scene_.brdf) return;
  scene_.size = wantedSize();
  wanted_ = worker_->request(scene_, look_);
  overlay_->update();
}

void BrdfSphereCanvas::show(const ShownSphere& sphere) {
  if (!scene_.brdf || sphere.request < sphere_.request) return;
  sphere_ = sphere;
  copyInto(ballPixels_, sphere.picture);
  ballTexture_->Modified();
  ball_->SetVisibility(true);
  if (!sphere.backdrop.isNull()) {
    copyInto(domePixels_, sphere.backdrop);
    domeTexture_->Modified();
  }
  setSurround(surround_);
  placeLamp();
  overlay_->update();
  update();
  if (finest()) Q_EMIT rendered();
}

double BrdfSphereCanvas::halfHeight() const {
  const double narrow = width() > 0 ? std::max(1.0, static_cast<double>(height()) / width()) : 1.0;
  return kMargin * narrow / zoom_;
}

void BrdfSphereCanvas::applyCamera() {
  const double distance = halfHeight() / std::tan(kViewAngleDeg * std::numbers::pi / 360);
  vtkCamera* camera = renderer()->GetActiveCamera();
  camera->SetPosition(pan_.x(), pan_.y(), distance);
  camera->SetFocalPoint(pan_.x(), pan_.y(), 0);
  camera->SetViewUp(0, 1, 0);
  camera->SetClippingRange(0.05, 400);
  placeLamp();
  overlay_->update();
  update();
}

void BrdfSphereCanvas::placeLamp() {
  lamp_->SetVisibility(lit() && scene_.brdf != nullptr);
  const QPointF at = lampOnSphere();
  // In front of the sphere or behind it, but flat: perspective would carry it away from the cursor.
  lamp_->SetPosition(at.x(), at.y(), scene_.toLight.z() >= 0 ? 0.03 : -0.03);
  const double radius = 6.5 * 2 * halfHeight() / std::max(1, height());
  lamp_->SetScale(radius, radius, 0.001);
  const float most = std::max(1e-6f, scene_.lightIrradiance.maxCoeff());
  const Eigen::Array3f colour = (scene_.lightIrradiance / most).max(0.0f).sqrt();
  lamp_->GetProperty()->SetColor(colour[0], colour[1], colour[2]);
  update();
}

QPointF BrdfSphereCanvas::lampOnSphere() const {
  return {kLampDistance * scene_.toLight.x(), kLampDistance * scene_.toLight.y()};
}

QPointF BrdfSphereCanvas::widgetFromSphere(const QPointF& place) const {
  const double scale = height() / (2 * halfHeight());
  return {width() / 2.0 + (place.x() - pan_.x()) * scale, height() / 2.0 - (place.y() - pan_.y()) * scale};
}

QPointF BrdfSphereCanvas::sphereFromWidget(const QPointF& position) const {
  const double scale = height() / (2 * halfHeight());
  return {(position.x() - width() / 2.0) / scale + pan_.x(),
          (height() / 2.0 - position.y()) / scale + pan_.y()};
}

bool BrdfSphereCanvas::overLamp(const QPointF& position) const {
  if (!lit() || !scene_.brdf) return false;
  const QPointF away = widgetFromSphere(lampOnSphere()) - position;
  return std::hypot(away.x(), away.y()) < kLampGrabPx;
}

void BrdfSphereCanvas::turn(float yaw, float pitch) {
  scene_.yawRad = std::remainder(scene_.yawRad + yaw, 2 * std::numbers::pi_v<float>);
  scene_.pitchRad = std::clamp(scene_.pitchRad + pitch, -kMostPitchRad, kMostPitchRad);
  // The surroundings turn at once, their picture on the sphere follows.
  const Eigen::Matrix3f viewFromEnvironment = environmentFromView(scene_.yawRad, scene_.pitchRad).transpose();
  auto matrix = vtkSmartPointer<vtkMatrix4x4>::New();
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column)
      matrix->SetElement(row, column, viewFromEnvironment(row, column));
  dome_->SetUserMatrix(matrix);
  wish();
  update();
}

void BrdfSphereCanvas::aim(const QPointF& position) {
  if (!lit()) return;
  const QPointF place = sphereFromWidget(position);
  // The highlight goes to the cursor: the light is where the surface there mirrors the eye.
  Eigen::Vector2f at(place.x(), place.y());
  if (at.norm() > 0.98f) at *= 0.98f / at.norm();
  const Eigen::Vector3f normal(at.x(), at.y(), std::sqrt(1 - at.squaredNorm()));
  setToLight(2 * normal.z() * normal - Eigen::Vector3f::UnitZ());
}

void BrdfSphereCanvas::paintOver(QPainter& painter) const {
  painter.setFont(theme::captionFont());
  if (!usable() || !scene_.brdf) {
    painter.setRenderHint(QPainter::Antialiasing);
    if (usable()) {
      const double radius = std::min(width(), height()) / (2 * kMargin);
      painter.setPen(QPen(theme::kBorder, 1.2, Qt::DashLine));
      painter.drawEllipse(QPointF(width() / 2.0, height() / 2.0), radius, radius);
    }
    painter.setPen(theme::kTextDim);
    painter.drawText(rect().adjusted(24, 8, -24, -8), Qt::AlignCenter | Qt::TextWordWrap,
                     !usable() ? failure() : tr("A sphere of the reconstructed material appears here"));
    return focusRing_.paint(painter, *this);
  }
  const auto caption = [&](const QString& text, Qt::Alignment where) {
    if (text.isEmpty()) return;
    const QRect area = rect().adjusted(8, 6, -8, -6);
    const QFontMetrics metrics(painter.font());
    const QString shown = metrics.elidedText(text, Qt::ElideRight, area.width() - 12);
    QRect box(0, 0, metrics.horizontalAdvance(shown) + 12, metrics.height() + 4);
    box.moveTop(where & Qt::AlignBottom ? area.bottom() - box.height() : area.top());
    box.moveLeft(where & Qt::AlignRight ? area.right() - box.width() : area.left());
    painter.setPen(Qt::NoPen);
    painter.setBrush(QColor(20, 20, 20, 150));
    painter.setRenderHint(QPainter::Antialiasing);
    painter.drawRoundedRect(box, 4, 4);
    painter.setPen(QColor(225, 225, 225));
    painter.drawText(box, Qt::AlignCenter, shown);
  };
  if (scene_.environmentId.empty() && !lit())
    caption(tr("No light: choose a room, or switch the light on"), Qt::AlignTop | Qt::AlignLeft);
  if (look_.certainty && sphere_.certainty && hover_) {
    const QPointF place = sphereFromWidget(*hover_);
    const int size = sphere_.certainty->width();
    const int x = static_cast<int>(std::floor((0.5 + place.x() * kMeasuredSphereRadius) * size)),
              y = static_cast<int>(std::floor((0.5 - place.y() * kMeasuredSphereRadius) * size));
    if (std::hypot(place.x(), place.y()) < 1 && x >= 0 && y >= 0 && x < size && y < size) {
      const float sd = sphere_.certainty->at(x, y);
      caption(sd < 0 ? tr("no light here") : tr("here: %1").arg(certaintyText(sd)),
              Qt::AlignTop | Qt::AlignLeft);
    }
  }
  if (width() > 240 && (hover_ || focusRing_.shown()) && drag_ == Drag::None)
    caption(scene_.environmentId.empty() ? tr("drag: highlight \u00b7 wheel: zoom")
            : lit()                      ? tr("drag: turn \u00b7 right drag: highlight \u00b7 wheel: zoom")
                                         : tr("drag: turn \u00b7 wheel: zoom"),
            Qt::AlignBottom | Qt::AlignLeft);
  focusRing_.paint(painter, *this);
}

void BrdfSphereCanvas::resizeEvent(QResizeEvent* event) {
  VtkWidget::resizeEvent(event);
  overlay_->setGeometry(rect());
  applyCamera();
  settle_.start();
}

void BrdfSphereCanvas::mousePressEvent(QMouseEvent* event) {
  last_ = event->position();
  if (!scene_.brdf) return;
  const bool shift = event->modifiers() & Qt::ShiftModifier;
  if (event->button() == Qt::MiddleButton)
    drag_ = Drag::Pan;
  else if (event->button() == Qt::LeftButton && !shift && overLamp(event->position())) {
    drag_ = Drag::Lamp;
    grabbed_ = lampOnSphere() - sphereFromWidget(event->position());
  } else if (event->button() == Qt::RightButton || (event->button() == Qt::LeftButton && shift) ||
             (event->button() == Qt::LeftButton && scene_.environmentId.empty())) {
    drag_ = lit() ? Drag::Highlight : Drag::None;
    aim(event->position());
  } else if (event->button() == Qt::LeftButton) {
    drag_ = Drag::Turn;
    const QPointF place = sphereFromWidget(event->position());
    turnGain_ = std::hypot(place.x(), place.y()) < 1 ? -1.6 : 0.6;
  }
  if (drag_ != Drag::None) setCursor(Qt::ClosedHandCursor);
  overlay_->update();
}

void BrdfSphereCanvas::mouseMoveEvent(QMouseEvent* event) {
  const QPointF moved = event->position() - last_;
  last_ = event->position();
  hover_ = event->position();
  const double scale = height() / (2 * halfHeight());
  switch (drag_) {
    case Drag::None:
      setCursor(overLamp(event->position()) ? Qt::SizeAllCursor : Qt::OpenHandCursor);
      overlay_->update();
      break;
    case Drag::Turn:
      // What was taken follows the cursor: the reflections on the sphere (a mirror's move twice as fast as
      // the room turns), or, beside it, what is seen behind.
      turn(static_cast<float>(turnGain_ * moved.x() / scale),
           static_cast<float>(turnGain_ * moved.y() / scale));
      break;
    case Drag::Highlight:
      aim(event->position());
      break;
    case Drag::Lamp: {
      const QPointF place = (sphereFromWidget(event->position()) + grabbed_) / kLampDistance;
      const double far = std::hypot(place.x(), place.y());
      // Beyond the rim it goes on behind the sphere, back towards the middle.
      const double r = std::clamp(far <= 1 ? far : 2 - far, 0.0, 1.0);
      const double z = (far <= 1 ? 1 : -1) * std::sqrt(1 - r * r);
      if (far > 1e-6)
        setToLight(Eigen::Vector3d(place.x() / far * r, place.y() / far * r, z).cast<float>());
      else
        setToLight(Eigen::Vector3f::UnitZ());
      break;
    }
    case Drag::Pan:
      pan_ -= QPointF(moved.x(), -moved.y()) / scale;
      pan_ = {std::clamp(pan_.x(), -1.0, 1.0), std::clamp(pan_.y(), -1.0, 1.0)};
      applyCamera();
      break;
  }
}

void BrdfSphereCanvas::mouseReleaseEvent(QMouseEvent* event) {
  drag_ = Drag::None;
  setCursor(overLamp(event->position()) ? Qt::SizeAllCursor : Qt::OpenHandCursor);
  overlay_->update();
}

void BrdfSphereCanvas::mouseDoubleClickEvent(QMouseEvent*) {
  drag_ = Drag::None;
  resetView();
}

void BrdfSphereCanvas::leaveEvent(QEvent*) {
  hover_.reset();
  overlay_->update();
}

void BrdfSphereCanvas::wheelEvent(QWheelEvent* event) {
  zoom_ = std::clamp(zoom_ * std::pow(1.15, event->angleDelta().y() / 120.0), kLeastZoom, kMostZoom);
  applyCamera();
  settle_.start();
  event->accept();
}

void BrdfSphereCanvas::keyPressEvent(QKeyEvent* event) {
  const bool light = (event->modifiers() & Qt::ShiftModifier) || scene_.environmentId.empty();
  float x = 0, y = 0;
  switch (event->key()) {
    case Qt::Key_Left:
      x = -1;
      break;
    case Qt::Key_Right:
      x = 1;
      break;
    case Qt::Key_Up:
      y = 1;
      break;
    case Qt::Key_Down:
      y = -1;
      break;
    case Qt::Key_Plus:
    case Qt::Key_Equal:
    case Qt::Key_Minus:
      zoom_ = std::clamp(zoom_ * (event->key() == Qt::Key_Minus ? 1 / 1.15 : 1.15), kLeastZoom, kMostZoom);
      applyCamera();
      return settle_.start();
    case Qt::Key_Home:
      return resetView();
    default:
      return VtkWidget::keyPressEvent(event);
  }
  if (!scene_.brdf) return;
  if (!light) return turn(-0.12f * x, 0.12f * y);
  if (lit())
    setToLight(Eigen::AngleAxisf(0.1f * x, Eigen::Vector3f::UnitY()) *
               (Eigen::AngleAxisf(-0.1f * y, Eigen::Vector3f::UnitX()) * scene_.toLight));
}

void BrdfSphereCanvas::focusInEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  overlay_->update();
}

void BrdfSphereCanvas::focusOutEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  overlay_->update();
}

}  // namespace patina
