#pragma once

#include <QAbstractListModel>
#include <QListView>

#include "widgets/photo_library.h"

namespace patina {

/// "pattern", "window", "black" or "geometry".
QString roleName(PhotoRole role);
/// "ω = (3, −3)" for patterns, else the role.
QString photoTitle(const FourierPhoto& photo);
/// One line with everything about a photograph.
QString photoSummary(const FourierPhoto& photo);

/// The bundle's photographs in a row, with role, frequency, phase and a badge where held out. Thumbnails are
/// read when they come into sight.
class PhotoStrip : public QListView {
  Q_OBJECT

 public:
  explicit PhotoStrip(PhotoLibrary* library, QWidget* parent = nullptr);
  /// Call after the library's bundle has changed.
  void reload();
  int currentPhoto() const { return currentIndex().isValid() ? currentIndex().row() : -1; }
  void setCurrentPhoto(int photo);
  QSize sizeHint() const override;
  QSize minimumSizeHint() const override { return {200, sizeHint().height()}; }

 Q_SIGNALS:
  void photoSelected(int photo);
  /// A click or Enter on a photograph, also on the one already selected.
  void photoActivated(int photo);

 protected:
  void wheelEvent(QWheelEvent* event) override;

 private:
  class Model;
  class Delegate;
  PhotoLibrary* library_;
  Model* model_;
};

}  // namespace patina
