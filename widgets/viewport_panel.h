#pragma once

#include <QWidget>
#include <memory>

#include "widgets/document.h"

class QCheckBox;
class QDoubleSpinBox;
class QLabel;

namespace patina {

class SheetViewport;
class SphereView;

/// The 3D side of the window: the fitted sheet, and beside it the sphere of one texel and the light's
/// controls.
class ViewportPanel : public QWidget {
  Q_OBJECT

 public:
  explicit ViewportPanel(Document* document, QWidget* parent = nullptr);
  /// The texel whose sphere is shown.
  void setTexel(std::optional<QPoint> texel);
  SheetViewport* sheet() { return sheet_; }
  SphereView* sphere() { return sphere_; }
  bool studio() const;
  void setStudio(bool studio);

 protected:
  void resizeEvent(QResizeEvent* event) override;

 private:
  void refresh();
  Document* document_;
  std::optional<QPoint> texel_;
  SheetViewport* sheet_;
  std::unique_ptr<QWidget> unseen_;  ///< the same, where it can't be shown
  SphereView* sphere_;
  QLabel* lampText_;
  QCheckBox* studio_;
  QDoubleSpinBox *exposure_, *height_;
  QWidget* controls_;
  bool updating_ = false;
};

}  // namespace patina
