// Runs with two monitors that are not there: a laptop's, which has the window, and one that lights the
// sample.
#include <gtest/gtest.h>

#include <QApplication>
#include <QFile>
#include <QStandardPaths>
#include <QTemporaryDir>

#include "app/window/application.h"
#include "widgets/theme.h"

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  if (GTEST_FLAG_GET(list_tests)) return RUN_ALL_TESTS();
  QTemporaryDir folder;
  QFile screens(folder.filePath(QStringLiteral("screens.json")));
  if (!screens.open(QIODevice::WriteOnly)) return 1;
  screens.write(
      R"({"screens": [
 {"name": "laptop", "x": 0, "y": 0, "width": 1920, "height": 1080, "logicalDpi": 96, "logicalBaseDpi": 96, "dpr": 1},
 {"name": "monitor", "x": 1920, "y": 0, "width": 960, "height": 540, "logicalDpi": 96, "logicalBaseDpi": 96, "dpr": 1}]})");
  screens.close();
  qputenv("QT_QPA_PLATFORM", "offscreen:configfile=" + screens.fileName().toUtf8());
  QStandardPaths::setTestModeEnabled(true);  // nothing of the person who runs the tests is read or written
  patina::prepareApplication();
  QApplication application(argc, argv);
  patina::theme::apply(application);
  return RUN_ALL_TESTS();
}
