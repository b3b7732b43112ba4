#pragma once

#include <QWidget>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "engine/brdf/half_diff.h"
#include "engine/brdf/tabulated_brdf.h"

class QBoxLayout;
class QCheckBox;
class QComboBox;
class QLabel;
class QToolButton;

namespace patina {

class PlotWidget;
class SlicePicture;

/// A measured BRDF in numbers: curves over thetaH at several thetaD, and the whole thetaH x thetaD slice as a
/// picture, both at phiD = 90 degrees; with the posterior's standard deviation, a second BRDF to compare, and
/// where the photographs measured.
class BrdfSlicesPanel : public QWidget {
  Q_OBJECT

 public:
  explicit BrdfSlicesPanel(QWidget* parent = nullptr);
  ~BrdfSlicesPanel() override;

  /// As BrdfSphereViewport::setMaterial.
  void setMaterial(std::shared_ptr<const TabulatedBrdf> brdf,
                   std::shared_ptr<const std::vector<float>> posteriorSd = {}, double priorSd = 0);
  /// A second BRDF, drawn dashed; null: none. `name` is what the legend calls it; empty: its own name.
  void setReference(std::shared_ptr<const TabulatedBrdf> brdf, const QString& name = {});
  /// Where photographs measured: dots on the picture. Any number; the panel thins them out.
  void setMeasured(const std::vector<HalfDiffAngles>& angles);

  PlotWidget* plot() { return plot_; }
  SlicePicture* picture() { return picture_; }
  /// What the last hovered place says.
  QString readout() const;
  /// How the file of an export is asked for; replaced by tests.
  void setChooseFile(std::function<QString()> choose) { chooseFile_ = std::move(choose); }

  QSize sizeHint() const override { return {760, 340}; }

 Q_SIGNALS:
  /// Something could not be saved; a sentence for the person.
  void failed(QString sentence);
  void saved(QString file);

 protected:
  void resizeEvent(QResizeEvent* event) override;

 private:
  void refresh();
  void refreshCurves();
  void readOut(const std::optional<HalfDiffAngles>& angles);
  void showCurveThrough(double thetaDDeg);
  std::vector<double> shownThetaDs() const;
  void save();

  std::shared_ptr<const TabulatedBrdf> brdf_, reference_;
  std::shared_ptr<const std::vector<float>> posteriorSd_;
  double priorSd_ = 0;
  QString referenceName_;
  std::vector<HalfDiffAngles> measured_;

  PlotWidget* plot_;
  SlicePicture* picture_;
  QBoxLayout* body_;
  QComboBox *channel_, *look_;
  QCheckBox *certainty_, *dots_;
  std::vector<QToolButton*> thetaD_;
  QToolButton* save_;
  QLabel* readout_;
  double pickedThetaDDeg_ = -1;
  std::function<QString()> chooseFile_;
};

}  // namespace patina
