#pragma once

#include <QWidget>

#include "widgets/photo_cache.h"
#include "widgets/two_shot_document.h"

class QSplitter;

namespace patina {

class BrdfSlicesPanel;
class BrdfSphereViewport;
class ComparisonPanel;
class ShotStrip;
class TwoShotReport;

/// The window's content while a two-shot bundle is open: its photographs, a comparison, the reconstruction in
/// words, the sphere and the slices of the material.
class TwoShotPage : public QWidget {
  Q_OBJECT

 public:
  using Reader = std::function<Result<Image>(const TwoShotCapture&, const TwoShotPhoto&)>;

  TwoShotPage(TwoShotDocument* document, Reader reader, QWidget* parent = nullptr);

  PhotoCache* photos() { return cache_; }
  ShotStrip* strip() { return strip_; }
  ComparisonPanel* comparison() { return comparison_; }
  TwoShotReport* report() { return report_; }
  BrdfSphereViewport* sphere() { return sphere_; }
  BrdfSlicesPanel* slices() { return slices_; }
  void setSphereShown(bool shown);
  void setSlicesShown(bool shown);
  void setStripShown(bool shown);
  void setReportShown(bool shown);

  /// Sizes of the parts, for the settings.
  QByteArray saveLayout() const;
  void restoreLayout(const QByteArray& state);

 private:
  void refreshMaterial();

  TwoShotDocument* document_;
  Reader reader_;
  PhotoCache* cache_;
  ShotStrip* strip_;
  ComparisonPanel* comparison_;
  TwoShotReport* report_;
  BrdfSphereViewport* sphere_;
  BrdfSlicesPanel* slices_;
  QSplitter *columns_, *middle_, *right_;
};

}  // namespace patina
