#pragma once

#include <QWidget>
#include <memory>
#include <optional>
#include <vector>

#include "engine/render/brdf_slices.h"
#include "widgets/focus_ring.h"

namespace patina {

/// The thetaH x thetaD slice of a BRDF at phiD = 90 degrees as a picture with its axes: colours as seen or
/// the logarithm of the luminance, contours of the posterior's standard deviation, dots where photographs
/// measured, and the thetaD whose curves are shown.
class SlicePicture : public QWidget {
  Q_OBJECT

 public:
  enum class Look { Logarithm, Colours, Certainty };

  explicit SlicePicture(QWidget* parent = nullptr);
  void setMaterial(std::shared_ptr<const TabulatedBrdf> brdf,
                   std::shared_ptr<const std::vector<float>> posteriorSd, double priorSd);
  void setLook(Look look);
  void setContours(bool shown);
  void setMeasured(const std::vector<HalfDiffAngles>& angles);
  /// Lines across at these thetaD, with their colours.
  void setCurves(std::vector<std::pair<double, QColor>> thetaDDeg);

  /// The angles at a place of the widget; none outside the picture. And back.
  std::optional<HalfDiffAngles> anglesAt(const QPointF& position) const;
  QPointF place(double thetaHDeg, double thetaDDeg) const;
  QImage picture() const { return shown_; }

  QSize sizeHint() const override { return {340, 320}; }
  QSize minimumSizeHint() const override { return {170, 150}; }

 Q_SIGNALS:
  /// What is under the cursor, or where the arrow keys moved the cross; none where it left.
  void hovered(std::optional<patina::HalfDiffAngles> angles);
  /// A click: curves of this thetaD are wanted.
  void picked(patina::HalfDiffAngles angles);

 protected:
  void paintEvent(QPaintEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;
  void mousePressEvent(QMouseEvent* event) override;
  void leaveEvent(QEvent* event) override;
  void keyPressEvent(QKeyEvent* event) override;
  void focusInEvent(QFocusEvent* event) override;
  void focusOutEvent(QFocusEvent* event) override;

 private:
  QRectF frame() const;
  QRectF bar() const;
  void render();
  void makeContours();
  void paintAxes(QPainter& painter, const QRectF& area);
  void paintBar(QPainter& painter);

  std::shared_ptr<const TabulatedBrdf> brdf_;
  std::shared_ptr<const std::vector<float>> posteriorSd_;
  double priorSd_ = 1;
  Look look_ = Look::Logarithm;
  bool contours_ = true;
  std::vector<QPointF> measured_;  ///< part of the axis across, thetaD up in 0 to 1
  std::vector<std::pair<double, QColor>> curves_;
  Image slice_, sd_;
  QImage shown_;
  double logLow_ = -3, logHigh_ = 1;
  struct Contour {
    double percent = 0;
    std::vector<QLineF> lines;  ///< in parts of the picture, y up
  };
  std::vector<Contour> contourLines_;
  std::optional<QPointF> cursor_;  ///< thetaH, thetaD in degrees: of the keyboard
  FocusRing focusRing_;
};

}  // namespace patina
