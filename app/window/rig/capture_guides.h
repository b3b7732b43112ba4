#pragma once

#include <QObject>
#include <memory>

#include "app/window/rig/rig_controller.h"

class QStackedWidget;

namespace patina {

class GuidePanel;
class Settings;

/// The guided captures as the window has them: made when first asked for, one at a time on show.
class CaptureGuides : public QObject {
  Q_OBJECT

 public:
  enum class Kind { Fourier, TwoShot };
  /// Panels go into `pages`. `settings` must outlive this.
  CaptureGuides(RigServices services, Settings& settings, QStackedWidget* pages, QObject* parent = nullptr);
  ~CaptureGuides() override;

  /// The panel of a kind, made at the first call.
  GuidePanel* panel(Kind kind);
  RigController* rig() { return &rig_; }
  /// Comes on show, or goes: devices are let go of while no guide is shown.
  void show(Kind kind);
  void leave();
  std::optional<Kind> shown() const { return shown_; }

 Q_SIGNALS:
  void leaveRequested();

 private:
  QStackedWidget* pages_;
  RigController rig_;
  GuidePanel* panels_[2] = {};
  std::optional<Kind> shown_;
};

}  // namespace patina
