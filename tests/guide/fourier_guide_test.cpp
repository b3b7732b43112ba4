// The guided Fourier capture, led by clicks.
#include <gmock/gmock.h>

#include <QAction>
#include <QDoubleSpinBox>
#include <QGuiApplication>
#include <QLabel>
#include <QListWidget>
#include <QProgressBar>
#include <QWindow>

#include "app/window/explain_controller.h"
#include "app/window/rig/fourier_capture_step.h"
#include "engine/acquire/capture_journal.h"
#include "tests/guide/guide_fixture.h"
#include "widgets/capture_panel.h"
#include "widgets/checklist_panel.h"
#include "widgets/error_banner.h"

namespace patina::test {
namespace {

using testing::HasSubstr;

/// From true calibrations on: the steps that calibrate have tests of their own.
class FourierGuide : public GuideTest {
 protected:
  void begin() {
    LiveRigSetup setup = LiveRig::desk("laminate", 28, 960);
    setup.noise = {2e-5, 2e-4};
    open(setup);
    openShortGuide();
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
    auto* list = panel.findChild<ChecklistPanel*>();
    ASSERT_NE(list, nullptr);
    ASSERT_GE(list->lines(), 7);
    QCoreApplication::processEvents();
    for (const QLabel* label : list->findChildren<QLabel*>())
      EXPECT_TRUE(label->isVisible() || !label->text().startsWith(QStringLiteral("Ambient")));
    screenshot(QStringLiteral("guide_checklist"));
    click(panel.nextButton());
  }
  void leadToChecklist() {
    GuidePanel& panel = guide();
    const auto now = [&] { return panel.steps()[static_cast<std::size_t>(panel.current())]; };
    ASSERT_EQ(now()->title(), QStringLiteral("Checklist"));
    click(find<QPushButton>("hand-sample"));
    ASSERT_TRUE(until([&] { return !rigController().busy(); }));
  }
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
  leadToChecklist();
  if (HasFatalFailure()) return;
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
}

/// At the last step, its whole plan before it, the bundle going into "bundle".
#define PATINA_LEAD_TO_CAPTURE()                              \
  begin();                                                    \
  chooseDevices();                                            \
  if (HasFatalFailure()) return;                              \
  leadToChecklist();                                          \
  if (HasFatalFailure()) return;                              \
  check();                                                    \
  if (HasFatalFailure()) return;                              \
  FourierCaptureStep& step = captureStep();                   \
  step.setFolder(temporary() / "bundle");                     \
  auto* progress = find<QProgressBar>("captureProgress");     \
  click(step.panel()->startButton());                         \
  ASSERT_TRUE(until([&] { return progress->value() >= 6; })); \
  ASSERT_TRUE(step.running())

TEST_F(FourierGuide, EscOnThePatternScreenStopsItAndItGoesOnWhereItWas) {
  PATINA_LEAD_TO_CAPTURE();
  QWindow* pattern = nullptr;
  for (QWindow* window : QGuiApplication::topLevelWindows())
    if (window->objectName() == QStringLiteral("patternWindow") && window->isVisible()) pattern = window;
  ASSERT_NE(pattern, nullptr);
  QTest::keyClick(pattern, Qt::Key_Escape);
  ASSERT_TRUE(until([&] { return !step.running(); }));
  EXPECT_THAT(window_->banner()->text().toStdString(), HasSubstr("Esc"));
  EXPECT_FALSE(guide().nextButton()->isEnabled());
  const int kept = progress->value();
  EXPECT_GE(kept, 6);
  click(step.panel()->startButton());
  EXPECT_EQ(progress->value(), kept);
  ASSERT_TRUE(until([&] { return !step.running(); }, 120000));
  EXPECT_TRUE(guide().nextButton()->isEnabled()) << guide().nextButton()->toolTip().toStdString();
  EXPECT_EQ(progress->value(), progress->maximum());
}

TEST_F(FourierGuide, WhatWasCapturedIsFittedAndExplained) {
  PATINA_LEAD_TO_CAPTURE();
  screenshot(QStringLiteral("guide_capture"));
  ASSERT_TRUE(until([&] { return !step.running(); }, 120000));
  screenshot(QStringLiteral("guide_capture_done"));
  click(guide().nextButton());
  ASSERT_TRUE(until([&] { return window_->document()->capture() != nullptr; }));
  window_->action(QStringLiteral("fit"))->trigger();
  ASSERT_TRUE(until([&] { return window_->document()->fit() != nullptr; }, 120000))
      << window_->banner()->text().toStdString();
  EXPECT_LT(window_->document()->fit()->stats().holdoutRms,
            1.1 * window_->document()->fit()->stats().noiseFloorHoldout);
  window_->action(QStringLiteral("explain"))->trigger();
  ASSERT_TRUE(until([&] { return window_->explanation()->explanation() != nullptr; }, 200000))
      << window_->banner()->text().toStdString();
  // A capture of a rig without effects, under true calibrations.
  EXPECT_TRUE(window_->explanation()->explanation()->effects.empty())
      << window_->explanation()->explanation()->effects.front().id;
  short_->hide();
  screenshot(QStringLiteral("guide_explained"));
}

TEST_F(FourierGuide, AnUnpluggedCameraCostsNothingThatIsDone) {
  PATINA_LEAD_TO_CAPTURE();
  rig_->unplug();
  ASSERT_TRUE(until([&] { return !step.running(); }));
  EXPECT_THAT(window_->banner()->text().toStdString(), HasSubstr("unplugged"));
  const int kept = progress->value();
  EXPECT_GE(kept, 6);
  rig_->plugIn();
  click(step.panel()->startButton());
  ASSERT_TRUE(until([&] { return progress->value() > kept; }));
  // Held, and gone on with; then stopped by the person.
  click(step.panel()->pauseButton());
  QTest::qWait(200);
  const int held = progress->value();
  QTest::qWait(200);
  EXPECT_EQ(progress->value(), held);
  click(step.panel()->pauseButton());
  ASSERT_TRUE(until([&] { return progress->value() > held; }));
  click(step.panel()->cancelButton());
  ASSERT_TRUE(until([&] { return !step.running(); }));
  EXPECT_THAT(window_->banner()->text().toStdString(), HasSubstr("are kept"));
  EXPECT_GE(progress->value(), held);
}

TEST_F(FourierGuide, OnePhotographIsTakenAgainOnRequest) {
  begin();
  chooseDevices();
  if (HasFatalFailure()) return;
  leadToChecklist();
  if (HasFatalFailure()) return;
  check();
  if (HasFatalFailure()) return;
  FourierCaptureStep& step = captureStep();
  step.setPlan(smallPlan());
  step.setFolder(temporary() / "bundle");
  click(step.panel()->startButton());
  ASSERT_TRUE(until([&] { return !step.running(); }));
  ASSERT_EQ(step.state(), GuideStep::State::Done);
  EXPECT_FALSE(step.panel()->startButton()->isEnabled());
  step.panel()->strip()->setCurrentRow(5);
  click(step.panel()->retakeButton());
  EXPECT_THAT(step.panel()->qualityText().toStdString(), HasSubstr("will be taken again"));
  click(step.panel()->startButton());
  ASSERT_TRUE(until([&] { return !step.running(); }));
  EXPECT_EQ(step.state(), GuideStep::State::Done);
  EXPECT_THAT(step.panel()->qualityText().toStdString(), HasSubstr("good"));
  EXPECT_TRUE(std::filesystem::exists(temporary() / "bundle" / "photos" / "photo_005_r1.exr"));
}

TEST_F(FourierGuide, ABusyCameraIsSaidAndAnotherCanBeChosen) {
  begin();
  auto* cameras = find<QListWidget>("cameraList");
  ASSERT_TRUE(until([&] { return cameras->count() == 2; }));
  EXPECT_THAT(cameras->item(0)->text().toStdString(), HasSubstr("in use by another program"));
  cameras->setCurrentRow(0);
  click(find<QPushButton>("useCamera"));
  ASSERT_TRUE(until([&] { return window_->banner()->isVisible(); }));
  EXPECT_FALSE(guide().nextButton()->isEnabled());
  chooseDevices();
  EXPECT_EQ(guide().current(), 2);
}

TEST_F(FourierGuide, ControlsAreReadBackAndTheLivePictureShows) {
  begin();
  auto* cameras = find<QListWidget>("cameraList");
  ASSERT_TRUE(until([&] { return cameras->count() == 2; }));
  cameras->setCurrentRow(1);
  click(find<QPushButton>("useCamera"));
  ASSERT_TRUE(
      until([&] { return rigController().camera() != nullptr && rigController().lastFrame() != nullptr; }));
  auto* exposure = find<QDoubleSpinBox>("control-0");
  ASSERT_NE(exposure, nullptr);
  EXPECT_EQ(exposure->suffix().trimmed(), QStringLiteral("s"));
  exposure->setFocus();
  exposure->selectAll();
  QTest::keyClicks(exposure, QStringLiteral("0.2"));
  QTest::keyClick(exposure, Qt::Key_Return);
  const auto controls = rigController().camera()->controls();
  ASSERT_TRUE(controls.ok());
  EXPECT_EQ(controls->front().id, CameraControlId::ExposureS);
  EXPECT_DOUBLE_EQ(controls->front().value, 0.2);
  // The frame that has it comes by and by.
  EXPECT_TRUE(until([&] { return rigController().lastFrame()->metadata.exposureS == 0.2; }));
  EXPECT_TRUE(until([&] { return find<QLabel>("clippedShare")->text().contains(QStringLiteral("0.2 s")); }));
}

TEST_F(FourierGuide, TheRulersBarsTellTheScreensSize) {
  begin();
  chooseDevices();
  if (HasFatalFailure()) return;
  click(guide().backButton());
  click(find<QPushButton>("screenRuler"));
  auto* across = find<QDoubleSpinBox>("screenAcross");
  across->setFocus();
  across->selectAll();
  QTest::keyClicks(across, QStringLiteral("240"));
  QTest::keyClick(across, Qt::Key_Return);
  // The bar is 768 of 960 pixels long.
  EXPECT_NEAR(rigController().screen()->widthMm, 300, 1e-6);
  click(find<QPushButton>("measureLatency"));
  ASSERT_TRUE(until([&] { return rigController().latency().has_value() || window_->banner()->isVisible(); }));
  ASSERT_TRUE(rigController().latency().has_value()) << window_->banner()->text().toStdString();
  // 35 ms and the panel's rise; to a frame's length, and a refresh of the window's own.
  EXPECT_NEAR(static_cast<double>(rigController().latency()->count()) / 1000, 65, 45);
}

}  // namespace
}  // namespace patina::test
