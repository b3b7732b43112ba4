#pragma once

#include <QWidget>
#include <array>

#include "widgets/tone.h"

namespace patina {

/// What the colours of a picture mean: a ramp with values, a disc of directions for normals, or the names of
/// states.
class ColourBar : public QWidget {
  Q_OBJECT

 public:
  explicit ColourBar(QWidget* parent = nullptr);
  /// `unit` is written above the ramp.
  void setScale(ToneStyle style, const ToneSettings& tone, const QString& unit);
  /// Texels by status, for the legend.
  void setStatusCounts(const std::array<std::size_t, kStatusCount>& counts);
  QSize sizeHint() const override;
  QSize minimumSizeHint() const override;

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  void paintRamp(QPainter& painter);
  void paintNormals(QPainter& painter);
  void paintLegend(QPainter& painter);

  ToneStyle style_ = ToneStyle::LinearRgb;
  ToneSettings tone_;
  QString unit_;
  std::array<std::size_t, kStatusCount> counts_{};
};

/// Round values between low and high, at most about `wanted` of them.
std::vector<double> roundTicks(double low, double high, int wanted);
/// A tick's text, as short as its spacing allows.
QString tickText(double value, double step);

}  // namespace patina
