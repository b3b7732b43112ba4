// The window on two-shot bundles, with a made-up reconstruction: opening, comparing, choosing, undoing,
// saving.
#include <QAction>
#include <QDoubleSpinBox>
#include <QDropEvent>
#include <QLabel>
#include <QMimeData>
#include <QProgressBar>
#include <QPushButton>
#include <QTabBar>
#include <QTableWidget>
#include <QUrl>
#include <atomic>
#include <fstream>
#include <thread>

#include "app/window/two_shot_controller.h"
#include "tests/ui/two_shot_fake.h"
#include "tests/ui/ui_fixture.h"
#include "widgets/comparison_panel.h"
#include "widgets/error_banner.h"
#include "widgets/image_view.h"
#include "widgets/map_panel.h"
#include "widgets/shot_strip.h"
#include "widgets/two_shot_page.h"
#include "widgets/two_shot_report.h"

namespace patina::test {
namespace {

class TwoShotWindowTest : public WindowTest {
 protected:
  /// Three shots of 48 x 48 pixels, one held out. Made once a process.
  static std::filesystem::path bundle(bool sheet = false) {
    static QTemporaryDir folder;
    const std::filesystem::path made =
        std::filesystem::path(folder.path().toStdString()) / (sheet ? "sheet" : "disc");
    if (!std::filesystem::exists(made)) simulateTwoShotBundle(made, 48, sheet);
    return made;
  }
  static void openTwoShot(MainWindow& window, const std::filesystem::path& path) {
    window.openPath(QString::fromStdString(path.string()));
    ASSERT_TRUE(until([&] { return !window.opening(); }));
    ASSERT_TRUE(window.twoShot()->isOpen()) << window.banner()->text().toStdString();
    ASSERT_TRUE(until([&] { return comparison(window)->view()->captured() != nullptr; }));
  }
  static void reconstruct(MainWindow& window) {
    window.action("fit")->trigger();
    ASSERT_TRUE(until([&] { return !window.fitting(); }));
    ASSERT_TRUE(window.twoShot()->fitted()) << window.banner()->text().toStdString();
  }
  static ComparisonPanel* comparison(MainWindow& window) { return window.twoShot()->page()->comparison(); }
  static ShotStrip* strip(MainWindow& window) { return window.twoShot()->page()->strip(); }
};

TEST_F(TwoShotWindowTest, ABundleOpensOnItsOwnPage) {
  std::atomic<bool> onWindowThread = false;
  Services services = fakeTwoShotServices();
  const auto here = std::this_thread::get_id();
  services.readTwoShotPhoto = [&](const TwoShotCapture& capture, const TwoShotPhoto& photo) {
    if (std::this_thread::get_id() == here) onWindowThread = true;
    return readPhoto(capture, photo);
  };
  auto window = makeWindow(services);
  openTwoShot(*window, bundle());
  EXPECT_TRUE(window->twoShot()->page()->isVisible());
  EXPECT_EQ(window->document()->capture(), nullptr);
  // Fitted, held out, white: in this order, and marked.
  ASSERT_EQ(strip(*window)->count(), 6);
  EXPECT_EQ(strip(*window)->entry(0).title, "Shot 1");
  EXPECT_EQ(strip(*window)->entry(2).title, "Held out 1");
  EXPECT_TRUE(strip(*window)->entry(3).white);
  EXPECT_TRUE(strip(*window)->model()->index(2, 0).data(Qt::ToolTipRole).toString().contains("Held out"));
  EXPECT_TRUE(until([&] { return window->twoShot()->page()->photos()->thumbnailsLoaded() == 6; }));
  EXPECT_FALSE(onWindowThread);
  EXPECT_EQ(comparison(*window)->view()->rendered(), nullptr);
  EXPECT_TRUE(window->action("fit")->isEnabled());
  EXPECT_TRUE(window->action("fit")->text().contains("Reconstruct"));
  EXPECT_FALSE(window->action("view-difference")->isEnabled());
  EXPECT_TRUE(window->action("view-difference")->toolTip().contains("Not now"));
  EXPECT_FALSE(window->action("view-sigma")->isVisible());
  EXPECT_TRUE(window->findChild<QLabel*>("health")->text().contains("Not reconstructed yet"));
}

TEST_F(TwoShotWindowTest, FourierAndTwoShotBundlesReplaceEachOther) {
  auto window = makeWindow(fakeTwoShotServices());
  openTwoShot(*window, bundle());
  open(*window, smallBundle());
  EXPECT_FALSE(window->twoShot()->isOpen());
  EXPECT_TRUE(window->maps()->isVisible());
  EXPECT_TRUE(window->action("view-sigma")->isVisible());
  EXPECT_TRUE(window->action("fit")->text().contains("Fit"));
  openTwoShot(*window, bundle());
  EXPECT_EQ(window->document()->capture(), nullptr);
  EXPECT_FALSE(window->maps()->isVisible());
}

TEST_F(TwoShotWindowTest, ReconstructsAndComparesByWipeAndDifference) {
  auto window = makeWindow(fakeTwoShotServices());
  openTwoShot(*window, bundle());
  reconstruct(*window);
  ComparisonView* view = comparison(*window)->view();
  ASSERT_NE(view->rendered(), nullptr);
  EXPECT_NEAR(view->divider(), 0.5, 1e-9);

  // The divider follows the mouse; what it uncovers changes.
  const QImage before = view->grab().toImage();
  const QPoint from(view->width() / 2, view->height() / 3);
  const QPoint to(view->width() / 4, view->height() / 3);
  QTest::mousePress(view, Qt::LeftButton, {}, from);
  for (int i = 1; i <= 4; ++i) QTest::mouseMove(view, from + (to - from) * i / 4);
  QTest::mouseRelease(view, Qt::LeftButton, {}, to);
  EXPECT_NEAR(view->divider(), 0.25, 0.02);
  EXPECT_NE(view->grab().toImage(), before);
  QTest::keyClick(view, Qt::Key_Right);
  EXPECT_NEAR(view->divider(), 0.27, 0.02);
  QTest::mouseDClick(view, Qt::LeftButton, {}, QPoint(view->width() / 2, view->height() / 2));
  EXPECT_NEAR(view->divider(), 0.5, 1e-9);

  // Difference: 20 % too bright everywhere, in one colour, with a colour bar.
  window->action("view-difference")->trigger();
  EXPECT_EQ(comparison(*window)->mode(), ComparisonMode::Difference);
  QTest::qWait(30);
  const QImage difference = view->grab().toImage();
  const QPoint centre =
      view->widgetFromPicture({view->captured()->width() / 2.0, view->captured()->height() / 2.0}).toPoint();
  ToneSettings range;
  range.low = -0.5;
  range.high = 0.5;
  const std::array<float, 1> twenty{0.2f};
  const QColor expected(ToneMapper(ToneStyle::Diverging, range)(twenty)),
      got(difference.pixel(centre * difference.devicePixelRatio()));
  EXPECT_NEAR(got.red(), expected.red(), 6);
  EXPECT_NEAR(got.blue(), expected.blue(), 6);
  EXPECT_GT(got.red(), got.blue()) << "too bright is orange";
  auto* spin = window->findChild<QDoubleSpinBox*>("differenceRange");
  EXPECT_TRUE(spin->isEnabled());
  spin->setValue(20);
  QTest::qWait(30);
  const QColor brighter(view->grab().toImage().pixel(centre * difference.devicePixelRatio()));
  EXPECT_GT(brighter.red(), got.red());
}

TEST_F(TwoShotWindowTest, SideBySideShowsBothWithOneZoom) {
  auto window = makeWindow(fakeTwoShotServices());
  openTwoShot(*window, bundle());
  reconstruct(*window);
  ComparisonView* view = comparison(*window)->view();
  view->resize(600, 300);
  window->action("view-side")->trigger();
  QTest::qWait(30);
  const double zoom = view->zoom();
  const QPoint inSecond(view->width() * 3 / 4, view->height() / 2);
  const QPointF place = view->pictureFromWidget(inSecond);
  EXPECT_NEAR(place.x(), view->captured()->width() / 2.0, 2) << "the second picture is not in its own half";
  view->zoomBy(2, inSecond);
  EXPECT_NEAR(view->zoom(), 2 * zoom, 1e-9);
  const QPointF after = view->pictureFromWidget(inSecond);
  EXPECT_NEAR(after.x(), place.x(), 0.5) << "zoom at the cursor";
}

TEST_F(TwoShotWindowTest, ReadsOutValuesAndDirectionsUnderTheCursor) {
  auto window = makeWindow(fakeTwoShotServices());
  openTwoShot(*window, bundle());
  reconstruct(*window);
  ComparisonView* view = comparison(*window)->view();
  const TwoShotCapture& capture = *window->twoShot()->document()->capture();
  const QPoint pixel(view->captured()->width() / 2, view->captured()->height() / 2);
  QTest::mouseMove(view, view->widgetFromPicture(QPointF(pixel) + QPointF(0.5, 0.5)).toPoint());
  QTest::qWait(20);
  const QString said = comparison(*window)->readout();
  EXPECT_TRUE(said.contains("ratio 1.20")) << said.toStdString();
  const auto angles = anglesAtPixel(capture, capture.shots[0], pixel.x(), pixel.y());
  ASSERT_TRUE(angles.has_value());
  EXPECT_TRUE(said.contains(namedAnglesText(*angles, 1))) << said.toStdString();
  // The centre was photographed at 6 and 38 degrees.
  EXPECT_NEAR(angles->thetaDRad * 57.29578, 38, 1.5);
}

TEST_F(TwoShotWindowTest, AHeldOutShotIsChosenByAClickAndShowsItsError) {
  auto window = makeWindow(fakeTwoShotServices());
  openTwoShot(*window, bundle());
  reconstruct(*window);
  const Image* before = comparison(*window)->view()->captured();
  const QRect item = strip(*window)->visualRect(strip(*window)->model()->index(2, 0));
  QTest::mouseClick(strip(*window)->viewport(), Qt::LeftButton, {}, item.center());
  EXPECT_EQ(strip(*window)->current(), 2);
  EXPECT_NE(comparison(*window)->view()->captured(), before);
  EXPECT_NE(comparison(*window)->view()->rendered(), nullptr);
  const QString caption = window->findChild<QLabel*>("shotCaption")->text();
  EXPECT_TRUE(caption.contains("Held out 1")) << caption.toStdString();
  EXPECT_TRUE(caption.contains("RMS 20 %")) << caption.toStdString();
  // A white tile has no reconstruction.
  strip(*window)->setCurrent(3);
  ASSERT_TRUE(until([&] { return comparison(*window)->view()->captured() != nullptr; }));
  EXPECT_EQ(comparison(*window)->view()->rendered(), nullptr);
}

TEST_F(TwoShotWindowTest, SaysInWordsWhatToExpectAndWhatWasReached) {
  auto window = makeWindow(fakeTwoShotServices());
  openTwoShot(*window, bundle());
  TwoShotReport* report = window->twoShot()->page()->report();
  EXPECT_TRUE(report->text().contains("Not reconstructed yet"));
  reconstruct(*window);
  const QString said = report->text();
  for (const char* part : {"25 %", "held out", "third shot", "17 clipped", "eta 40"})
    EXPECT_TRUE(said.contains(part)) << part << " in: " << said.toStdString();
  EXPECT_FALSE(report->materials()->isVisible());
  EXPECT_TRUE(window->findChild<QLabel*>("health")->text().contains("held-out RMS 20 %"));
}

TEST_F(TwoShotWindowTest, AMaterialIsChosenFromTheListAndTheMapAndUndone) {
  auto window = makeWindow(fakeTwoShotServices(0, 2));
  openTwoShot(*window, bundle(true));
  reconstruct(*window);
  TwoShotDocument* document = window->twoShot()->document();
  QTableWidget* list = window->twoShot()->page()->report()->materials();
  ASSERT_TRUE(list->isVisible());
  ASSERT_EQ(list->rowCount(), 2);
  QTest::mouseClick(list->viewport(), Qt::LeftButton, {}, list->visualItemRect(list->item(1, 0)).center());
  EXPECT_EQ(document->material(), 1);
  window->action("undo")->trigger();
  EXPECT_EQ(document->material(), 0);
  EXPECT_EQ(list->currentRow(), 0);
  // In the map: a click on the right half.
  window->action("view-materials")->trigger();
  ImageView* labels = comparison(*window)->labels();
  ASSERT_TRUE(labels->isVisible());
  const auto& map = document->fit()->labels;
  QPoint place(-1, -1);
  for (int x = map.width() - 1; x >= 0 && place.x() < 0; --x)
    if (map.at(x, map.height() / 2) == 1) place = {x - 2, map.height() / 2};
  QTest::mouseClick(labels, Qt::LeftButton, {},
                    labels->widgetFromPicture(place + QPointF(0.5, 0.5)).toPoint());
  EXPECT_EQ(document->material(), 1);
}

TEST_F(TwoShotWindowTest, OptionsAndFitsAreUndone) {
  auto window = makeWindow(fakeTwoShotServices());
  openTwoShot(*window, bundle());
  TwoShotDocument* document = window->twoShot()->document();
  TwoShotChoices choices = document->choices();
  choices.fit.eta = 7;
  document->setChoices(choices);
  reconstruct(*window);
  const auto first = document->fit();
  EXPECT_DOUBLE_EQ(first->options.eta, 7);
  reconstruct(*window);
  ASSERT_NE(document->fit(), first);
  window->action("undo")->trigger();
  EXPECT_EQ(document->fit(), first);
  EXPECT_NE(comparison(*window)->view()->rendered(), nullptr);
  window->action("redo")->trigger();
  EXPECT_NE(document->fit(), first);
  while (window->action("undo")->isEnabled()) window->action("undo")->trigger();
  EXPECT_DOUBLE_EQ(document->choices().fit.eta, kPaperEta);
}

TEST_F(TwoShotWindowTest, ARunningReconstructionIsCancelled) {
  auto window = makeWindow(fakeTwoShotServices(20000));
  openTwoShot(*window, bundle());
  window->action("fit")->trigger();
  ASSERT_TRUE(until([&] { return window->findChild<QLabel*>("stage")->text().contains("Solving"); }));
  EXPECT_TRUE(window->findChild<QWidget*>("progressPane")->isVisible());
  QTest::mouseClick(window->findChild<QPushButton*>("cancelButton"), Qt::LeftButton);
  ASSERT_TRUE(until([&] { return !window->fitting(); }, 5000));
  EXPECT_FALSE(window->twoShot()->fitted());
  EXPECT_FALSE(window->banner()->isVisible()) << "cancelling is no error";
  EXPECT_FALSE(window->findChild<QWidget*>("progressPane")->isVisible());
  EXPECT_TRUE(window->action("fit")->isEnabled());
}

TEST_F(TwoShotWindowTest, AFailedReconstructionSaysWhy) {
  Services services = fakeTwoShotServices();
  services.fitTwoShot = [](const TwoShotCapture&, const std::filesystem::path&, const TwoShotFitOptions&,
                           const JobContext&) -> Result<Services::TwoShotFitPtr> {
    return Error{ErrorCode::Invalid, "every pixel of the sample is clipped", "shot_000.exr",
                 "photograph it with a shorter exposure"};
  };
  auto window = makeWindow(services);
  openTwoShot(*window, bundle());
  window->action("fit")->trigger();
  ASSERT_TRUE(until([&] { return window->banner()->isVisible(); }));
  EXPECT_EQ(window->banner()->kind(), ErrorBanner::Kind::Problem);
  EXPECT_TRUE(window->banner()->text().contains("clipped"));
  EXPECT_TRUE(window->banner()->text().contains("shorter exposure"));
}

TEST_F(TwoShotWindowTest, ABadBundleShowsABannerAndLeavesTheWindowAsItWas) {
  auto window = makeWindow(fakeTwoShotServices());
  openTwoShot(*window, bundle());
  const auto before = window->twoShot()->document()->capture();
  const auto bad = temporary() / "bad";
  std::filesystem::create_directories(bad);
  std::ofstream(bad / "capture.json")
      << R"({ "format": "patina-capture", "version": 1, "kind": "two-shot" })";
  window->openPath(QString::fromStdString(bad.string()));
  ASSERT_TRUE(until([&] { return window->banner()->isVisible(); }));
  EXPECT_EQ(window->banner()->kind(), ErrorBanner::Kind::Problem);
  EXPECT_TRUE(window->banner()->text().contains("Opening bad"));
  EXPECT_EQ(window->twoShot()->document()->capture(), before);
}

TEST_F(TwoShotWindowTest, ADropOpensATwoShotBundleAndItIsRemembered) {
  auto window = makeWindow(fakeTwoShotServices());
  QMimeData data;
  data.setUrls({QUrl::fromLocalFile(QString::fromStdString((bundle() / "capture.json").string()))});
  QDragEnterEvent enter(QPoint(400, 300), Qt::CopyAction, &data, Qt::LeftButton, Qt::NoModifier);
  QCoreApplication::sendEvent(window.get(), &enter);
  EXPECT_TRUE(enter.isAccepted());
  QDropEvent event(QPointF(400, 300), Qt::CopyAction, &data, Qt::LeftButton, Qt::NoModifier);
  QCoreApplication::sendEvent(window.get(), &event);
  ASSERT_TRUE(until([&] { return window->twoShot()->isOpen(); }));
  Settings settings(settingsFile());
  EXPECT_TRUE(settings.recent().contains(QString::fromStdString(bundle().string())));
}

TEST_F(TwoShotWindowTest, AsksBeforeAReconstructionIsLost) {
  auto window = makeWindow(fakeTwoShotServices());
  openTwoShot(*window, bundle());
  reconstruct(*window);
  int asked = 0;
  window->setAsk([&](const QString&, const QString&, const QString&, bool maySave) {
    ++asked;
    EXPECT_TRUE(maySave);
    return MainWindow::Answer::Stay;
  });
  EXPECT_FALSE(window->close());
  window->openPath(QString::fromStdString(smallBundle().string()));
  EXPECT_EQ(asked, 2);
  EXPECT_TRUE(window->twoShot()->fitted());
}

TEST_F(TwoShotWindowTest, SavesByTheServiceAndOpensWhatItSaved) {
  Services services = fakeTwoShotServices();
  std::filesystem::path written;
  services.writeTwoShotFit = [&](const std::filesystem::path& folder, const TwoShotFit&) -> Status {
    written = folder;
    std::filesystem::create_directories(folder);
    std::ofstream(folder / "fit.json") << R"({"kind": "two-shot"})";
    return Done{};
  };
  services.loadTwoShotFit = [&](const std::filesystem::path& folder,
                                const JobContext& job) -> Result<Services::TwoShotFitPtr> {
    EXPECT_EQ(folder, written);
    const auto capture = readTwoShotCapture(bundle(), job);
    if (!capture) return capture.error();
    TwoShotFitOptions options;
    options.eta = 12;
    return fakeTwoShotFit(*capture, options);
  };
  auto window = makeWindow(services);
  openTwoShot(*window, bundle());
  EXPECT_FALSE(window->action("save")->isEnabled());
  reconstruct(*window);
  EXPECT_TRUE(window->windowTitle().contains("not saved"));
  const QString folder = temporary_.filePath("kept");
  window->saveFitTo(folder);
  ASSERT_TRUE(until([&] { return !window->saving(); }));
  EXPECT_EQ(written, folder.toStdString());
  EXPECT_FALSE(window->windowTitle().contains("not saved"));

  auto again = makeWindow(services);
  again->openPath(folder);
  ASSERT_TRUE(until([&] { return !again->opening(); }));
  ASSERT_TRUE(again->twoShot()->fitted()) << again->banner()->text().toStdString();
  EXPECT_NE(comparison(*again)->view()->rendered(), nullptr);
  EXPECT_DOUBLE_EQ(again->twoShot()->document()->choices().fit.eta, 12);
  EXPECT_FALSE(again->action("undo")->isEnabled()) << "opening is not a step";
}

TEST_F(TwoShotWindowTest, KeepsItsStateBetweenStarts) {
  {
    auto window = makeWindow(fakeTwoShotServices());
    openTwoShot(*window, bundle());
    reconstruct(*window);
    TwoShotChoices choices;
    choices.fit.eta = 3;
    choices.fit.clusters = 0;
    window->twoShot()->document()->setChoices(choices);
    comparison(*window)->setMode(ComparisonMode::SideBySide);
    comparison(*window)->setExposureEv(1.5);
    EXPECT_TRUE(window->close());
  }
  MainWindow again(fakeTwoShotServices(), settingsFile());
  EXPECT_DOUBLE_EQ(again.twoShot()->document()->choices().fit.eta, 3);
  EXPECT_EQ(again.twoShot()->document()->choices().fit.clusters, 0);
  EXPECT_EQ(comparison(again)->mode(), ComparisonMode::SideBySide);
  EXPECT_DOUBLE_EQ(comparison(again)->exposureEv(), 1.5);
}

TEST_F(TwoShotWindowTest, ASimulatedTwoShotSampleIsPhotographedAndOpened) {
  Services services = fakeTwoShotServices();
  std::string asked;
  services.simulateTwoShot = [&](const std::string& scene, const std::filesystem::path&,
                                 const JobContext& job) {
    asked = scene;
    return readTwoShotCapture(bundle(), job);
  };
  auto window = makeWindow(services);
  QAction* simulate = window->action("simulate-bronze-disc");
  ASSERT_NE(simulate, nullptr);
  simulate->trigger();
  ASSERT_TRUE(until([&] { return window->twoShot()->isOpen(); }));
  EXPECT_EQ(asked, "bronze-disc");
}

TEST_F(TwoShotWindowTest, EveryControlHasATip) {
  auto window = makeWindow(fakeTwoShotServices(0, 2));
  openTwoShot(*window, bundle(true));
  reconstruct(*window);
  for (QToolButton* button : window->findChildren<QToolButton*>()) {
    if (!button->isVisible() || button->objectName().startsWith("qt_") ||
        button->objectName().startsWith("Scroll"))
      continue;
    EXPECT_FALSE(button->toolTip().isEmpty()) << button->text().toStdString();
  }
  for (QWidget* widget : comparison(*window)->findChildren<QWidget*>())
    if (widget->isVisible() && !widget->isEnabled() && widget->parentWidget()->isEnabled() &&
        !qobject_cast<QLabel*>(widget)) {
      EXPECT_TRUE(widget->toolTip().contains("Not now"))
          << widget->objectName().toStdString() << ": " << widget->toolTip().toStdString();
    }
}

}  // namespace
}  // namespace patina::test
