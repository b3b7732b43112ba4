#pragma once

#include <QImage>
#include <QListView>
#include <map>

#include "widgets/photo_cache.h"
#include "widgets/shot_entry.h"
#include "widgets/two_shot_document.h"

namespace patina {

/// The photographs of a two-shot bundle, one below the other: the fitted ones, those held out and the white
/// tiles; once there is a fit, its prediction and the error beside each. Thumbnails are read on the cache's
/// thread.
class ShotStrip : public QListView {
  Q_OBJECT

 public:
  ShotStrip(TwoShotDocument* document, PhotoCache* cache, QWidget* parent = nullptr);
  int count() const { return static_cast<int>(entries_.size()); }
  const ShotEntry& entry(int row) const { return entries_.at(row); }
  int current() const { return currentIndex().isValid() ? currentIndex().row() : -1; }
  void setCurrent(int row);
  QSize sizeHint() const override;
  QSize minimumSizeHint() const override { return {sizeHint().width(), 120}; }

 Q_SIGNALS:
  void shotSelected(int row);
  void shotsChanged();

 private:
  class Model;
  class Delegate;
  void rebuild();
  QImage renderedThumbnail(int row);

  TwoShotDocument* document_;
  PhotoCache* cache_;
  std::vector<ShotEntry> entries_;
  std::map<int, QImage> rendered_;  ///< by row, made when first painted
  std::map<int, QImage> captured_;  ///< with the same brightness, by row
  Model* model_;
};

}  // namespace patina
