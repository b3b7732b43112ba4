#pragma once

#include <QStringList>
#include <memory>

#include "app/window/rig/rig_controller.h"
#include "widgets/guide_step.h"

namespace patina {

class ScreenNumbers;
class ScreenPanel;

/// A picture of two bars to measure, and how long they are in pixels.
struct RulerPicture {
  ShownPicture picture;
  int acrossPx = 0, downPx = 0;
};
RulerPicture rulerPicture(int widthPx, int heightPx);

/// Which screen lights the sample, how large it is, and how late its light comes.
class ScreenStep : public GuideStep {
  Q_OBJECT

 public:
  explicit ScreenStep(RigController& rig);
  ~ScreenStep() override;

  QString title() const override;
  QString sentence() const override;
  QWidget* body(QWidget* parent) override;
  void enter() override;
  void leave() override;
  State state() const override;
  QString note() const override;
  QString whyNot() const override;

  ScreenPanel* panel() { return panel_; }
  const ScreenNumbers* numbers() const { return numbers_.get(); }

 private:
  void listScreens();
  void choose(int number);
  void setRuler(bool shown);
  void measured(double acrossMm, double downMm);
  void measureLatency();
  QString settingsKey(const ScreenInfo& screen) const;
  void refresh();
  bool notChosen() const;

  RigController& rig_;
  ScreenPanel* panel_ = nullptr;
  std::unique_ptr<ScreenNumbers> numbers_;
  std::vector<ScreenInfo> screens_;
  std::optional<RulerPicture> ruler_;
  bool entered_ = false, measuring_ = false;
};

}  // namespace patina
