#include <gtest/gtest.h>

#include <QApplication>
#include <QStandardPaths>

#include "app/window/application.h"
#include "widgets/theme.h"

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  if (GTEST_FLAG_GET(list_tests)) return RUN_ALL_TESTS();
  QStandardPaths::setTestModeEnabled(true);  // nothing of the person who runs the tests is read or written
  patina::prepareApplication();
  QApplication application(argc, argv);
  patina::theme::apply(application);
  return RUN_ALL_TESTS();
}
