#pragma once

#include <QWidget>
#include <memory>
#include <optional>

#include "widgets/comparison_view.h"
#include "widgets/photo_cache.h"
#include "widgets/shot_entry.h"
#include "widgets/two_shot_document.h"

class QDoubleSpinBox;
class QLabel;
class QSlider;
class QTabBar;
class QToolButton;

namespace patina {

class ColourBar;
class ElidedLabel;
class ImageView;

/// The picture in the middle of a two-shot bundle: one shot's photograph against its prediction, with
/// exposure, the difference's colours, the values and the directions under the cursor; or the map of
/// materials.
class ComparisonPanel : public QWidget {
  Q_OBJECT

 public:
  ComparisonPanel(TwoShotDocument* document, PhotoCache* cache, QWidget* parent = nullptr);

  /// Shows a photograph; it is read first where that is needed.
  void setShot(const ShotEntry& entry);
  void clear();
  ComparisonMode mode() const;
  void setMode(ComparisonMode mode);
  bool labelsShown() const;
  void setLabelsShown(bool shown);
  double exposureEv() const;
  void setExposureEv(double stops);
  double differenceRange() const;
  void setDifferenceRange(double range);
  ComparisonView* view() { return view_; }
  ImageView* labels() { return labels_; }
  QString readout() const;
  void zoomIn();
  void zoomOut();
  void zoomToFit();

 Q_SIGNALS:
  void modeChanged();

 private:
  void refreshPictures();
  void refreshLabels();
  void refreshTone();
  void refreshTabs();
  void refreshReadout(std::optional<QPoint> pixel);

  TwoShotDocument* document_;
  PhotoCache* cache_;
  std::shared_ptr<const TwoShotCapture> capture_;  ///< what shot_ points into
  std::shared_ptr<const TwoShotFit> fit_;
  std::optional<ShotEntry> shot_;
  std::shared_ptr<const Image> photo_;
  ToneSettings automatic_;

  QTabBar* tabs_;
  ComparisonView* view_;
  ImageView* labels_;
  ColourBar* bar_;
  ElidedLabel *caption_, *readout_;
  QLabel *zoom_, *rangeLabel_;
  QSlider* exposureSlider_;
  QDoubleSpinBox *exposure_, *range_;
  QToolButton *reset_, *zoomFit_, *zoomActual_;
  bool updating_ = false;
};

/// Colour of a material in the label map and in lists; evenly spread hues.
QColor materialColour(int material);

}  // namespace patina
