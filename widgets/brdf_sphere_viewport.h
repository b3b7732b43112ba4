#pragma once

#include <Eigen/Core>
#include <QColor>
#include <QWidget>
#include <functional>
#include <memory>
#include <vector>

#include "engine/brdf/tabulated_brdf.h"
#include "engine/render/environment.h"

class QCheckBox;
class QComboBox;
class QDoubleSpinBox;
class QLabel;
class QToolButton;

namespace patina {

class BrdfSphereCanvas;
class CertaintyBar;

/// A sphere of a measured material in a room of one's choice and under a small light, drawn by VTK, with its
/// controls. The engine makes the picture on a thread of its own, coarse first, then finer; the window's
/// thread never waits. The overlay shows where the material's radiance was measured and where it is
/// extrapolated.
class BrdfSphereViewport : public QWidget {
  Q_OBJECT

 public:
  explicit BrdfSphereViewport(QWidget* parent = nullptr);
  ~BrdfSphereViewport() override;

  /// The material; null: an empty state. `posteriorSd`: for each cell of the MERL grid, natural-log units, -1
  /// where nothing is known; null: the overlay can't be chosen. `priorSd`: what "nothing was measured" means
  /// for it.
  void setMaterial(std::shared_ptr<const TabulatedBrdf> brdf,
                   std::shared_ptr<const std::vector<float>> posteriorSd = {}, double priorSd = 0);

  /// One of builtInEnvironments()' ids, "" for none (only the light), or "file" once a picture was opened.
  QString environment() const;
  void setEnvironment(const QString& id);
  /// Reads a person's own latitude-longitude picture (OpenEXR) and shows the sphere in it. A failure is said
  /// in the viewport and by `failed`.
  void openEnvironment(const QString& file);

  bool lightOn() const;
  void setLightOn(bool on);
  /// Unit, towards the light; x right, y up, z to the eye.
  Eigen::Vector3f toLight() const;
  void setToLight(const Eigen::Vector3f& toLight);
  /// Irradiance on a surface that faces it, in units of pi: 1 makes a white matt surface white.
  double lightStrength() const;
  void setLightStrength(double strength);
  QColor lightColour() const { return lightColour_; }
  void setLightColour(const QColor& colour);

  double exposureEv() const;
  void setExposureEv(double stops);
  bool overlayOn() const;
  void setOverlayOn(bool on);
  /// Room and light as they start, and the whole sphere in view.
  void resetView();

  BrdfSphereCanvas* canvas() { return canvas_; }
  /// How the file of an environment is asked for; replaced by tests. Gives "" where the person changed their
  /// mind.
  void setChooseFile(std::function<QString()> choose) { chooseFile_ = std::move(choose); }

  QSize sizeHint() const override { return {420, 480}; }

 Q_SIGNALS:
  /// Something could not be opened; a sentence for the person.
  void failed(QString sentence);
  /// The finest picture of what is set is on the screen.
  void rendered();

 private:
  void refresh();
  void chooseEnvironment(int index);
  void chooseLightColour();
  void applyLight();
  void applyLook();
  void say(const QString& sentence);

  BrdfSphereCanvas* canvas_;
  std::unique_ptr<QWidget> unseen_;  ///< the same, where it can't be shown
  CertaintyBar* bar_;
  QComboBox* environment_;
  QCheckBox *light_, *overlay_, *surround_;
  QDoubleSpinBox *strength_, *exposure_;
  QToolButton *swatch_, *reset_;
  QLabel* message_;
  QWidget* controls_;
  QColor lightColour_ = Qt::white;
  std::function<QString()> chooseFile_;
  QString shownEnvironment_;
  EnvironmentPtr opened_;
  bool hasMaterial_ = false, hasCertainty_ = false;
};

}  // namespace patina
