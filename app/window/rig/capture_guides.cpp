#include "app/window/rig/capture_guides.h"

#include <QStackedWidget>

#include "app/window/rig/rig_steps.h"
#include "widgets/guide_panel.h"

namespace patina {

CaptureGuides::CaptureGuides(RigServices services, Settings& settings, QStackedWidget* pages, QObject* parent)
    : QObject(parent), pages_(pages), rig_(std::move(services), settings) {}

CaptureGuides::~CaptureGuides() {
  rig_.shutDown();
  for (GuidePanel* panel : panels_) delete panel;  // before the controller that their steps know
}

GuidePanel* CaptureGuides::panel(Kind kind) {
  GuidePanel*& panel = panels_[static_cast<std::size_t>(kind)];
  if (panel) return panel;
  const bool fourier = kind == Kind::Fourier;
  panel = new GuidePanel(fourier ? tr("Capture with a screen") : tr("Two-shot capture"), pages_);
  panel->setObjectName(fourier ? QStringLiteral("fourierGuide") : QStringLiteral("twoShotGuide"));
  addDeviceSteps(*panel, rig_, fourier);
  if (fourier) {
    addFourierCalibrationSteps(*panel, rig_);
    addFourierCaptureSteps(*panel, rig_);
  } else {
    addTwoShotSteps(*panel, rig_);
  }
  connect(panel, &GuidePanel::closeRequested, this, &CaptureGuides::leaveRequested);
  connect(panel, &GuidePanel::finished, this, [this] {
    if (!rig_.finishedBundle().empty()) Q_EMIT rig_.bundleReady(rig_.finishedBundle());
  });
  pages_->addWidget(panel);
  return panel;
}

void CaptureGuides::show(Kind kind) {
  GuidePanel* wanted = panel(kind);
  if (shown_ && *shown_ != kind) leave();
  shown_ = kind;
  pages_->setCurrentWidget(wanted);
  wanted->enter();
}

void CaptureGuides::leave() {
  if (!shown_) return;
  panel(*shown_)->leave();
  shown_.reset();
  rig_.setLive(false);
  rig_.closeDisplay();
}

}  // namespace patina
