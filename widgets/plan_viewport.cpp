#include "widgets/plan_viewport.h"

#include <vtkActor.h>
#include <vtkCamera.h>
#include <vtkCellArray.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderer.h>
#include <vtkTubeFilter.h>

#include <Eigen/Dense>
#include <QKeyEvent>
#include <QWheelEvent>
#include <numbers>

#include "widgets/theme.h"

namespace patina {

namespace {

constexpr double kRad = std::numbers::pi / 180;
constexpr double kViewAngleDeg = 30;
constexpr double kStartAzimuthRad = -65 * kRad, kStartElevationRad = 28 * kRad, kStartDistance = 4.1;
constexpr double kLeastElevationRad = -0.1, kMostElevationRad = std::numbers::pi / 2 - 0.001;
constexpr double kLightFrom = 1.32, kLightTo = 0.98;  ///< where an arrow of light begins and ends
constexpr double kFocusHeight = 0.42;
using Line = std::vector<Eigen::Vector3d>;

vtkSmartPointer<vtkPolyData> polyData(const std::vector<Line>& lines) {
  auto points = vtkSmartPointer<vtkPoints>::New();
  auto cells = vtkSmartPointer<vtkCellArray>::New();
  for (const Line& line : lines) {
    cells->InsertNextCell(static_cast<vtkIdType>(line.size()));
    for (const auto& point : line)
      cells->InsertCellPoint(points->InsertNextPoint(point.x(), point.y(), point.z()));
  }
  auto data = vtkSmartPointer<vtkPolyData>::New();
  data->SetPoints(points);
  data->SetLines(cells);
  return data;
}

/// Faces as fans round their first point.
vtkSmartPointer<vtkPolyData> faces(const std::vector<Line>& fans) {
  auto points = vtkSmartPointer<vtkPoints>::New();
  auto cells = vtkSmartPointer<vtkCellArray>::New();
  for (const Line& fan : fans) {
    std::vector<vtkIdType> ids;
    for (const auto& point : fan) ids.push_back(points->InsertNextPoint(point.x(), point.y(), point.z()));
    for (std::size_t i = 1; i + 1 < ids.size(); ++i) {
      const vtkIdType triangle[3] = {ids[0], ids[i], ids[i + 1]};
      cells->InsertNextCell(3, triangle);
    }
  }
  auto data = vtkSmartPointer<vtkPolyData>::New();
  data->SetPoints(points);
  data->SetPolys(cells);
  return data;
}

vtkSmartPointer<vtkActor> flat(vtkPolyDataMapper* mapper, const QColor& colour, double opacity) {
  auto actor = vtkSmartPointer<vtkActor>::New();
  actor->SetMapper(mapper);
  actor->GetProperty()->SetLighting(false);
  actor->GetProperty()->SetColor(colour.redF(), colour.greenF(), colour.blueF());
  actor->GetProperty()->SetOpacity(opacity);
  return actor;
}

/// Lines of a width in the drawing's own units: thick ones by tubes, so that they look alike on every
/// display.
vtkSmartPointer<vtkActor> lineActor(const std::vector<Line>& lines, const QColor& colour, double radius,
                                    double opacity = 1) {
  auto mapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  if (radius > 0) {
    auto tube = vtkSmartPointer<vtkTubeFilter>::New();
    tube->SetInputData(polyData(lines));
    tube->SetRadius(radius);
    tube->SetNumberOfSides(10);
    tube->CappingOn();
    tube->Update();
    mapper->SetInputData(tube->GetOutput());
  } else {
    mapper->SetInputData(polyData(lines));
  }
  return flat(mapper, colour, opacity);
}

vtkSmartPointer<vtkActor> faceActor(const std::vector<Line>& fans, const QColor& colour, double opacity = 1) {
  auto mapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  mapper->SetInputData(faces(fans));
  return flat(mapper, colour, opacity);
}

Eigen::Vector3d onSphere(double zenithRad, double azimuthRad) {
  return {std::sin(zenithRad) * std::cos(azimuthRad), std::sin(zenithRad) * std::sin(azimuthRad),
          std::cos(zenithRad)};
}

Line circle(double radius, double height, int steps = 96) {
  Line line;
  for (int i = 0; i <= steps; ++i) {
    const double angle = 2 * std::numbers::pi * i / steps;
    line.emplace_back(radius * std::cos(angle), radius * std::sin(angle), height);
  }
  return line;
}

/// Two unit vectors across a direction, the first as level as can be.
std::pair<Eigen::Vector3d, Eigen::Vector3d> across(const Eigen::Vector3d& direction) {
  Eigen::Vector3d right = Eigen::Vector3d::UnitZ().cross(direction);
  if (right.norm() < 1e-6) right = Eigen::Vector3d::UnitX();
  right.normalize();
  return {right, direction.cross(right).normalized()};
}

}  // namespace

QColor shotColour(int shot) {
  // Apart for all kinds of colour vision as far as six go (Okabe and Ito's, brightened for a dark ground).
  static const std::array<QColor, 6> kColours{QColor(86, 180, 233),  QColor(240, 168, 30),
                                              QColor(60, 190, 140),  QColor(225, 125, 175),
                                              QColor(240, 228, 100), QColor(230, 110, 50)};
  if (shot < static_cast<int>(kColours.size())) return kColours[static_cast<std::size_t>(shot)];
  return QColor::fromHslF(std::fmod(0.1 + 0.381966 * shot, 1.0), 0.55, 0.65);
}

class PlanViewport::Overlay : public QWidget {
 public:
  explicit Overlay(PlanViewport* of) : QWidget(of), of_(of) {
    setAttribute(Qt::WA_TransparentForMouseEvents);
  }

 protected:
  void paintEvent(QPaintEvent*) override {
    QPainter painter(this);
    of_->paintOver(painter);
  }

 private:
  PlanViewport* of_;
};

PlanViewport::PlanViewport(QWidget* parent)
    : VtkWidget(parent),
      azimuthRad_(kStartAzimuthRad),
      elevationRad_(kStartElevationRad),
      distance_(kStartDistance) {
  setObjectName(QStringLiteral("planViewport"));
  overlay_ = new Overlay(this);
  connect(this, &VtkWidget::becameUnusable, overlay_, [this] { overlay_->update(); });
  setFocusPolicy(Qt::StrongFocus);
  setAccessibleName(tr("Drawing of camera, light and sample"));
  setToolTip(
      tr("Drag or arrow keys: turn. Wheel, + and \u2212: distance. T: from above. S: from the side. 0: as it "
         "was."));
  renderer()->SetBackground(0.145, 0.145, 0.145);
  renderer()->SetUseFXAA(true);
  renderer()->GetActiveCamera()->SetViewAngle(kViewAngleDeg);
  rebuild();
  applyCamera();
}

PlanViewport::~PlanViewport() = default;

void PlanViewport::setShots(std::vector<Shot> shots, double fovDeg) {
  shots_ = std::move(shots);
  fovDeg_ = fovDeg;
  rebuild();
}

void PlanViewport::setHalfVectorsShown(bool shown) {
  halfVectors_ = shown;
  rebuild();
}

void PlanViewport::setEmptyText(const QString& text) {
  emptyText_ = text;
  overlay_->update();
}

void PlanViewport::rebuild() {
  for (const auto& actor : actors_) renderer()->RemoveActor(actor);
  actors_.clear();
  const auto add = [&](vtkSmartPointer<vtkActor> actor) {
    renderer()->AddActor(actor);
    actors_.push_back(std::move(actor));
  };
  // The hemisphere: circles every 15 degrees, meridians every 30; every 30 degrees a little brighter.
  std::vector<Line> minor, major;
  for (int zenith = 15; zenith <= 90; zenith += 15)
    (zenith % 30 == 0 ? major : minor)
        .push_back(circle(std::sin(zenith * kRad), zenith == 90 ? 0 : std::cos(zenith * kRad)));
  for (int azimuth = 0; azimuth < 360; azimuth += 30) {
    Line line;
    for (int zenith = 0; zenith <= 90; zenith += 5) line.push_back(onSphere(zenith * kRad, azimuth * kRad));
    (azimuth % 90 == 0 ? major : minor).push_back(line);
  }
  add(lineActor(minor, QColor(62, 62, 62), 0));
  add(lineActor(major, QColor(92, 92, 92), 0));
  add(lineActor({{Eigen::Vector3d::Zero(), Eigen::Vector3d(0, 0, 1)}}, QColor(92, 92, 92), 0));
  const double radius = std::max(0.03, std::tan(fovDeg_ / 2 * kRad));
  add(faceActor({circle(radius, 0)}, QColor(150, 146, 138)));
  add(lineActor({circle(radius, 0.001)}, QColor(210, 206, 198), 0.004));

  for (const Shot& shot : shots_) {
    const Eigen::Vector3d camera = shot.directions.toCamera, light = shot.directions.toLight;
    const double opacity = shot.faint ? 0.55 : 1, pen = shot.faint ? 0.004 : 0.009;
    {
      // A camera: its body as a pyramid whose base looks at the sample, and the cone of what it sees.
      const auto [right, up] = across(camera);
      const double half = shot.faint ? 0.045 : 0.065, deep = 2.1 * half;
      const Eigen::Vector3d base = camera * (1 - deep);
      Line corners;
      for (const auto& [u, v] : {std::pair(-1, -1), {1, -1}, {1, 1}, {-1, 1}})
        corners.emplace_back(base + right * (u * half) + up * (v * half * 0.75));
      std::vector<Line> edges{{corners[0], corners[1], corners[2], corners[3], corners[0]}};
      for (const auto& corner : corners) edges.push_back({camera, corner});
      add(lineActor(edges, shot.colour, pen, opacity));
      if (!shot.faint) add(faceActor({{corners[0], corners[1], corners[2], corners[3]}}, shot.colour, 0.35));
      std::vector<Line> rays;
      const Eigen::Vector3d side = Eigen::Vector3d(-camera.y(), camera.x(), 0);
      const Eigen::Vector3d level = side.norm() > 1e-6 ? side.normalized() : Eigen::Vector3d::UnitX();
      rays.push_back({camera, level * radius});
      rays.push_back({camera, -level * radius});
      rays.push_back({camera, Eigen::Vector3d::Zero()});
      add(lineActor(rays, shot.colour, 0, shot.faint ? 0.35 : 0.6));
    }
    {
      // An arrow of light, from far to the sample.
      const auto [right, up] = across(light);
      const double head = shot.faint ? 0.03 : 0.045;
      const Eigen::Vector3d neck = light * (kLightTo + 2.4 * head);
      add(lineActor({{light * kLightFrom, neck}}, shot.colour, 1.3 * pen, opacity));
      Line cone{light * kLightTo};
      for (int i = 0; i <= 20; ++i) {
        const double angle = 2 * std::numbers::pi * i / 20;
        cone.emplace_back(neck + (right * std::cos(angle) + up * std::sin(angle)) * head);
      }
      Line cap(cone.begin() + 1, cone.end());
      add(faceActor({cone, cap}, shot.colour, opacity));
      add(lineActor({{light * kLightTo, Eigen::Vector3d::Zero()}}, shot.colour, 0, shot.faint ? 0.35 : 0.6));
    }
    if (halfVectors_) {
      const Eigen::Vector3d half = (camera + light).normalized();
      // Dashed, because it is a direction that nothing stands in.
      std::vector<Line> dashes;
      for (int i = 0; i < 12; ++i)
        dashes.push_back({half * (0.72 * i / 12), half * (0.72 * (i + 0.55) / 12)});
      add(lineActor(dashes, shot.colour, 0.6 * pen, opacity));
    }
  }
  overlay_->update();
  update();
}

Eigen::Vector3d PlanViewport::eye() const {
  return Eigen::Vector3d(0, 0, kFocusHeight * std::cos(elevationRad_)) +
         distance_ * onSphere(std::numbers::pi / 2 - elevationRad_, azimuthRad_);
}

void PlanViewport::applyCamera() {
  vtkCamera* camera = renderer()->GetActiveCamera();
  const Eigen::Vector3d from = eye();
  camera->SetPosition(from.x(), from.y(), from.z());
  camera->SetFocalPoint(0, 0, kFocusHeight * std::cos(elevationRad_));
  camera->SetViewUp(-std::cos(azimuthRad_) * std::sin(elevationRad_),
                    -std::sin(azimuthRad_) * std::sin(elevationRad_), std::cos(elevationRad_));
  camera->SetClippingRange(0.05, distance_ + 4);
  overlay_->update();
  update();
}

QPointF PlanViewport::widgetFromWorld(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d from = eye();
  const Eigen::Vector3d forward =
      (Eigen::Vector3d(0, 0, kFocusHeight * std::cos(elevationRad_)) - from).normalized();
  const Eigen::Vector3d up(-std::cos(azimuthRad_) * std::sin(elevationRad_),
                           -std::sin(azimuthRad_) * std::sin(elevationRad_), std::cos(elevationRad_));
  const Eigen::Vector3d right = forward.cross(up), away = point - from;
  const double scale = 2 * std::tan(kViewAngleDeg * kRad / 2) / std::max(1, height());
  const double depth = std::max(1e-6, away.dot(forward));
  return {width() / 2.0 + away.dot(right) / depth / scale, height() / 2.0 - away.dot(up) / depth / scale};
}

void PlanViewport::paintOver(QPainter& painter) const {
  painter.setRenderHint(QPainter::Antialiasing);
  if (!usable()) {
    painter.setPen(theme::kTextDim);
    painter.drawText(rect().adjusted(24, 8, -24, -8), Qt::AlignCenter | Qt::TextWordWrap, failure());
    return;
  }
  painter.setFont(theme::captionFont());
  const QFontMetrics metrics = painter.fontMetrics();
  const auto write = [&](const Eigen::Vector3d& place, const QString& text, const QColor& colour,
                         bool plate) {
    const QPointF at = widgetFromWorld(place);
    const QSizeF size(metrics.horizontalAdvance(text) + 8, metrics.height());
    const QRectF tag(at - QPointF(size.width(), size.height()) / 2, size);
    if (plate) {
      painter.setPen(Qt::NoPen);
      painter.setBrush(QColor(24, 24, 24, 190));
      painter.drawRoundedRect(tag, 3, 3);
    }
    painter.setPen(colour);
    painter.drawText(tag, Qt::AlignCenter, text);
  };
  // Degrees from the normal, along the meridian that stands most to the right.
  const double meridian = std::round((azimuthRad_ + std::numbers::pi / 2) / (30 * kRad)) * 30 * kRad;
  for (int zenith = 0; zenith <= 90; zenith += 15)
    write(1.055 * onSphere(zenith * kRad, meridian), QStringLiteral("%1\u00b0").arg(zenith), theme::kTextDim,
          false);
  for (int azimuth = 0; azimuth < 360; azimuth += 90)
    write(1.12 * onSphere(90 * kRad, azimuth * kRad), tr("az. %1\u00b0").arg(azimuth), theme::kTextOff,
          false);
  for (const Shot& shot : shots_) {
    const QColor colour = shot.faint ? shot.colour.darker(115) : shot.colour;
    write(1.1 * shot.directions.toCamera, tr("camera %1").arg(shot.name), colour, true);
    write(1.4 * shot.directions.toLight, tr("light %1").arg(shot.name), colour, true);
  }
  if (shots_.empty()) {
    painter.setPen(theme::kTextDim);
    painter.drawText(rect().adjusted(24, 8, -24, -16), Qt::AlignHCenter | Qt::AlignBottom | Qt::TextWordWrap,
                     emptyText_);
  }
  focusRing_.paint(painter, *this);
}

void PlanViewport::turn(double azimuthRad, double elevationRad) {
  azimuthRad_ = std::remainder(azimuthRad_ + azimuthRad, 2 * std::numbers::pi);
  elevationRad_ = std::clamp(elevationRad_ + elevationRad, kLeastElevationRad, kMostElevationRad);
  applyCamera();
}

void PlanViewport::approach(double factor) {
  distance_ = std::clamp(distance_ * factor, 1.6, 12.0);
  applyCamera();
}

void PlanViewport::viewFromAbove() {
  azimuthRad_ = -std::numbers::pi / 2;
  elevationRad_ = kMostElevationRad;
  applyCamera();
}

void PlanViewport::viewFromTheSide() {
  azimuthRad_ = -std::numbers::pi / 2;
  elevationRad_ = 0.02;
  applyCamera();
}

void PlanViewport::resetView() {
  azimuthRad_ = kStartAzimuthRad;
  elevationRad_ = kStartElevationRad;
  distance_ = kStartDistance;
  applyCamera();
}

void PlanViewport::mousePressEvent(QMouseEvent* event) {
  last_ = event->position();
}

void PlanViewport::mouseMoveEvent(QMouseEvent* event) {
  if (event->buttons() == Qt::NoButton) return;
  const QPointF moved = event->position() - last_;
  last_ = event->position();
  turn(-moved.x() * 0.008, moved.y() * 0.008);
}

void PlanViewport::wheelEvent(QWheelEvent* event) {
  approach(std::pow(0.88, event->angleDelta().y() / 120.0));
  event->accept();
}

void PlanViewport::keyPressEvent(QKeyEvent* event) {
  switch (event->key()) {
    case Qt::Key_Left:
      return turn(-0.08, 0);
    case Qt::Key_Right:
      return turn(0.08, 0);
    case Qt::Key_Up:
      return turn(0, 0.08);
    case Qt::Key_Down:
      return turn(0, -0.08);
    case Qt::Key_Plus:
    case Qt::Key_Equal:
      return approach(0.88);
    case Qt::Key_Minus:
      return approach(1 / 0.88);
    case Qt::Key_T:
      return viewFromAbove();
    case Qt::Key_S:
      return viewFromTheSide();
    case Qt::Key_0:
      return resetView();
    default:
      VtkWidget::keyPressEvent(event);
  }
}

void PlanViewport::resizeEvent(QResizeEvent* event) {
  VtkWidget::resizeEvent(event);
  overlay_->setGeometry(rect());
}

void PlanViewport::focusInEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  overlay_->update();
}

void PlanViewport::focusOutEvent(QFocusEvent* event) {
  focusRing_.focusChanged(*event);
  overlay_->update();
}

}  // namespace patina
