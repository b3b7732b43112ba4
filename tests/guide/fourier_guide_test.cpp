// The guided Fourier capture, led by clicks.
#include <gmock/gmock.h>

#include <QDoubleSpinBox>
#include <QLabel>
#include <QListWidget>

#include "app/window/rig/fourier_capture_step.h"
#include "engine/acquire/capture_journal.h"
#include "tests/guide/guide_fixture.h"
#include "widgets/capture_panel.h"
#include "widgets/checklist_panel.h"
#include "widgets/error_banner.h"

namespace patina::test {
namespace {

using testing::HasSubstr;

/// From true calibrations on: the steps that calibrate are others' tests.
class FourierGuide : public GuideTest {
 protected:
  void begin() {
    LiveRigSetup setup = LiveRig::desk("laminate", 28, 640);
    setup.noise = {2e-5, 2e-4};
    open(setup);
    writeTrueCalibrations();
    window_->startCapture(false);
  }
  FourierCaptureStep& captureStep() {
    return *dynamic_cast<FourierCaptureStep*>(
        guide().steps()[static_cast<std::size_t>(stepOf(guide(), "Capture"))]);
  }
  CapturePlanOptions smallPlan() const {
    CapturePlanOptions plan;
    plan.fitted = {{1, 0}, {0, 2}, {3, -3}};
    plan.heldOut = {{2, 1}};
    return plan;
  }
  /// Clicks through to the step; calibrations that are there are true.
  void check() {
    GuidePanel& panel = guide();
    EXPECT_FALSE(panel.nextButton()->isEnabled());
    click(find<QPushButton>("checkRig"));
    ASSERT_TRUE(until([&] { return panel.nextButton()->isEnabled() || window_->banner()->isVisible(); }))
        << panel.nextButton()->toolTip().toStdString();
    ASSERT_FALSE(window_->banner()->isVisible()) << window_->banner()->text().toStdString();
    click(panel.nextButton());
  }
  int taken() { return captureStep().panel()->strip()->count(); }
};

TEST_F(FourierGuide, LeadsFromTheCameraToTheOpenBundle) {
  begin();
  GuidePanel& panel = guide();
  ASSERT_EQ(panel.current(), 0);
  EXPECT_FALSE(panel.nextButton()->isEnabled());
  EXPECT_THAT(panel.nextButton()->toolTip().toStdString(), HasSubstr("No camera"));
  // Nothing that comes later can be begun: not by the list either.
  for (std::size_t i = 1; i < panel.steps().size(); ++i) {
    EXPECT_FALSE(panel.mayEnter(static_cast<int>(i)));
    EXPECT_FALSE(panel.goTo(static_cast<int>(i)));
  }
  chooseDevices();
  if (HasFatalFailure()) return;
  EXPECT_EQ(rigController().screen()->id, "monitor");
  while (panel.steps()[static_cast<std::size_t>(panel.current())]->title() != QStringLiteral("Checklist")) {
    ASSERT_TRUE(panel.nextButton()->isEnabled()) << panel.nextButton()->toolTip().toStdString();
    click(panel.nextButton());
  }
  check();
  if (HasFatalFailure()) return;
  FourierCaptureStep& step = captureStep();
  step.setPlan(smallPlan());
  step.setFolder(temporary() / "bundle");
  EXPECT_FALSE(panel.nextButton()->isEnabled());
  click(step.panel()->startButton());
  EXPECT_FALSE(step.panel()->startButton()->isEnabled());
  ASSERT_TRUE(until([&] { return !step.running(); }));
  EXPECT_FALSE(window_->banner()->isVisible()) << window_->banner()->text().toStdString();
  ASSERT_TRUE(panel.nextButton()->isEnabled()) << panel.nextButton()->toolTip().toStdString();
  click(panel.nextButton());
  ASSERT_TRUE(until([&] { return window_->document()->capture() != nullptr; }));
  EXPECT_EQ(window_->document()->capture()->folder, temporary() / "bundle");
  EXPECT_EQ(window_->document()->capture()->photos.size(), makeCapturePlan(smallPlan()).photos.size());
  EXPECT_FALSE(window_->captureGuides()->shown().has_value());
}

}  // namespace
}  // namespace patina::test
