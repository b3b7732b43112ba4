#include "widgets/sheet_viewport.h"

#include <vtkActor.h>
#include <vtkCamera.h>
#include <vtkCellArray.h>
#include <vtkImageData.h>
#include <vtkLineSource.h>
#include <vtkPlaneSource.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderer.h>
#include <vtkSphereSource.h>
#include <vtkTexture.h>

#include <Eigen/Dense>
#include <QElapsedTimer>
#include <QKeyEvent>
#include <QWheelEvent>
#include <numbers>

#include "engine/render/tone_map.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr double kViewAngleDeg = 30;
constexpr double kBudgetMs = 30;  ///< of one shading while something moves
constexpr int kRefineMs = 120;    ///< after the last movement the exact picture follows
constexpr double kLeastElevationRad = 0.08;
constexpr double kLampGrabPx = 16;
constexpr double kReferenceDistance =
    0.6;  ///< of the sheet's side: a white matt sheet so far below the lamp is just white
constexpr double kStartingHeight = 0.42;   ///< of the sheet's side
constexpr double kStartingDistance = 2.4;  ///< of the sheet's side

vtkSmartPointer<vtkActor> flatActor(vtkPolyDataMapper* mapper, double r, double g, double b) {
  auto actor = vtkSmartPointer<vtkActor>::New();
  actor->SetMapper(mapper);
  actor->GetProperty()->SetLighting(false);
  actor->GetProperty()->SetColor(r, g, b);
  return actor;
}

vtkSmartPointer<vtkPolyData> closedLine(const std::vector<Eigen::Vector3d>& corners) {
  auto points = vtkSmartPointer<vtkPoints>::New();
  auto cells = vtkSmartPointer<vtkCellArray>::New();
  cells->InsertNextCell(static_cast<vtkIdType>(corners.size() + 1));
  for (const auto& corner : corners)
    cells->InsertCellPoint(points->InsertNextPoint(corner.x(), corner.y(), corner.z()));
  cells->InsertCellPoint(0);
  auto line = vtkSmartPointer<vtkPolyData>::New();
  line->SetPoints(points);
  line->SetLines(cells);
  return line;
}

}  // namespace

/// What is written over the scene. A widget of its own, because VTK's state of OpenGL is not one that
/// QPainter can draw in.
class SheetViewport::Overlay : public QWidget {
 public:
  explicit Overlay(SheetViewport* of) : QWidget(of), of_(of) {
    setAttribute(Qt::WA_TransparentForMouseEvents);
  }

 protected:
  void paintEvent(QPaintEvent*) override {
    QPainter painter(this);
    of_->paintOver(painter);
  }

 private:
  SheetViewport* of_;
};

SheetViewport::SheetViewport(Document* document, QWidget* parent) : VtkWidget(parent), document_(document) {
  setObjectName(QStringLiteral("sheetViewport"));
  overlay_ = new Overlay(this);
  connect(this, &VtkWidget::becameUnusable, overlay_, [this] { overlay_->update(); });
  setFocusPolicy(Qt::StrongFocus);
  setMouseTracking(true);
  setAccessibleName(tr("The fitted sheet under a light"));
  setToolTip(tr(
      "Drag: move the highlight, or the lamp by its handle (Shift: its height). Right drag: orbit. Middle "
      "drag: pan.\n"
      "Wheel: distance. Click: pick a texel. Keys: arrows move the lamp, Page Up and Page Down its height."));
  refine_.setSingleShot(true);
  refine_.setInterval(kRefineMs);
  connect(&refine_, &QTimer::timeout, this, [this] {
    if (shadingStep_ > 1) shade(true);
  });
  gesture_.setSingleShot(true);
  gesture_.setInterval(700);
  connect(&gesture_, &QTimer::timeout, document_, &Document::endGesture);

  renderer()->SetBackground(0.145, 0.145, 0.145);
  renderer()->GetActiveCamera()->SetViewAngle(kViewAngleDeg);

  plane_ = vtkSmartPointer<vtkPlaneSource>::New();
  auto planeMapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  planeMapper->SetInputConnection(plane_->GetOutputPort());
  sheet_ = flatActor(planeMapper, 1, 1, 1);
  pixels_ = vtkSmartPointer<vtkImageData>::New();
  texture_ = vtkSmartPointer<vtkTexture>::New();
  texture_->SetInputData(pixels_);
  texture_->InterpolateOn();
  texture_->RepeatOff();
  texture_->EdgeClampOn();
  sheet_->SetTexture(texture_);

  auto bulb = vtkSmartPointer<vtkSphereSource>::New();
  bulb->SetThetaResolution(24);
  bulb->SetPhiResolution(16);
  bulb->SetRadius(1);
  auto bulbMapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  bulbMapper->SetInputConnection(bulb->GetOutputPort());
  lamp_ = flatActor(bulbMapper, 1.0, 1.0, 0.93);
  drop_ = vtkSmartPointer<vtkLineSource>::New();
  auto dropMapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  dropMapper->SetInputConnection(drop_->GetOutputPort());
  dropActor_ = flatActor(dropMapper, 0.5, 0.5, 0.47);
  frame_ = vtkSmartPointer<vtkPolyData>::New();
  auto frameMapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  frameMapper->SetInputData(frame_);
  frameActor_ = flatActor(frameMapper, 0.4, 0.4, 0.4);
  mark_ = vtkSmartPointer<vtkPolyData>::New();
  auto markMapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  markMapper->SetInputData(mark_);
  markActor_ = flatActor(markMapper, 1, 1, 1);
  for (vtkActor* actor : {sheet_.Get(), frameActor_.Get(), markActor_.Get(), dropActor_.Get(), lamp_.Get()}) {
    actor->SetVisibility(false);
    renderer()->AddActor(actor);
  }

  connect(document_, &Document::fitChanged, this, &SheetViewport::rebuild);
  connect(document_, &Document::captureChanged, this, [this] { placed_ = false; });
  connect(document_, &Document::lampChanged, this, [this] {
    placeScene();
    shade(false);
  });
  connect(document_, &Document::pickChanged, this, [this] {
    placeScene();
    update();
  });
}

SheetViewport::~SheetViewport() = default;

double SheetViewport::sizeMm() const {
  return fit_ ? std::max(fit_->maps().widthMm, fit_->maps().heightMm) : 120;
}

void SheetViewport::rebuild() {
  fit_ = document_->fit();
  overlay_->update();
  const bool shown = fit_ != nullptr;
  for (vtkActor* actor : {sheet_.Get(), frameActor_.Get(), markActor_.Get(), dropActor_.Get(), lamp_.Get()})
    actor->SetVisibility(shown);
  if (!shown) return update();
  const SvbrdfMaps& maps = fit_->maps();
  const double x = maps.widthMm / 2, y = maps.heightMm / 2;
  plane_->SetOrigin(-x, -y, 0);
  plane_->SetPoint1(x, -y, 0);
  plane_->SetPoint2(-x, y, 0);
  const double lift = -0.002 * sizeMm();
  const double rim = 1.006;  // beside the sheet, not under it
  frame_->ShallowCopy(closedLine({{-rim * x, -rim * y, lift},
                                  {rim * x, -rim * y, lift},
                                  {rim * x, rim * y, lift},
                                  {-rim * x, rim * y, lift}}));
  pixels_->SetDimensions(maps.width, maps.height, 1);
  pixels_->AllocateScalars(VTK_UNSIGNED_CHAR, 3);
  if (!placed_) {
    placed_ = true;
    document_->restoreLamp(startingLamp());
    viewFromCamera();
  } else {
    placeScene();
    shade(true);
  }
}

void SheetViewport::viewFromCamera() {
  if (!fit_) return;
  const Eigen::Vector3d eye = fit_->capture().camera.positionMm();
  azimuthRad_ = std::atan2(eye.y(), eye.x());
  elevationRad_ = std::clamp(std::atan2(eye.z(), std::hypot(eye.x(), eye.y())), kLeastElevationRad,
                             std::numbers::pi / 2 - 0.001);
  focusMm_ = {0, 0, 0.12 * sizeMm()};  // room for the lamp
  distanceMm_ = kStartingDistance * sizeMm();
  applyCamera();
}

void SheetViewport::viewFromAbove() {
  azimuthRad_ = -std::numbers::pi / 2;
  elevationRad_ = std::numbers::pi / 2 - 0.001;
  focusMm_.setZero();
  distanceMm_ = kStartingDistance * sizeMm();
  applyCamera();
}

void SheetViewport::resetLamp() {
  document_->endGesture();
  document_->setLamp(startingLamp());
  document_->endGesture();
}

LampState SheetViewport::startingLamp() const {
  LampState lamp = document_->lamp();
  if (!fit_) return lamp;
  const Eigen::Vector3d eye = fit_->capture().camera.positionMm();
  const double height = kStartingHeight * sizeMm(), rise = std::max(eye.z(), 0.3 * eye.norm());
  lamp.positionMm = {-eye.x() * height / rise, -eye.y() * height / rise, height};
  return lamp;
}

Eigen::Vector3d SheetViewport::eyeMm() const {
  return focusMm_ + distanceMm_ * Eigen::Vector3d(std::cos(elevationRad_) * std::cos(azimuthRad_),
                                                  std::cos(elevationRad_) * std::sin(azimuthRad_),
                                                  std::sin(elevationRad_));
}

void SheetViewport::applyCamera() {
  vtkCamera* camera = renderer()->GetActiveCamera();
  const Eigen::Vector3d eye = eyeMm();
  camera->SetPosition(eye.x(), eye.y(), eye.z());
  camera->SetFocalPoint(focusMm_.x(), focusMm_.y(), focusMm_.z());
  camera->SetViewUp(-std::cos(azimuthRad_) * std::sin(elevationRad_),
                    -std::sin(azimuthRad_) * std::sin(elevationRad_), std::cos(elevationRad_));
  camera->SetClippingRange(0.02 * distanceMm_, distanceMm_ + 20 * sizeMm());
  placeScene();
  shade(false);
}

void SheetViewport::placeScene() {
  if (!fit_) return;
  const Eigen::Vector3d lamp = document_->lamp().positionMm;
  const double radius = 0.016 * (eyeMm() - lamp).norm();
  lamp_->SetPosition(lamp.x(), lamp.y(), lamp.z());
  lamp_->SetScale(radius);
  drop_->SetPoint1(lamp.x(), lamp.y(), 0);
  drop_->SetPoint2(lamp.x(), lamp.y(), lamp.z() - radius);
  const auto picked = document_->pickedTexel();
  markActor_->SetVisibility(picked.has_value());
  if (picked) {
    const SvbrdfMaps& maps = fit_->maps();
    const double x = ((picked->x() + 0.5) / maps.width - 0.5) * maps.widthMm;
    const double y = (0.5 - (picked->y() + 0.5) / maps.height) * maps.heightMm;
    const double half = std::max(0.5 * maps.widthMm / maps.width, 0.008 * sizeMm()), lift = 0.002 * sizeMm();
    mark_->ShallowCopy(closedLine({{x - half, y - half, lift},
                                   {x + half, y - half, lift},
                                   {x + half, y + half, lift},
                                   {x - half, y + half, lift}}));
  }
}

void SheetViewport::shade(bool exact) {
  if (!fit_) return update();
  const SvbrdfMaps& maps = fit_->maps();
  SheetLighting lighting;
  lighting.lightMm = document_->lamp().positionMm;
  lighting.eyeMm = eyeMm();
  lighting.referenceDistanceMm = kReferenceDistance * sizeMm();
  int step = 1;
  if (!exact && shadingMs_ > 0)  // what one exact shading would take, from the last
    while (shadingMs_ * shadingStep_ * shadingStep_ / (step * step) > kBudgetMs && step < 16) step *= 2;
  QElapsedTimer timer;
  timer.start();
  shadeSheet(maps, lighting, step, radiance_);
  const Image shown =
      toneMap(radiance_, static_cast<float>(std::exp2(document_->lamp().exposureEv)), Highlights::Shoulder);
  shadingMs_ = std::max(0.01, timer.nsecsElapsed() * 1e-6);
  shadingStep_ = step;
  auto* bytes = static_cast<std::uint8_t*>(pixels_->GetScalarPointer());
  const std::size_t line = static_cast<std::size_t>(maps.width) * 3;
  for (int row = 0; row < maps.height; ++row) {  // textures begin at the bottom
    const auto from = shown.samples().subspan(line * (maps.height - 1 - row), line);
    std::transform(from.begin(), from.end(), bytes + line * row,
                   [](float value) { return static_cast<std::uint8_t>(value * 255.0f + 0.5f); });
  }
  pixels_->Modified();
  texture_->Modified();
  if (step > 1) refine_.start();
  update();
}

void SheetViewport::paintOver(QPainter& painter) const {
  if (!usable() || !fit_) {
    painter.setPen(theme::kTextDim);
    painter.drawText(
        rect().adjusted(24, 8, -24, -8), Qt::AlignCenter | Qt::TextWordWrap,
        !usable() ? failure() : tr("The fitted sheet appears here, under a light that you can drag."));
  } else if (width() > 260) {
    painter.setFont(theme::captionFont());
    painter.setPen(QColor(255, 255, 255, 120));
    painter.drawText(
        rect().adjusted(10, 6, -10, -6), Qt::AlignLeft | Qt::AlignBottom,
        fontMetrics().elidedText(tr("drag: highlight or lamp \u00b7 right drag: orbit \u00b7 click: pick"),
                                 Qt::ElideRight, width()));
  }
  focusRing_.paint(painter, *this);
}

void SheetViewport::resizeEvent(QResizeEvent* event) {
  VtkWidget::resizeEvent(event);
  overlay_->setGeometry(rect());
}

void SheetViewport::focusInEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  overlay_->update();
}

void SheetViewport::focusOutEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  overlay_->update();
}

Eigen::Vector3d SheetViewport::rayThrough(const QPointF& position) const {
  const Eigen::Vector3d forward = (focusMm_ - eyeMm()).normalized();
  const Eigen::Vector3d up(-std::cos(azimuthRad_) * std::sin(elevationRad_),
                           -std::sin(azimuthRad_) * std::sin(elevationRad_), std::cos(elevationRad_));
  const Eigen::Vector3d right = forward.cross(up);
  const double scale = 2 * std::tan(kViewAngleDeg * std::numbers::pi / 360) / std::max(1, height());
  return (forward + right * (position.x() - width() / 2.0) * scale -
          up * (position.y() - height() / 2.0) * scale)
      .normalized();
}

QPointF SheetViewport::widgetFromWorld(const Eigen::Vector3d& pointMm) const {
  const Eigen::Vector3d forward = (focusMm_ - eyeMm()).normalized();
  const Eigen::Vector3d up(-std::cos(azimuthRad_) * std::sin(elevationRad_),
                           -std::sin(azimuthRad_) * std::sin(elevationRad_), std::cos(elevationRad_));
  const Eigen::Vector3d right = forward.cross(up), away = pointMm - eyeMm();
  const double scale = 2 * std::tan(kViewAngleDeg * std::numbers::pi / 360) / std::max(1, height());
  const double depth = std::max(1e-6, away.dot(forward));
  return {width() / 2.0 + away.dot(right) / depth / scale, height() / 2.0 - away.dot(up) / depth / scale};
}

std::optional<Eigen::Vector3d> SheetViewport::planePoint(const QPointF& position, double heightMm) const {
  const Eigen::Vector3d ray = rayThrough(position), eye = eyeMm();
  if (std::abs(ray.z()) < 1e-6) return std::nullopt;
  const double along = (heightMm - eye.z()) / ray.z();
  if (along <= 0) return std::nullopt;
  return eye + along * ray;
}

bool SheetViewport::overLamp(const QPointF& position) const {
  if (!fit_) return false;
  const QPointF away = widgetFromWorld(document_->lamp().positionMm) - position;
  return std::hypot(away.x(), away.y()) < kLampGrabPx;
}

void SheetViewport::moveLamp(const Eigen::Vector3d& positionMm) {
  LampState lamp = document_->lamp();
  const double reach = 6 * sizeMm();
  lamp.positionMm = {std::clamp(positionMm.x(), -reach, reach), std::clamp(positionMm.y(), -reach, reach),
                     std::clamp(positionMm.z(), 0.05 * sizeMm(), reach)};
  document_->setLamp(lamp);
}

void SheetViewport::mousePressEvent(QMouseEvent* event) {
  pressed_ = last_ = event->position();
  if (!fit_) return;
  document_->endGesture();
  if (event->button() == Qt::RightButton) {
    drag_ = Drag::Orbit;
  } else if (event->button() == Qt::MiddleButton) {
    drag_ = Drag::Pan;
  } else if (event->button() == Qt::LeftButton) {
    if (event->modifiers() & Qt::ShiftModifier) {
      drag_ = Drag::Height;
    } else if (overLamp(event->position())) {
      drag_ = Drag::Lamp;
      const auto at = planePoint(event->position(), document_->lamp().positionMm.z());
      grabbedMm_ = at ? Eigen::Vector3d(document_->lamp().positionMm - *at) : Eigen::Vector3d::Zero();
    } else {
      drag_ = Drag::Undecided;
    }
  }
}

void SheetViewport::mouseMoveEvent(QMouseEvent* event) {
  const QPointF moved = event->position() - last_;
  last_ = event->position();
  if (drag_ == Drag::None) {
    setCursor(overLamp(event->position()) ? Qt::SizeAllCursor : Qt::ArrowCursor);
    return;
  }
  if (drag_ == Drag::Undecided && (event->position() - pressed_).manhattanLength() > 4)
    drag_ = Drag::Highlight;
  const Eigen::Vector3d lamp = document_->lamp().positionMm;
  switch (drag_) {
    case Drag::Highlight:
      if (const auto point = planePoint(event->position(), 0)) {
        // The lamp goes where a mirror at this point would show it, at its height.
        const Eigen::Vector3d toEye = (eyeMm() - *point).normalized();
        const double rise = std::max(0.15, toEye.z());
        moveLamp(
            {point->x() - toEye.x() / rise * lamp.z(), point->y() - toEye.y() / rise * lamp.z(), lamp.z()});
      }
      break;
    case Drag::Lamp:
      if (const auto at = planePoint(event->position(), lamp.z()))
        moveLamp({at->x() + grabbedMm_.x(), at->y() + grabbedMm_.y(), lamp.z()});
      break;
    case Drag::Height:
      moveLamp({lamp.x(), lamp.y(), lamp.z() * std::exp(-moved.y() * 0.01)});
      break;
    case Drag::Orbit:
      azimuthRad_ -= moved.x() * 0.008;
      elevationRad_ =
          std::clamp(elevationRad_ + moved.y() * 0.008, kLeastElevationRad, std::numbers::pi / 2 - 0.001);
      applyCamera();
      break;
    case Drag::Pan: {
      const Eigen::Vector3d forward = (focusMm_ - eyeMm()).normalized();
      const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitZ()).normalized(),
                            ahead = Eigen::Vector3d::UnitZ().cross(right);
      const double scale =
          2 * distanceMm_ * std::tan(kViewAngleDeg * std::numbers::pi / 360) / std::max(1, height());
      focusMm_ += -right * moved.x() * scale + ahead * moved.y() * scale;
      const double reach = 2 * sizeMm();
      focusMm_ = focusMm_.cwiseMax(-reach).cwiseMin(reach);
      applyCamera();
      break;
    }
    default:
      break;
  }
}

void SheetViewport::mouseReleaseEvent(QMouseEvent* event) {
  const Drag drag = drag_;
  drag_ = Drag::None;
  if (drag == Drag::Undecided && fit_) {
    const SvbrdfMaps& maps = fit_->maps();
    if (const auto point = planePoint(event->position(), 0)) {
      const QPoint texel(static_cast<int>(std::floor((point->x() / maps.widthMm + 0.5) * maps.width)),
                         static_cast<int>(std::floor((0.5 - point->y() / maps.heightMm) * maps.height)));
      if (QRect(0, 0, maps.width, maps.height).contains(texel)) document_->pickTexel(texel);
    }
  }
  document_->endGesture();
  if (shadingStep_ > 1) refine_.start();
}

void SheetViewport::wheelEvent(QWheelEvent* event) {
  if (!fit_) return;
  const double notches = event->angleDelta().y() / 120.0;
  if (event->modifiers() & Qt::ControlModifier) {
    const Eigen::Vector3d lamp = document_->lamp().positionMm;
    gesture_.start();
    moveLamp({lamp.x(), lamp.y(), lamp.z() * std::pow(1.1, notches)});
  } else {
    distanceMm_ = std::clamp(distanceMm_ * std::pow(0.88, notches), 0.3 * sizeMm(), 12 * sizeMm());
    applyCamera();
  }
  event->accept();
}

void SheetViewport::keyPressEvent(QKeyEvent* event) {
  const Eigen::Vector3d lamp = document_->lamp().positionMm;
  const double step = 0.05 * sizeMm();
  const bool orbit = event->modifiers() & Qt::ShiftModifier;
  double turn = 0, rise = 0;
  Eigen::Vector3d move = Eigen::Vector3d::Zero();
  switch (event->key()) {
    case Qt::Key_Left:
      orbit ? turn = -0.08 : move.x() = -step;
      break;
    case Qt::Key_Right:
      orbit ? turn = 0.08 : move.x() = step;
      break;
    case Qt::Key_Up:
      orbit ? rise = 0.08 : move.y() = step;
      break;
    case Qt::Key_Down:
      orbit ? rise = -0.08 : move.y() = -step;
      break;
    case Qt::Key_PageUp:
      move.z() = step;
      break;
    case Qt::Key_PageDown:
      move.z() = -step;
      break;
    case Qt::Key_Plus:
    case Qt::Key_Equal:
      distanceMm_ = std::max(distanceMm_ * 0.88, 0.3 * sizeMm());
      return applyCamera();
    case Qt::Key_Minus:
      distanceMm_ = std::min(distanceMm_ / 0.88, 12 * sizeMm());
      return applyCamera();
    case Qt::Key_C:
      return viewFromCamera();
    case Qt::Key_T:
      return viewFromAbove();
    default:
      return VtkWidget::keyPressEvent(event);
  }
  if (!fit_) return;
  if (turn != 0 || rise != 0) {
    azimuthRad_ += turn;
    elevationRad_ = std::clamp(elevationRad_ + rise, kLeastElevationRad, std::numbers::pi / 2 - 0.001);
    return applyCamera();
  }
  gesture_.start();
  moveLamp(lamp + move);
}

}  // namespace patina
