#pragma once

#include <gtest/gtest.h>

#include <QPushButton>
#include <QTemporaryDir>
#include <QTest>
#include <filesystem>
#include <functional>
#include <memory>

#include "app/window/main_window.h"
#include "app/window/rig/capture_guides.h"
#include "devices/simulated/live_rig.h"
#include "widgets/guide_panel.h"

namespace patina::test {

/// A window whose one camera is a simulated rig's, and whose patterns go to the second monitor, where the rig
/// sees them.
class GuideTest : public testing::Test {
 protected:
  GuideTest();
  ~GuideTest() override;
  std::filesystem::path temporary() const { return temporary_.path().toStdString(); }
  std::filesystem::path calibrations() const { return temporary() / "calibrations"; }

  /// `rig` behind the camera "simulated:test".
  void open(const LiveRigSetup& setup, const QSize& size = QSize(1280, 720));
  static bool until(const std::function<bool()>& condition, int milliseconds = 60000) {
    return QTest::qWaitFor(condition, milliseconds);
  }
  RigController& rigController() { return *window_->captureGuides()->rig(); }
  /// The window's own, or the shorter one that a test made.
  GuidePanel& guide(CaptureGuides::Kind kind = CaptureGuides::Kind::Fourier) {
    return short_ ? *short_ : *window_->captureGuides()->panel(kind);
  }
  /// A guide without the steps that calibrate: what they would have made is there.
  void openShortGuide();
  /// The step of that title; the test fails where there is none.
  static int stepOf(GuidePanel& panel, const QString& title);
  /// A child by its object's name, which must be there.
  template <typename Widget>
  Widget* find(const char* name) {
    auto* found = (short_ ? static_cast<QWidget*>(short_.get()) : window_.get())
                      ->findChild<Widget*>(QString::fromLatin1(name));
    EXPECT_NE(found, nullptr) << name;
    return found;
  }
  /// A click of the left button, as a person's: the widget must be visible and enabled.
  static void click(QWidget* widget);
  /// Chooses the camera and the second monitor, by clicks.
  void chooseDevices();
  /// Of the guide without its calibrations where there is one on show, else of the window.
  void screenshot(const QString& name);

  /// Calibrations that say what the rig truly is, as files.
  void writeTrueCalibrations();

  QTemporaryDir temporary_;
  std::shared_ptr<LiveRig> rig_;
  std::unique_ptr<MainWindow> window_;
  std::unique_ptr<GuidePanel> short_;  ///< goes before the window and its controller
};

}  // namespace patina::test
