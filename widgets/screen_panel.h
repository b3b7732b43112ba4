#pragma once

#include <QWidget>
#include <optional>
#include <vector>

#include "engine/acquire/pattern_display.h"

class QDoubleSpinBox;
class QGridLayout;
class QLabel;
class QPushButton;

namespace patina {

/// Which screen lights the sample, and how large it really is. Knows no window: it is told what screens there
/// are and says what the person answers.
class ScreenPanel : public QWidget {
  Q_OBJECT

 public:
  explicit ScreenPanel(QWidget* parent = nullptr);

  /// Screens with the numbers 1, 2, ... that are shown on them. `simulated`: a button for the simulated
  /// rig's own screen, which needs none of these.
  void setScreens(const std::vector<ScreenInfo>& screens, bool simulated);
  /// The one that was chosen: its facts and warnings.
  void setChosen(const std::optional<ScreenInfo>& screen);
  /// Lengths of the bars that the ruler shows, in the screen's pixels.
  void setRuler(bool shown, int acrossPx, int downPx);
  void setLatency(const QString& words);
  void setMeasuring(bool measuring, bool possible, const QString& whyNot);

  QPushButton* numberButton(int number) const;  ///< from 1
  QPushButton* simulatedButton() { return simulated_; }
  QPushButton* rulerButton() { return ruler_; }
  QPushButton* latencyButton() { return latency_; }
  QDoubleSpinBox* acrossMm() { return across_; }
  QDoubleSpinBox* downMm() { return down_; }

 Q_SIGNALS:
  void chosen(int number);  ///< from 1; 0: the simulated one
  void rulerRequested(bool shown);
  /// The person measured the bars (ruler shown) or the lit area (not shown), in mm.
  void measured(double acrossMm, double downMm);
  void latencyRequested();

 private:
  void refreshSizes();

  std::vector<ScreenInfo> screens_;
  std::optional<ScreenInfo> chosen_;
  bool rulerShown_ = false;
  int acrossPx_ = 0, downPx_ = 0;
  QLabel *question_, *facts_, *warnings_, *sizeSentence_, *acrossLabel_, *downLabel_, *latencyWords_;
  QGridLayout* numbers_;
  std::vector<QPushButton*> buttons_;
  QPushButton *simulated_, *ruler_, *latency_;
  QDoubleSpinBox *across_, *down_;
  QWidget *sizeBox_, *latencyBox_;
};

}  // namespace patina
