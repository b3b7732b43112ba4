#pragma once

#include <gtest/gtest.h>

#include <QTemporaryDir>
#include <QTest>
#include <filesystem>
#include <functional>

#include "app/window/main_window.h"

namespace patina::test {

/// A window of its own settings for each test, and bundles to open.
class WindowTest : public testing::Test {
 protected:
  WindowTest();
  /// A window of 1280 x 860 with the given services; questions are answered with `GoOn`.
  std::unique_ptr<MainWindow> makeWindow(Services services = Services::engine());
  QString settingsFile() const { return temporary_.filePath("patina.ini"); }
  std::filesystem::path temporary() const { return temporary_.path().toStdString(); }

  /// A bundle that the simulated rig takes on the fly: 28 x 28 pixels, the paper's frequencies. Made once a
  /// process.
  static std::filesystem::path smallBundle();
  /// A bundle whose fit takes some seconds: of the shared data where present, else one of 96 x 96
  /// pixels that the simulated rig takes.
  static std::filesystem::path largerBundle();
  /// A copy of the small bundle that the test may spoil.
  std::filesystem::path spoilableBundle(const char* name);

  static bool until(const std::function<bool()>& condition, int milliseconds = 30000);
  /// Opens and waits until the window has taken it.
  static void open(MainWindow& window, const std::filesystem::path& bundle);

  QTemporaryDir temporary_;
};

/// Services whose fit is a FakeFit after `delayMs`, polling stop.
Services fakeServices(int delayMs = 0, int width = 24, int height = 16);

}  // namespace patina::test
