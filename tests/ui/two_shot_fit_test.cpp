// The window on a real reconstruction: the whole road, and pictures of the window at three sizes.
#include <QAction>
#include <QLabel>
#include <QPushButton>

#include "app/window/two_shot_controller.h"
#include "tests/test_data.h"
#include "tests/ui/two_shot_fake.h"
#include "tests/ui/ui_fixture.h"
#include "widgets/comparison_panel.h"
#include "widgets/error_banner.h"
#include "widgets/plan_dialog.h"
#include "widgets/shot_strip.h"
#include "widgets/two_shot_page.h"
#include "widgets/two_shot_report.h"

namespace patina::test {
namespace {

/// Of the shared data where present, else one that the simulated rig takes.
std::filesystem::path realBundle(const std::filesystem::path& temporary) {
  const auto shared = sharedData() / "two-shot" / "clean_pink_jasper";
  if (std::filesystem::exists(shared / "capture.json")) return shared;
  const auto made = temporary / "simulated";
  if (!std::filesystem::exists(made)) simulateTwoShotBundle(made, 64);
  return made;
}

void openAndWait(MainWindow& window, const std::filesystem::path& path) {
  window.openPath(QString::fromStdString(path.string()));
  ASSERT_TRUE(QTest::qWaitFor([&] { return !window.opening(); }, 120000));
  ASSERT_TRUE(window.twoShot()->isOpen()) << window.banner()->text().toStdString();
}

TEST_F(WindowTest, ATwoShotBundleIsReconstructedSavedAndOpenedAgain) {
  const QString folder = temporary_.filePath("kept");
  double holdout = 0;
  {
    auto window = makeWindow();
    openAndWait(*window, realBundle(temporary()));
    window->action("fit")->trigger();
    ASSERT_TRUE(until([&] { return !window->fitting(); }, 240000));
    ASSERT_TRUE(window->twoShot()->fitted()) << window->banner()->text().toStdString();
    const auto fit = window->twoShot()->document()->fit();
    EXPECT_GT(fit->stats.rows, 100u);
    holdout = fit->stats.holdoutRms;
    EXPECT_GT(holdout, 0);
    EXPECT_LT(holdout, 0.6);
    EXPECT_FALSE(window->twoShot()->page()->report()->text().contains("Not known"));
    // Every shot has its prediction, and an error beside it.
    ShotStrip* strip = window->twoShot()->page()->strip();
    for (int row = 0; row < strip->count(); ++row)
      if (!strip->entry(row).white) {
        ASSERT_NE(strip->entry(row).comparison, nullptr) << row;
        EXPECT_GE(strip->entry(row).comparison->rms, 0) << row;
      }
    EXPECT_NE(window->twoShot()->page()->comparison()->view()->rendered(), nullptr);
    window->saveFitTo(folder);
    ASSERT_TRUE(until([&] { return !window->saving(); }, 60000));
    ASSERT_FALSE(window->banner()->isVisible()) << window->banner()->text().toStdString();
    for (const char* file : {"brdf.binary", "coefficients.json", "fit.json", "sphere.png", "comparison.png"})
      EXPECT_TRUE(std::filesystem::exists(std::filesystem::path(folder.toStdString()) / file)) << file;
  }
  auto window = makeWindow();
  openAndWait(*window, folder.toStdString());
  ASSERT_TRUE(window->twoShot()->fitted()) << window->banner()->text().toStdString();
  EXPECT_NEAR(window->twoShot()->document()->fit()->stats.holdoutRms, holdout, 0.02);
  EXPECT_NE(window->twoShot()->page()->comparison()->view()->rendered(), nullptr);
}

TEST_F(WindowTest, ARealReconstructionIsCancelledSoon) {
  auto window = makeWindow();
  openAndWait(*window, realBundle(temporary()));
  window->action("fit")->trigger();
  QTest::qWait(30);
  window->action("cancel")->trigger();
  ASSERT_TRUE(until([&] { return !window->fitting(); }, 20000));
  EXPECT_NE(window->banner()->kind(), ErrorBanner::Kind::Problem);
  EXPECT_TRUE(window->action("fit")->isEnabled() || window->twoShot()->fitted());
}

// Pictures for people, in the build folder; the test itself checks that nothing is pushed out of the window.
TEST_F(WindowTest, TwoShotScreenshotsAtThreeSizes) {
  std::filesystem::create_directories(PATINA_SCREENSHOT_DIR);
  auto window = makeWindow();
  openAndWait(*window, realBundle(temporary()));
  const auto shoot = [&](const QString& name) {
    QTest::qWait(700);  // the sphere is refined on its own thread
    const QString file = QStringLiteral(PATINA_SCREENSHOT_DIR "/two_shot_%1_%2x%3.png")
                             .arg(name)
                             .arg(window->width())
                             .arg(window->height());
    EXPECT_TRUE(window->grab().save(file));
  };
  window->resize(1440, 900);
  shoot("open");
  window->action("fit")->trigger();
  ASSERT_TRUE(until([&] { return !window->fitting(); }, 240000));
  ASSERT_TRUE(window->twoShot()->fitted()) << window->banner()->text().toStdString();
  TwoShotPage* page = window->twoShot()->page();
  for (const QSize& size : {QSize(1100, 700), QSize(1440, 900), QSize(1920, 1080)}) {
    window->resize(size);
    QTest::qWait(150);
    EXPECT_EQ(window->size(), size) << "the content needs more room than the smallest window that we promise";
    for (QWidget* part : {static_cast<QWidget*>(page->strip()), static_cast<QWidget*>(page->comparison()),
                          static_cast<QWidget*>(page->report())}) {
      EXPECT_TRUE(window->rect().contains(QRect(part->mapTo(window.get(), QPoint()), part->size())))
          << part->objectName().toStdString();
    }
    page->strip()->setCurrent(0);
    page->comparison()->setMode(ComparisonMode::Wipe);
    shoot("wipe");
    page->strip()->setCurrent(page->strip()->count() > 3 ? 2 : 0);
    page->comparison()->setMode(ComparisonMode::Difference);
    shoot("difference");
    page->comparison()->setMode(ComparisonMode::SideBySide);
    shoot("side");
  }
  window->action("plan")->trigger();
  PlanDialog* dialog = window->twoShot()->planDialog();
  PlanOptions options = dialog->options();
  options.restarts = 1;
  options.candidates = 60;
  dialog->setOptions(options);
  QTest::mouseClick(dialog->findChild<QPushButton*>("planStart"), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return !dialog->running(); }, 240000));
  ASSERT_TRUE(dialog->outcome().plan.has_value())
      << dialog->findChild<QLabel*>("planSaid")->text().toStdString();
  QTest::qWait(100);
  EXPECT_TRUE(dialog->grab().save(QStringLiteral(PATINA_SCREENSHOT_DIR "/two_shot_plan.png")));
}

}  // namespace
}  // namespace patina::test
