#pragma once

#include <QWidget>

namespace patina {

/// What the colours of the certainty overlay mean: from measured to extrapolated, in per cent of the
/// radiance.
class CertaintyBar : public QWidget {
  Q_OBJECT

 public:
  explicit CertaintyBar(QWidget* parent = nullptr);
  /// The standard deviation at the bar's end, natural-log units.
  void setPriorSd(double priorSd);
  QSize sizeHint() const override;
  QSize minimumSizeHint() const override;

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  double priorSd_ = 1;
};

/// A standard deviation of the logarithm as per cent, rounded as far as it means anything: "± 12 %"; beyond
/// 100 % "a factor of 2.7 either way".
QString certaintyText(double sd);

}  // namespace patina
