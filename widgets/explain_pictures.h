#pragma once

#include <QWidget>
#include <memory>
#include <vector>

#include "engine/report/residual_pictures.h"

class QLabel;
class QTabBar;

namespace patina {

class ComparisonView;
class ElidedLabel;
class ImageView;

/// A residual for the eye with what belongs to it.
using ResidualViews = std::shared_ptr<const std::vector<ResidualView>>;
/// Of every picture of an explanation, in its order. Takes a moment: for a worker. `seconds`: none.
ResidualViews residualViews(const Explanation& explanation);

/// The picture of one photograph: its residual before and after under a wipe, beside the noise that a perfect
/// model would leave; or the photograph against its prediction; or where in the camera's picture the residual
/// of all photographs sits.
class ExplainPictures : public QWidget {
  Q_OBJECT

 public:
  enum class Mode { Residual, Photograph, Place };
  explicit ExplainPictures(QWidget* parent = nullptr);

  /// Null takes everything away.
  void setExplanation(std::shared_ptr<const Explanation> explanation, ResidualViews views);
  /// A picture of the explanation; -1: none was kept.
  void showPicture(int picture);
  void setMode(Mode mode);
  Mode mode() const;
  int shown() const { return shown_; }
  ComparisonView* comparison() { return comparison_; }
  ImageView* expected() { return expected_; }
  QString caption() const;

 private:
  void refresh();

  std::shared_ptr<const Explanation> explanation_;
  ResidualViews views_;
  int shown_ = -1;
  QTabBar* tabs_;
  ComparisonView* comparison_;
  ImageView* expected_;
  QWidget* expectedPane_;
  QLabel* caption_;
};

}  // namespace patina
