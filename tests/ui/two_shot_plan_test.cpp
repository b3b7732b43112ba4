// Planning directions: the dialog, its drawing and its job.
#include <QAction>
#include <QCheckBox>
#include <QDoubleSpinBox>
#include <QLabel>
#include <QPushButton>
#include <QSpinBox>
#include <QTableWidget>

#include "app/window/two_shot_controller.h"
#include "tests/ui/two_shot_fake.h"
#include "tests/ui/ui_fixture.h"
#include "widgets/plan_dialog.h"
#include "widgets/plan_viewport.h"
#include "widgets/two_shot_options_dialog.h"

namespace patina::test {
namespace {

class PlanTest : public WindowTest {
 protected:
  static PlanDialog* openDialog(MainWindow& window) {
    window.action("plan")->trigger();
    PlanDialog* dialog = window.twoShot()->planDialog();
    EXPECT_TRUE(QTest::qWaitForWindowExposed(dialog));
    return dialog;
  }
  std::filesystem::path bundle() {
    const auto made = temporary() / "disc";
    if (!std::filesystem::exists(made)) simulateTwoShotBundle(made, 32);
    return made;
  }
};

TEST_F(PlanTest, PlansWithoutABundleAndDrawsTheShots) {
  auto window = makeWindow(fakeTwoShotServices());
  EXPECT_TRUE(window->action("plan")->isEnabled());
  PlanDialog* dialog = openDialog(*window);
  EXPECT_FALSE(dialog->findChild<QPushButton*>("planSave")->isEnabled());
  EXPECT_TRUE(dialog->findChild<QPushButton*>("planSave")->toolTip().contains("Not now"));
  EXPECT_FALSE(dialog->findChild<QPushButton*>("planJudge")->isEnabled());
  dialog->findChild<QSpinBox*>("planShots")->setValue(3);
  QTest::mouseClick(dialog->findChild<QPushButton*>("planStart"), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return dialog->outcome().plan.has_value(); }));
  EXPECT_EQ(dialog->table()->rowCount(), 3);
  EXPECT_EQ(dialog->viewport()->shots().size(), 3u);
  EXPECT_TRUE(dialog->words().contains("23 %")) << dialog->words().toStdString();
  EXPECT_TRUE(dialog->table()->item(0, 3)->text().startsWith(QStringLiteral("6.0\u00b0 38.0\u00b0")))
      << dialog->table()->item(0, 3)->text().toStdString();
  EXPECT_FALSE(dialog->running());
}

TEST_F(PlanTest, ASearchIsCancelledAndKeepsWhatItHad) {
  auto window = makeWindow(fakeTwoShotServices(20000));
  PlanDialog* dialog = openDialog(*window);
  QTest::mouseClick(dialog->findChild<QPushButton*>("planStart"), Qt::LeftButton);
  ASSERT_TRUE(until(
      [&] { return dialog->findChild<QLabel*>("planStage")->text().contains("Searching for directions"); }));
  EXPECT_FALSE(dialog->findChild<QPushButton*>("planStart")->isEnabled());
  QTest::mouseClick(dialog->findChild<QPushButton*>("planCancel"), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return !dialog->running(); }, 5000));
  ASSERT_TRUE(dialog->outcome().plan.has_value());
  EXPECT_TRUE(dialog->words().contains("cancelled"));
  EXPECT_TRUE(dialog->isVisible());
}

TEST_F(PlanTest, EscapeCancelsASearchBeforeItClosesTheDialog) {
  auto window = makeWindow(fakeTwoShotServices(20000));
  PlanDialog* dialog = openDialog(*window);
  QTest::mouseClick(dialog->findChild<QPushButton*>("planStart"), Qt::LeftButton);
  ASSERT_TRUE(dialog->running());
  QTest::keyClick(dialog, Qt::Key_Escape);
  EXPECT_TRUE(dialog->isVisible());
  ASSERT_TRUE(until([&] { return !dialog->running(); }, 5000));
  QTest::keyClick(dialog, Qt::Key_Escape);
  EXPECT_FALSE(dialog->isVisible());
}

TEST_F(PlanTest, TheOpenBundlesDirectionsAreDrawnBesideThePlan) {
  auto window = makeWindow(fakeTwoShotServices());
  window->openPath(QString::fromStdString(bundle().string()));
  ASSERT_TRUE(until([&] { return window->twoShot()->isOpen(); }));
  PlanDialog* dialog = openDialog(*window);
  EXPECT_EQ(dialog->table()->rowCount(), 2) << "held-out shots are not of the plan";
  QTest::mouseClick(dialog->findChild<QPushButton*>("planJudge"), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return dialog->outcome().reached.has_value(); }));
  EXPECT_TRUE(dialog->words().contains("36 %")) << dialog->words().toStdString();
  EXPECT_FALSE(dialog->outcome().plan.has_value());
  QTest::mouseClick(dialog->findChild<QPushButton*>("planStart"), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return dialog->outcome().plan.has_value(); }));
  EXPECT_EQ(dialog->table()->rowCount(), 4);
  EXPECT_TRUE(dialog->viewport()->shots().back().faint);
  // Adding to what was taken.
  dialog->findChild<QCheckBox*>("planKeep")->setChecked(true);
  EXPECT_EQ(dialog->options().given.size(), 2u);
}

TEST_F(PlanTest, APlanIsSavedWithItsDrawing) {
  auto window = makeWindow(fakeTwoShotServices());
  PlanDialog* dialog = openDialog(*window);
  QTest::mouseClick(dialog->findChild<QPushButton*>("planStart"), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return dialog->outcome().plan.has_value(); }));
  const QString file = temporary_.filePath("my plan");
  dialog->setChooseFile([file] { return file; });
  QTest::mouseClick(dialog->findChild<QPushButton*>("planSave"), Qt::LeftButton);
  EXPECT_TRUE(std::filesystem::exists(file.toStdString() + ".json"))
      << dialog->findChild<QLabel*>("planSaid")->text().toStdString();
  EXPECT_TRUE(std::filesystem::exists(file.toStdString() + ".svg"));
  const auto read = readPlan(file.toStdString() + ".json");
  ASSERT_TRUE(read.ok()) << read.error().sentence();
  EXPECT_EQ(read->shots.size(), 2u);
}

TEST_F(PlanTest, TheDrawingTurnsByMouseAndKeys) {
  auto window = makeWindow(fakeTwoShotServices());
  PlanDialog* dialog = openDialog(*window);
  QTest::mouseClick(dialog->findChild<QPushButton*>("planStart"), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return dialog->outcome().plan.has_value(); }));
  PlanViewport* view = dialog->viewport();
  if (!view->usable()) GTEST_SKIP() << "no OpenGL on this display: " << view->failure().toStdString();
  QTest::qWait(50);
  const QImage before = view->grabFramebuffer();
  const double azimuth = view->azimuthRad();
  QTest::mousePress(view, Qt::LeftButton, {}, {200, 150});
  QTest::mouseMove(view, {240, 160});
  QTest::mouseMove(view, {280, 170});
  QTest::mouseRelease(view, Qt::LeftButton, {}, {280, 170});
  EXPECT_LT(view->azimuthRad(), azimuth - 0.3);
  EXPECT_NE(view->grabFramebuffer(), before);
  QTest::keyClick(view, Qt::Key_T);
  EXPECT_NEAR(view->elevationRad(), 1.5708, 0.01);
  // From above, azimuth 0 is to the right and the sample's centre in the middle.
  EXPECT_NEAR(view->widgetFromWorld({0, 0, 0}).x(), view->width() / 2.0, 1);
  EXPECT_GT(view->widgetFromWorld({1, 0, 0}).x(), view->width() / 2.0 + 50);
  QTest::keyClick(view, Qt::Key_0);
  EXPECT_NEAR(view->azimuthRad(), azimuth, 1e-9);
  const QImage plain = view->grabFramebuffer();
  dialog->findChild<QCheckBox*>("planHalfVectors")->click();
  EXPECT_NE(view->grabFramebuffer(), plain);
}

TEST_F(PlanTest, ItsOptionsAreKeptBetweenStarts) {
  {
    auto window = makeWindow(fakeTwoShotServices());
    PlanDialog* dialog = openDialog(*window);
    dialog->findChild<QSpinBox*>("planShots")->setValue(4);
    dialog->findChild<QDoubleSpinBox*>("planPoseError")->setValue(1.5);
    EXPECT_TRUE(window->close());
  }
  MainWindow again(fakeTwoShotServices(), settingsFile());
  EXPECT_EQ(again.twoShot()->planDialog()->options().shots, 4);
  EXPECT_DOUBLE_EQ(again.twoShot()->planDialog()->options().poseErrorDeg, 1.5);
}

TEST(TwoShotOptionsDialog, ShowsTakesAndChecksEveryOption) {
  TwoShotChoices choices;
  choices.fit.eta = 12;
  choices.fit.rowsPerShot = 900;
  choices.fit.noiseWeights = false;
  choices.fit.clusters = 0;
  TwoShotOptionsDialog dialog(choices);
  EXPECT_EQ(dialog.choices(), choices);
  dialog.findChild<QCheckBox*>("optionChooseEta")->setChecked(true);
  EXPECT_TRUE(dialog.choices().fit.chooseEta);
  EXPECT_FALSE(dialog.findChild<QDoubleSpinBox*>("optionEta")->isEnabled());
  dialog.basis()->setChooseFile([] { return QStringLiteral("/nowhere/basis.patina"); });
  QTest::mouseClick(dialog.findChild<QPushButton*>("basisBrowse"), Qt::LeftButton);
  EXPECT_EQ(dialog.choices().basisFile, "/nowhere/basis.patina");
  bool refused = false;
  for (QPushButton* button : dialog.findChildren<QPushButton*>())
    refused |= !button->isEnabled() && button->toolTip().contains("/nowhere/basis.patina");
  EXPECT_TRUE(refused) << "a basis that is not there can be confirmed";
}

}  // namespace
}  // namespace patina::test
