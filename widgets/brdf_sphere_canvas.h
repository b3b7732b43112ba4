#pragma once

#include <vtkActor.h>
#include <vtkImageData.h>
#include <vtkPlaneSource.h>
#include <vtkSmartPointer.h>
#include <vtkTexture.h>

#include <QTimer>
#include <optional>

#include "widgets/focus_ring.h"
#include "widgets/sphere_worker.h"
#include "widgets/vtk_widget.h"

namespace patina {

/// The picture of BrdfSphereViewport: the sphere, its surroundings behind it out of focus, and the small
/// light as a lamp that can be taken.
///
/// Drag: turn the room (without one: move the highlight). Right drag or Shift + drag: the highlight follows
/// the cursor. Drag on the lamp: move it, round the rim to behind the sphere. Middle drag: pan. Wheel: zoom.
/// Double click or Home: as at the start. Keys: arrows turn the room, with Shift they move the light; plus
/// and minus zoom.
class BrdfSphereCanvas : public VtkWidget {
  Q_OBJECT

 public:
  explicit BrdfSphereCanvas(QWidget* parent = nullptr);
  ~BrdfSphereCanvas() override;

  /// What is shown; the canvas adds how the room is turned, where the light is, and the size.
  void setMaterial(std::shared_ptr<const TabulatedBrdf> brdf,
                   std::shared_ptr<const std::vector<float>> posteriorSd, double priorSd);
  void setEnvironment(const std::string& id, EnvironmentPtr opened);
  /// Irradiance on a surface that faces the light; zero: none, and no lamp.
  void setLight(const Eigen::Array3f& irradiance);
  void setLook(const SphereLook& look);
  void setSurround(bool shown);
  void setToLight(const Eigen::Vector3f& toLight);
  Eigen::Vector3f toLight() const { return scene_.toLight; }
  void resetView();

  float yawRad() const { return scene_.yawRad; }
  float pitchRad() const { return scene_.pitchRad; }
  double zoom() const { return zoom_; }
  /// The last picture of the sphere, its samples a pixel, whether it shows what is set now, and whether no
  /// finer one is coming.
  const QImage& sphere() const { return sphere_.picture; }
  int samples() const { return sphere_.samples; }
  bool upToDate() const { return sphere_.request == wanted_; }
  bool finest() const { return sphere_.finest && sphere_.request == wanted_; }
  SphereWorker* worker() { return worker_; }
  /// Where a place of the sphere is drawn: x right, y up, in radii from its middle. And back.
  QPointF widgetFromSphere(const QPointF& place) const;
  QPointF sphereFromWidget(const QPointF& position) const;

  QSize sizeHint() const override { return {420, 400}; }
  QSize minimumSizeHint() const override { return {140, 120}; }

 Q_SIGNALS:
  void toLightChanged();
  void rendered();  ///< the finest picture is there

 protected:
  void resizeEvent(QResizeEvent* event) override;
  void mousePressEvent(QMouseEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;
  void mouseReleaseEvent(QMouseEvent* event) override;
  void mouseDoubleClickEvent(QMouseEvent* event) override;
  void leaveEvent(QEvent* event) override;
  void wheelEvent(QWheelEvent* event) override;
  void keyPressEvent(QKeyEvent* event) override;
  void focusInEvent(QFocusEvent* event) override;
  void focusOutEvent(QFocusEvent* event) override;

 private:
  class Overlay;
  enum class Drag { None, Turn, Highlight, Lamp, Pan };
  void buildScene();
  void paintOver(QPainter& painter) const;
  void wish();  ///< a picture of what is set
  void show(const ShownSphere& sphere);
  void applyCamera();
  void placeLamp();
  bool lit() const;
  bool overLamp(const QPointF& position) const;
  void turn(float yaw, float pitch);
  void aim(const QPointF& position);
  QPointF lampOnSphere() const;
  double halfHeight() const;  ///< of the view in the sphere's plane, in radii
  int wantedSize() const;

  SphereWorker* worker_;
  SphereScene scene_;
  SphereLook look_;
  ShownSphere sphere_;
  std::uint64_t wanted_ = 0;
  bool surround_ = true;

  vtkSmartPointer<vtkImageData> ballPixels_, domePixels_;
  vtkSmartPointer<vtkTexture> ballTexture_, domeTexture_;
  vtkSmartPointer<vtkActor> ball_, dome_, lamp_;
  QWidget* overlay_ = nullptr;
  FocusRing focusRing_;
  QTimer settle_;
  double zoom_ = 1, turnGain_ = 0;
  QPointF pan_;
  Drag drag_ = Drag::None;
  QPointF last_, grabbed_;
  std::optional<QPointF> hover_;
};

}  // namespace patina
