// The window without fitting for real: opening, dropping, bad input, undo, state between starts.
#include <QAction>
#include <QDoubleSpinBox>
#include <QDropEvent>
#include <QLabel>
#include <QMenu>
#include <QMimeData>
#include <QPushButton>
#include <QTabBar>
#include <QUrl>
#include <fstream>
#include <thread>

#include "tests/ui/fake_fit.h"
#include "tests/ui/ui_fixture.h"
#include "widgets/empty_state.h"
#include "widgets/error_banner.h"
#include "widgets/image_view.h"
#include "widgets/map_panel.h"
#include "widgets/photo_strip.h"
#include "widgets/plot_widget.h"
#include "widgets/sheet_viewport.h"
#include "widgets/texel_inspector.h"
#include "widgets/viewport_panel.h"

namespace patina::test {
namespace {

void drop(MainWindow& window, const QString& path) {
  QMimeData data;
  data.setUrls({QUrl::fromLocalFile(path)});
  QDragEnterEvent enter(QPoint(400, 300), Qt::CopyAction, &data, Qt::LeftButton, Qt::NoModifier);
  QCoreApplication::sendEvent(&window, &enter);
  EXPECT_TRUE(enter.isAccepted());
  QDropEvent event(QPointF(400, 300), Qt::CopyAction, &data, Qt::LeftButton, Qt::NoModifier);
  QCoreApplication::sendEvent(&window, &event);
}

void fitWithFake(MainWindow& window) {
  window.startFit();
  ASSERT_TRUE(QTest::qWaitFor([&] { return !window.fitting() && window.document()->fit(); }, 5000));
}

TEST_F(WindowTest, StartsWithAnInvitationAndSaysWhyActionsRest) {
  auto window = makeWindow();
  auto* empty = window->findChild<EmptyState*>();
  ASSERT_NE(empty, nullptr);
  EXPECT_TRUE(empty->isVisible());
  EXPECT_TRUE(window->findChild<QPushButton*>("emptyOpen")->isVisible());
  for (const char* name : {"fit", "save", "cancel", "view-sigma"}) {
    EXPECT_FALSE(window->action(name)->isEnabled()) << name;
    EXPECT_TRUE(window->action(name)->toolTip().contains("Not now"))
        << name << ": " << window->action(name)->toolTip().toStdString();
  }
  EXPECT_TRUE(window->action("open")->isEnabled());
}

TEST_F(WindowTest, OpensABundleAndReadsOnlyWhatIsSeen) {
  std::atomic<int> reads = 0;
  std::atomic<bool> onWindowThread = false;
  Services services = Services::engine();
  const auto here = std::this_thread::get_id();
  services.readPhoto = [&](const FourierCapture& capture, const FourierPhoto& photo) {
    ++reads;
    if (std::this_thread::get_id() == here) onWindowThread = true;
    return readPhoto(capture, photo);
  };
  auto window = makeWindow(services);
  open(*window, smallBundle());
  const int photos = static_cast<int>(window->document()->capture()->photos.size());
  EXPECT_GT(photos, 100);
  EXPECT_EQ(window->strip()->model()->rowCount(), photos);
  EXPECT_TRUE(
      until([&] { return window->photos()->thumbnailsLoaded() >= 8 && window->maps()->view()->picture(); }));
  QTest::qWait(200);
  EXPECT_LT(reads, photos / 2) << "thumbnails out of sight were read";
  EXPECT_FALSE(onWindowThread);
  EXPECT_EQ(window->maps()->kind(), ViewKind::Photo);
  EXPECT_TRUE(window->strip()->isVisible());
  EXPECT_TRUE(window->action("fit")->isEnabled());
  // The strip says role, frequency, phase and hold-out.
  bool pattern = false, held = false;
  for (int i = 0; i < photos; ++i) {
    const QString tip = window->strip()->model()->index(i, 0).data(Qt::ToolTipRole).toString();
    pattern |=
        tip.contains(QStringLiteral("\u03c9 = (1, 0)")) && tip.contains(QStringLiteral("phase 90\u00b0"));
    held |= tip.contains("held out");
  }
  EXPECT_TRUE(pattern);
  EXPECT_TRUE(held);
}

TEST_F(WindowTest, AClickInTheStripShowsThePhotograph) {
  auto window = makeWindow();
  open(*window, smallBundle());
  ASSERT_TRUE(until([&] { return window->maps()->view()->picture() != nullptr; }));
  const Image* before = window->maps()->view()->picture();
  const QRect item = window->strip()->visualRect(window->strip()->model()->index(3, 0));
  QTest::mouseClick(window->strip()->viewport(), Qt::LeftButton, {}, item.center());
  EXPECT_TRUE(
      until([&] { return window->maps()->photo() == 3 && window->maps()->view()->picture() != before; }));
  QTest::keyClick(window->strip(), Qt::Key_Right);
  EXPECT_TRUE(until([&] { return window->maps()->photo() == 4; }));
}

TEST_F(WindowTest, ADropOpensABundleByFolderOrFile) {
  auto window = makeWindow();
  drop(*window, QString::fromStdString(smallBundle().string()));
  ASSERT_TRUE(until([&] { return window->document()->capture() != nullptr; }));
  auto other = makeWindow();
  drop(*other, QString::fromStdString((smallBundle() / "capture.json").string()));
  ASSERT_TRUE(until([&] { return other->document()->capture() != nullptr; }));
  EXPECT_EQ(other->document()->capture()->photos.size(), window->document()->capture()->photos.size());
}

TEST_F(WindowTest, ABadBundleShowsABannerAndLeavesTheWindowAsItWas) {
  auto window = makeWindow();
  open(*window, smallBundle());
  const auto before = window->document()->capture();
  const auto bad = spoilableBundle("bad");
  std::ofstream(bad / "capture.json")
      << "{ \"format\": \"patina-capture\", \"version\": 1, \"kind\": \"fourier\" }";
  window->openPath(QString::fromStdString(bad.string()));
  ASSERT_TRUE(until([&] { return window->banner()->isVisible(); }));
  EXPECT_EQ(window->banner()->kind(), ErrorBanner::Kind::Problem);
  const QString said = window->banner()->text();
  EXPECT_TRUE(said.contains("Opening bad")) << said.toStdString();
  EXPECT_TRUE(said.contains("Where:")) << said.toStdString();
  EXPECT_TRUE(said.contains("What to try:")) << said.toStdString();
  EXPECT_EQ(window->document()->capture(), before);
  // The banner blocks nothing, and goes with the next success.
  window->openPath(QString::fromStdString(smallBundle().string()));
  ASSERT_TRUE(until([&] { return !window->opening(); }));
  EXPECT_FALSE(window->banner()->isVisible());
}

TEST_F(WindowTest, AMissingBundleIsTakenOffTheRecentList) {
  auto window = makeWindow();
  window->openPath(QString::fromStdString((temporary() / "nowhere").string()));
  ASSERT_TRUE(until([&] { return window->banner()->isVisible(); }));
  EXPECT_TRUE(window->findChild<EmptyState*>()->isVisible());
  EXPECT_EQ(window->document()->capture(), nullptr);
}

TEST_F(WindowTest, APhotographThatCannotBeReadIsSaidAndMarked) {
  const auto bundle = spoilableBundle("truncated");
  const auto capture = readFourierCapture(bundle);
  ASSERT_TRUE(capture.ok());
  std::filesystem::resize_file(bundle / capture->photos[2].file, 200);
  auto window = makeWindow();
  open(*window, bundle);
  ASSERT_TRUE(until([&] { return window->banner()->isVisible(); }));
  EXPECT_TRUE(window->banner()->text().contains(QString::fromStdString(capture->photos[2].file)))
      << window->banner()->text().toStdString();
  EXPECT_TRUE(window->photos()->failed(2));
  EXPECT_TRUE(until([&] { return window->photos()->thumbnailsLoaded() > 4; }))
      << "one bad photograph stopped the others";
}

TEST_F(WindowTest, PicksTexelsByClickAndKeysAndUndoesThem) {
  auto window = makeWindow(fakeServices());
  open(*window, smallBundle());
  fitWithFake(*window);
  EXPECT_EQ(window->maps()->kind(), ViewKind::Diffuse);
  ImageView* view = window->maps()->view();
  const auto first = window->document()->pickedTexel();
  QTest::mouseClick(view, Qt::LeftButton, {}, view->widgetFromPicture({5.5, 3.5}).toPoint());
  EXPECT_EQ(window->document()->pickedTexel(), QPoint(5, 3));
  EXPECT_FALSE(window->inspector()->magnitudePlot()->series().empty());
  QTest::keyClick(view, Qt::Key_Right);
  EXPECT_EQ(window->document()->pickedTexel(), QPoint(6, 3));
  window->action("undo")->trigger();
  EXPECT_EQ(window->document()->pickedTexel(), QPoint(5, 3));
  window->action("undo")->trigger();
  EXPECT_EQ(window->document()->pickedTexel(), first);
  window->action("redo")->trigger();
  EXPECT_EQ(window->document()->pickedTexel(), QPoint(5, 3));
}

TEST_F(WindowTest, AClickOnAPhotographPicksTheTexelThere) {
  auto window = makeWindow(fakeServices());
  open(*window, smallBundle());
  fitWithFake(*window);
  window->maps()->setKind(ViewKind::Photo);
  ASSERT_TRUE(until([&] { return window->maps()->view()->picture() != nullptr; }));
  // The sample's centre, where the camera sees it.
  const auto pixel = window->document()->capture()->camera.pixelFromWorld({6, -4, 0});
  ASSERT_TRUE(pixel.has_value());
  ImageView* view = window->maps()->view();
  QTest::mouseClick(view, Qt::LeftButton, {},
                    view->widgetFromPicture({pixel->x() + 0.5, pixel->y() + 0.5}).toPoint());
  const auto picked = window->document()->pickedTexel();
  ASSERT_TRUE(picked.has_value());
  const auto& maps = window->document()->fit()->maps();
  EXPECT_NEAR(((picked->x() + 0.5) / maps.width - 0.5) * maps.widthMm, 6, maps.widthMm / maps.width);
  EXPECT_NEAR((0.5 - (picked->y() + 0.5) / maps.height) * maps.heightMm, -4, maps.heightMm / maps.height);
}

TEST_F(WindowTest, RangeControlsActOnTheMapAndUndo) {
  auto window = makeWindow(fakeServices());
  open(*window, smallBundle());
  fitWithFake(*window);
  window->action("view-sigma")->trigger();
  auto* high = window->findChild<QDoubleSpinBox*>("rangeHigh");
  auto* exposure = window->findChild<QDoubleSpinBox*>("exposure");
  EXPECT_FALSE(exposure->isEnabled());
  EXPECT_FALSE(exposure->toolTip().isEmpty());
  const double before = high->value();
  const QImage shot = window->maps()->view()->grab().toImage();
  high->setValue(1.0);
  EXPECT_DOUBLE_EQ(window->document()->tone(ViewKind::Sigma).high, 1.0);
  EXPECT_NE(window->maps()->view()->grab().toImage(), shot);
  window->action("undo")->trigger();
  EXPECT_DOUBLE_EQ(high->value(), before);
  EXPECT_EQ(window->maps()->view()->grab().toImage(), shot);
}

TEST_F(WindowTest, EveryMapHasATabAndAPicture) {
  auto window = makeWindow(fakeServices());
  open(*window, smallBundle());
  fitWithFake(*window);
  EXPECT_EQ(window->findChild<QTabBar*>("mapTabs")->count(), kTabCount);
  for (const auto& kind : viewKinds()) {
    if (isUncertainty(kind.kind)) continue;
    window->action(QStringLiteral("view-") + kind.id)->trigger();
    EXPECT_EQ(window->maps()->kind(), kind.kind);
    EXPECT_TRUE(until([&] { return window->maps()->view()->picture() != nullptr; })) << kind.id;
  }
}

TEST_F(WindowTest, StandardDeviationsTakeTheirParametersPlace) {
  auto window = makeWindow(fakeServices());
  open(*window, smallBundle());
  fitWithFake(*window);
  QAction* toggle = window->action(QStringLiteral("view-uncertainty"));
  window->action(QStringLiteral("view-sigma"))->trigger();
  ASSERT_EQ(window->maps()->kind(), ViewKind::Sigma);
  EXPECT_FALSE(toggle->isChecked());
  toggle->trigger();
  EXPECT_EQ(window->maps()->kind(), ViewKind::SigmaSd);
  EXPECT_TRUE(toggle->isChecked());
  EXPECT_TRUE(window->findChild<QToolButton*>("uncertainty")->isChecked());
  EXPECT_EQ(window->findChild<QTabBar*>("mapTabs")->currentIndex(), static_cast<int>(ViewKind::Sigma));
  // other tabs follow, those without a standard deviation stay what they are
  window->action(QStringLiteral("view-normal"))->trigger();
  EXPECT_EQ(window->maps()->kind(), ViewKind::NormalSd);
  window->action(QStringLiteral("view-status"))->trigger();
  EXPECT_EQ(window->maps()->kind(), ViewKind::Status);
  window->findChild<QToolButton*>("uncertainty")->click();
  window->action(QStringLiteral("view-normal"))->trigger();
  EXPECT_EQ(window->maps()->kind(), ViewKind::Normal);
  EXPECT_FALSE(toggle->isChecked());
}

TEST_F(WindowTest, DraggingOnTheSheetMovesTheLampAndItsLight) {
  auto window = makeWindow(fakeServices());
  open(*window, smallBundle());
  fitWithFake(*window);
  SheetViewport* sheet = window->viewport()->sheet();
  if (!sheet->usable()) GTEST_SKIP() << "no OpenGL on this display: " << sheet->failure().toStdString();
  QTest::qWait(50);
  const LampState before = window->document()->lamp();
  const QImage shot = sheet->grabFramebuffer();
  const QPoint from = sheet->widgetFromWorld({0, 0, 0}).toPoint(),
               to = sheet->widgetFromWorld({35, 20, 0}).toPoint();
  QTest::mousePress(sheet, Qt::LeftButton, {}, from);
  for (int i = 1; i <= 5; ++i) QTest::mouseMove(sheet, from + (to - from) * i / 5);
  QTest::mouseRelease(sheet, Qt::LeftButton, {}, to);
  const LampState after = window->document()->lamp();
  EXPECT_GT(after.positionMm.x(), before.positionMm.x() + 10);
  EXPECT_DOUBLE_EQ(after.positionMm.z(), before.positionMm.z());
  EXPECT_NE(sheet->grabFramebuffer(), shot);
  window->action("undo")->trigger();  // a drag is one step
  EXPECT_EQ(window->document()->lamp(), before);

  // By its handle: it stays under the cursor.
  const QPoint handle = sheet->widgetFromWorld(before.positionMm).toPoint();
  ASSERT_TRUE(sheet->rect().contains(handle)) << "the lamp starts out of sight";
  QTest::mousePress(sheet, Qt::LeftButton, {}, handle);
  QTest::mouseMove(sheet, handle + QPoint(15, 5));
  QTest::mouseMove(sheet, handle + QPoint(30, 10));
  QTest::mouseRelease(sheet, Qt::LeftButton, {}, handle + QPoint(30, 10));
  const QPointF now = sheet->widgetFromWorld(window->document()->lamp().positionMm);
  EXPECT_NEAR(now.x(), handle.x() + 30, 2);
  EXPECT_NEAR(now.y(), handle.y() + 10, 2);
}

TEST_F(WindowTest, TheSheetIsDrawnWhereTheViewSaysItIs) {
  auto window = makeWindow(fakeServices());
  open(*window, smallBundle());
  fitWithFake(*window);
  SheetViewport* sheet = window->viewport()->sheet();
  if (!sheet->usable()) GTEST_SKIP() << "no OpenGL on this display";
  sheet->viewFromAbove();
  QTest::qWait(50);
  const QImage shot = sheet->grabFramebuffer();
  const double ratio = shot.devicePixelRatio();
  const auto brightness = [&](double x, double y) {
    const QPoint at = (sheet->widgetFromWorld({x, y, 0}) * ratio).toPoint();
    return shot.rect().contains(at) ? qGray(shot.pixel(at)) : -1;
  };
  const auto& maps = window->document()->fit()->maps();
  EXPECT_GT(brightness(0.2 * maps.widthMm, -0.2 * maps.heightMm), 60);
  EXPECT_LT(brightness(0.56 * maps.widthMm, 0.2 * maps.heightMm), 60) << "light beside the sheet";
}

TEST_F(WindowTest, ASimulatedSampleIsPhotographedAndOpened) {
  Services services = Services::engine();
  std::filesystem::path asked;
  services.simulate = [&asked](const std::string&, const std::filesystem::path& folder,
                               const JobContext& job) {
    asked = folder;
    job.progress("expose", 1, 2, "rows");
    return readFourierCapture(smallBundle(), job);
  };
  auto window = makeWindow(services);
  QTest::mouseClick(window->findChild<QPushButton*>(QStringLiteral("emptySimulate")), Qt::LeftButton);
  EXPECT_TRUE(window->opening());
  ASSERT_TRUE(until([&] { return !window->opening(); }));
  EXPECT_TRUE(window->document()->capture());
  EXPECT_EQ(asked.filename(), "laminate");  // the first scene, in a folder of its own
  EXPECT_FALSE(window->findChild<QWidget*>(QStringLiteral("progressPane"))->isVisible());
  ASSERT_TRUE(window->action(QStringLiteral("simulate-mirror-mix")));
}

TEST_F(WindowTest, ASimulatedCaptureCanBeCancelled) {
  Services services = Services::engine();
  services.simulate = [](const std::string&, const std::filesystem::path&,
                         const JobContext& job) -> Result<FourierCapture> {
    while (!job.cancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return Error{ErrorCode::Cancelled, "cancelled", "", ""};
  };
  auto window = makeWindow(services);
  window->simulate("cardstock");
  EXPECT_TRUE(window->action(QStringLiteral("cancel"))->isEnabled());
  window->action(QStringLiteral("cancel"))->trigger();
  ASSERT_TRUE(until([&] { return !window->opening(); }, 2000));
  EXPECT_FALSE(window->document()->capture());
  EXPECT_FALSE(window->banner()->isVisible());
}

TEST_F(WindowTest, KeepsItsStateBetweenStarts) {
  FourierFitOptions options;
  options.maxIterations = 17;
  {
    auto window = makeWindow(fakeServices());
    open(*window, smallBundle());
    window->document()->setFitOptions(options);
    window->inspector()->setChannel(2);
    window->inspector()->setDirection(3);
    window->inspector()->setPage(1);
    window->action("show-strip")->setChecked(false);
    window->resize(1111, 777);
    QTest::qWait(50);
    EXPECT_TRUE(window->close());
  }
  auto window = makeWindow();
  window->resize(900, 700);
  MainWindow again(Services::engine(), settingsFile());
  EXPECT_EQ(again.size(), QSize(1111, 777));
  EXPECT_EQ(again.document()->fitOptions().maxIterations, 17);
  EXPECT_EQ(again.inspector()->channel(), 2);
  EXPECT_EQ(again.inspector()->direction(), 3);
  EXPECT_EQ(again.inspector()->page(), 1);
  EXPECT_FALSE(again.action("show-strip")->isChecked());
  EXPECT_FALSE(again.action("undo")->isEnabled());
  // The recent list offers the bundle, and opens it.
  QToolButton* recent = nullptr;
  for (QToolButton* button : again.findChild<EmptyState*>()->findChildren<QToolButton*>())
    if (button->text().startsWith("small sheet")) recent = button;
  ASSERT_NE(recent, nullptr);
  recent->click();
  EXPECT_TRUE(until([&] { return again.document()->capture() != nullptr; }));
}

TEST_F(WindowTest, AFitOfABundleThatWasReplacedIsDropped) {
  auto window = makeWindow(fakeServices(3000));
  open(*window, smallBundle());
  window->startFit();
  ASSERT_TRUE(until([&] { return window->findChild<QLabel*>("stage")->text().contains("Fitting texels"); }));
  const auto other = spoilableBundle("other");
  open(*window, other);
  EXPECT_FALSE(window->fitting());
  QTest::qWait(300);
  EXPECT_EQ(window->document()->fit(), nullptr);
  EXPECT_EQ(window->document()->capture()->folder.filename(), "other");
}

TEST_F(WindowTest, AsksBeforeAFitIsLost) {
  auto window = makeWindow(fakeServices());
  open(*window, smallBundle());
  fitWithFake(*window);
  int asked = 0;
  window->setAsk([&](const QString&, const QString&, const QString&, bool maySave) {
    ++asked;
    EXPECT_TRUE(maySave);
    return MainWindow::Answer::Stay;
  });
  EXPECT_FALSE(window->close());
  EXPECT_EQ(asked, 1);
  window->openPath(QString::fromStdString(spoilableBundle("other").string()));
  EXPECT_EQ(asked, 2);
  EXPECT_FALSE(window->opening());
  EXPECT_NE(window->document()->fit(), nullptr);
}

TEST_F(WindowTest, EveryActionHasATipAndEveryControlAName) {
  auto window = makeWindow();
  open(*window, smallBundle());
  for (QAction* action : window->findChildren<QAction*>())
    if (!action->objectName().isEmpty() && !action->isSeparator() && !action->text().isEmpty() &&
        !action->menu()) {
      EXPECT_FALSE(action->toolTip().isEmpty()) << action->objectName().toStdString();
    }
  for (QToolButton* button : window->findChildren<QToolButton*>()) {
    if (!button->isVisible() || button->objectName().startsWith("qt_") ||
        button->objectName().startsWith("Scroll"))
      continue;
    EXPECT_FALSE(button->toolTip().isEmpty()) << button->text().toStdString();
    if (!button->isEnabled()) continue;
    EXPECT_NE(button->focusPolicy(), Qt::NoFocus) << button->toolTip().toStdString();
  }
}

}  // namespace
}  // namespace patina::test
