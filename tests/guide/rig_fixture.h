#pragma once

#include <gtest/gtest.h>

#include <QPushButton>
#include <QTemporaryDir>
#include <QTest>
#include <functional>

#include "app/window/rig/rig_controller.h"
#include "app/window/settings.h"
#include "devices/simulated/live_rig.h"
#include "widgets/guide_panel.h"

namespace patina::test {

/// Services whose only camera is that of a simulated rig; no screens but its own.
inline RigServices servicesOf(const std::shared_ptr<LiveRig>& rig) {
  RigServices services;
  services.listCameras = [](std::vector<std::string>*) {
    return std::vector<CameraInfo>{{"simulated:test", "Simulated camera", "simulated", ""}};
  };
  services.openCamera = [rig](const std::string&) { return rig->openCamera(); };
  services.simulation = [rig](const std::string&) { return rig; };
  services.listScreens = [] { return std::vector<ScreenInfo>{}; };
  services.openDisplay = [](const std::string&, GlassObserver*,
                            std::function<void(const Error&)>) -> Result<std::shared_ptr<PatternDisplay>> {
    return Error{ErrorCode::NotFound, "there is no such screen", "", ""};
  };
  return services;
}

/// A simulated rig with its camera opened and its screen chosen, a guide of the steps that a test adds, and
/// an operator who clicks.
class RigTest : public testing::Test {
 protected:
  void start(const LiveRigSetup& setup) {
    Result<std::shared_ptr<LiveRig>> made = LiveRig::create(setup);
    ASSERT_TRUE(made.ok()) << made.error().sentence();
    rig_ = *made;
    settings_ = std::make_unique<Settings>(folder_.filePath("patina.ini"));
    settings_->set("rig/folder", folder_.filePath("rig"));
    controller_ = std::make_unique<RigController>(servicesOf(rig_), *settings_);
    QObject::connect(controller_.get(), &RigController::failed,
                     [this](const QString& doing, const Error& error) {
                       failures_ << doing + ": " + QString::fromStdString(error.sentence());
                     });
    controller_->openCamera("simulated:test");
    ASSERT_TRUE(until([this] { return controller_->camera() != nullptr; }));
    controller_->chooseScreen(rig_->openDisplay()->screen());
    panel_ = std::make_unique<GuidePanel>("Test");
    panel_->resize(1280, 660);  // what a window of 1280 x 720 leaves
  }
  void TearDown() override {
    if (panel_ && panel_->current() >= 0) panel_->leave();
    if (controller_) until([this] { return !controller_->busy(); });
    panel_.reset();
    controller_.reset();
    EXPECT_TRUE(failures_.isEmpty()) << failures_.join("; ").toStdString();
  }
  static bool until(const std::function<bool()>& condition, int milliseconds = 60000) {
    return QTest::qWaitFor(condition, milliseconds);
  }
  bool idle(int milliseconds = 60000) {
    return until([this] { return !controller_->busy(); }, milliseconds);
  }
  /// Clicks a button of the panel that must be there and enabled.
  void click(const QString& name) {
    auto* button = panel_->findChild<QPushButton*>(name);
    ASSERT_NE(button, nullptr) << name.toStdString();
    ASSERT_TRUE(until([button] { return button->isEnabled() && button->isVisible(); }, 20000))
        << name.toStdString();
    QTest::mouseClick(button, Qt::LeftButton);
  }
  /// Pictures of the panel as small and large windows show it, for people to look at.
  void keepPictures(const QString& name) {
    const QString folder = QStringLiteral(PATINA_SCREENSHOT_DIR);
    QDir().mkpath(folder);
    for (const QSize size : {QSize(1280, 660), QSize(1920, 1020)}) {
      panel_->resize(size);
      QTest::qWait(30);
      EXPECT_TRUE(panel_->grab().save(QStringLiteral("%1/%2_%3.png").arg(folder, name).arg(size.width())));
    }
    panel_->resize(1280, 660);
  }

  QTemporaryDir folder_;
  std::shared_ptr<LiveRig> rig_;
  std::unique_ptr<Settings> settings_;
  std::unique_ptr<RigController> controller_;
  std::unique_ptr<GuidePanel> panel_;
  QStringList failures_;
};

}  // namespace patina::test
