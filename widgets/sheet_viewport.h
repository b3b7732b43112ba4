#pragma once

#include <vtkActor.h>
#include <vtkImageData.h>
#include <vtkLineSource.h>
#include <vtkPlaneSource.h>
#include <vtkPolyData.h>
#include <vtkSmartPointer.h>
#include <vtkTexture.h>

#include <Eigen/Core>
#include <QTimer>

#include "widgets/document.h"
#include "widgets/focus_ring.h"
#include "widgets/sheet_shading.h"
#include "widgets/vtk_widget.h"

namespace patina {

/// The fitted sheet under a light that can be dragged. Each texel is shaded on the CPU with the engine's BRDF
/// for its own directions to the light and to the eye, at the maps' resolution, whenever light or eye move.
///
/// Left drag on the sheet: the highlight follows the cursor. Left drag on the lamp: the lamp moves, at its
/// height. Shift + drag or Ctrl + wheel: the lamp's height. Right drag: orbit. Middle drag: pan. Wheel:
/// distance. Left click: pick the texel.
class SheetViewport : public VtkWidget {
  Q_OBJECT

 public:
  explicit SheetViewport(Document* document, QWidget* parent = nullptr);
  ~SheetViewport() override;

  void viewFromCamera();  ///< where the capture's camera stood
  void viewFromAbove();
  void resetLamp();
  /// Where the lamp starts: over the sheet so that the capture's camera sees its highlight in the middle.
  LampState startingLamp() const;
  /// Milliseconds that the last shading took, and its step.
  double shadingMs() const { return shadingMs_; }
  int shadingStep() const { return shadingStep_; }
  /// Where a point of the world is drawn, in the widget's coordinates.
  QPointF widgetFromWorld(const Eigen::Vector3d& pointMm) const;

  QSize sizeHint() const override { return {420, 320}; }
  QSize minimumSizeHint() const override { return {160, 120}; }

 protected:
  void mousePressEvent(QMouseEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;
  void mouseReleaseEvent(QMouseEvent* event) override;
  void wheelEvent(QWheelEvent* event) override;
  void keyPressEvent(QKeyEvent* event) override;
  void resizeEvent(QResizeEvent* event) override;

  void focusInEvent(QFocusEvent* event) override;
  void focusOutEvent(QFocusEvent* event) override;

 private:
  class Overlay;
  void paintOver(QPainter& painter) const;

  enum class Drag { None, Undecided, Highlight, Lamp, Height, Orbit, Pan };
  void rebuild();
  void placeScene();
  void shade(bool exact);
  void applyCamera();
  std::optional<Eigen::Vector3d> planePoint(const QPointF& position, double heightMm) const;
  Eigen::Vector3d rayThrough(const QPointF& position) const;
  Eigen::Vector3d eyeMm() const;
  bool overLamp(const QPointF& position) const;
  void moveLamp(const Eigen::Vector3d& positionMm);
  double sizeMm() const;

  Document* document_;
  std::shared_ptr<const FourierFit> fit_;
  vtkSmartPointer<vtkImageData> pixels_;
  vtkSmartPointer<vtkTexture> texture_;
  vtkSmartPointer<vtkPlaneSource> plane_;
  vtkSmartPointer<vtkLineSource> drop_;
  vtkSmartPointer<vtkPolyData> frame_, mark_;
  vtkSmartPointer<vtkActor> sheet_, lamp_, dropActor_, frameActor_, markActor_;
  Image radiance_;
  FocusRing focusRing_;
  QWidget* overlay_ = nullptr;
  QTimer refine_, gesture_;
  double azimuthRad_ = -1.57, elevationRad_ = 0.9, distanceMm_ = 400;
  Eigen::Vector3d focusMm_{0, 0, 0};
  bool placed_ = false;

  Drag drag_ = Drag::None;
  QPointF pressed_, last_;
  Eigen::Vector3d grabbedMm_{0, 0, 0};
  double shadingMs_ = 0;
  int shadingStep_ = 1;
};

}  // namespace patina
