#pragma once

#include <vtkSmartPointer.h>

#include <Eigen/Core>
#include <QColor>
#include <vector>

#include "engine/twoshot/near_field.h"
#include "widgets/focus_ring.h"
#include "widgets/vtk_widget.h"

class vtkActor;
class vtkPolyData;

namespace patina {

/// Directions of camera and light over a flat sample, as a drawing that can be turned: the sample's disc, a
/// hemisphere ruled in degrees, a camera and an arrow of light for each shot. The camera stands at a distance
/// of one.
///
/// Drag: turn. Wheel: distance. Arrow keys: turn. T: from above. S: from the side. 0: as it was.
class PlanViewport : public VtkWidget {
  Q_OBJECT

 public:
  struct Shot {
    ShotDirections directions;
    QColor colour;
    QString name;        ///< "1"
    bool faint = false;  ///< drawn thin: for comparison
  };

  explicit PlanViewport(QWidget* parent = nullptr);
  ~PlanViewport() override;

  void setShots(std::vector<Shot> shots, double fovDeg);
  const std::vector<Shot>& shots() const { return shots_; }
  void setHalfVectorsShown(bool shown);
  void setEmptyText(const QString& text);
  void viewFromAbove();
  void viewFromTheSide();
  void resetView();
  double azimuthRad() const { return azimuthRad_; }
  double elevationRad() const { return elevationRad_; }
  /// Where a point is drawn, in the widget's coordinates.
  QPointF widgetFromWorld(const Eigen::Vector3d& point) const;

  QSize sizeHint() const override { return {520, 400}; }
  QSize minimumSizeHint() const override { return {220, 180}; }

 protected:
  void mousePressEvent(QMouseEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;
  void wheelEvent(QWheelEvent* event) override;
  void keyPressEvent(QKeyEvent* event) override;
  void resizeEvent(QResizeEvent* event) override;
  void focusInEvent(QFocusEvent* event) override;
  void focusOutEvent(QFocusEvent* event) override;

 private:
  class Overlay;
  void paintOver(QPainter& painter) const;
  void rebuild();
  void turn(double azimuthRad, double elevationRad);
  void approach(double factor);
  void applyCamera();
  Eigen::Vector3d eye() const;

  std::vector<Shot> shots_;
  double fovDeg_ = 25;
  bool halfVectors_ = false;
  QString emptyText_;
  std::vector<vtkSmartPointer<vtkActor>> actors_;
  QWidget* overlay_ = nullptr;
  FocusRing focusRing_;
  double azimuthRad_, elevationRad_, distance_;
  QPointF last_;
};

/// The colour of the n-th shot of a plan.
QColor shotColour(int shot);

}  // namespace patina
