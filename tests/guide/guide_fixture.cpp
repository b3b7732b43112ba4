#include "tests/guide/guide_fixture.h"

#include <QDir>
#include <QListWidget>

#include "app/window/rig/pattern_window.h"
#include "app/window/rig/rig_steps.h"
#include "engine/calibration/calibration_file.h"
#include "widgets/error_banner.h"

namespace patina::test {

GuideTest::GuideTest() = default;
GuideTest::~GuideTest() {
  if (window_) rigController().shutDown();
}

void GuideTest::openShortGuide() {
  writeTrueCalibrations();
  RigController& rig = rigController();
  short_ = std::make_unique<GuidePanel>(QStringLiteral("Short"));
  addDeviceSteps(*short_, rig, true);
  addFourierCaptureSteps(*short_, rig);
  QObject::connect(short_.get(), &GuidePanel::finished, &rig,
                   [&rig] { Q_EMIT rig.bundleReady(rig.finishedBundle()); });
  short_->resize(1280, 660);
  short_->show();
  short_->enter();
}

void GuideTest::open(const LiveRigSetup& setup, const QSize& size) {
  auto made = LiveRig::create(setup);
  ASSERT_TRUE(made.ok()) << made.error().sentence();
  rig_ = *made;
  Services services = Services::engine();
  services.rig.listCameras = [rig = rig_](std::vector<std::string>*) {
    return std::vector<CameraInfo>{{"v4l2:missing", "Some webcam", "v4l2", "in use by another program"},
                                   {"simulated:test", "Camera over the desk", "simulated", ""}};
  };
  services.rig.openCamera = [rig = rig_](const std::string& id) -> Result<std::unique_ptr<CameraDevice>> {
    if (id != "simulated:test") return cameraBusy(id);
    return rig->openCamera();
  };
  services.rig.simulation = [rig = rig_](const std::string&) { return rig; };
  services.rig.listScreens = [] { return screensThere(); };
  services.rig.openDisplay = openPatternWindow;
  window_ = std::make_unique<MainWindow>(std::move(services), temporary_.filePath("patina.ini"));
  window_->setAsk(
      [](const QString&, const QString&, const QString&, bool) { return MainWindow::Answer::GoOn; });
  window_->action("show-viewport")->setChecked(false);  // this platform has no OpenGL
  window_->resize(size);
  window_->show();
  ASSERT_TRUE(QTest::qWaitForWindowExposed(window_.get()));
  rigController().setFolder(calibrations());
}

int GuideTest::stepOf(GuidePanel& panel, const QString& title) {
  for (std::size_t i = 0; i < panel.steps().size(); ++i)
    if (panel.steps()[i]->title() == title) return static_cast<int>(i);
  ADD_FAILURE() << "no step " << title.toStdString();
  return -1;
}

void GuideTest::click(QWidget* widget) {
  ASSERT_NE(widget, nullptr);
  until([widget] { return widget->isVisible() && widget->isEnabled(); }, 2000);  // layouts show theirs later
  ASSERT_TRUE(widget->isVisible()) << widget->objectName().toStdString();
  ASSERT_TRUE(widget->isEnabled()) << widget->objectName().toStdString() << ": "
                                   << widget->toolTip().toStdString();
  QTest::mouseClick(widget, Qt::LeftButton);
}

void GuideTest::chooseDevices() {
  GuidePanel& panel = guide();
  auto* cameras = find<QListWidget>("cameraList");
  ASSERT_TRUE(until([&] { return cameras->count() == 2; }));
  QTest::mouseClick(cameras->viewport(), Qt::LeftButton, {},
                    cameras->visualItemRect(cameras->item(1)).center());
  click(find<QPushButton>("useCamera"));
  ASSERT_TRUE(until([&] { return panel.nextButton()->isEnabled(); }));
  click(panel.nextButton());
  click(find<QPushButton>("screenNumber2"));
  ASSERT_TRUE(until([&] { return panel.nextButton()->isEnabled(); }));
  click(panel.nextButton());
}

void GuideTest::screenshot(const QString& name) {
  QDir().mkpath(QStringLiteral(PATINA_SCREENSHOT_DIR));
  QCoreApplication::processEvents();  // what was just made is laid out and shown
  QWidget* shown = short_ && short_->isVisible() ? static_cast<QWidget*>(short_.get()) : window_.get();
  const QString file = QStringLiteral(PATINA_SCREENSHOT_DIR "/%1_%2x%3.png")
                           .arg(name)
                           .arg(shown->width())
                           .arg(shown->height());
  EXPECT_TRUE(shown->grab().save(file)) << file.toStdString();
}

void GuideTest::writeTrueCalibrations() {
  const RigDescription truth = rig_->description();
  const Board onSample = *parseBoard("charuco:7x5:12:0.7:4x4_50:0", ""),
              onScreen = *parseBoard("charuco:7x5:12:0.7:4x4_50:20", "");
  std::filesystem::create_directories(calibrations());
  const auto write = [&](const StoredCalibration& content, const char* unit) {
    CalibrationRecord record;
    record.content = content;
    record.device = "Camera over the desk";
    record.taken = std::chrono::system_clock::now();
    record.residualUnit = unit;
    record.madeBy = "test";
    const Status written =
        writeCalibration(calibrations() / (std::string(kindOf(content)) + ".json"), record);
    ASSERT_TRUE(written.ok()) << written.error().sentence();
  };
  StoredCamera camera;
  camera.camera = truth.camera;
  camera.board = onSample;
  write(camera, "px");
  StoredScreenPose pose;
  pose.camera = truth.camera;
  pose.screen = truth.screen;
  pose.onSample.board = onSample;
  pose.onScreen.board = onScreen;
  write(pose, "px");
  StoredEmission emission;
  emission.emission = *truth.screen.emission;
  emission.radianceScale = truth.radianceOfFullScaleSecond;
  write(emission, "%");
}

}  // namespace patina::test
