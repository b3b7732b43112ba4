// The sphere and the slices of a measured BRDF, driven.
#include <gtest/gtest.h>

#include <QCheckBox>
#include <QComboBox>
#include <QElapsedTimer>
#include <QLabel>
#include <QSignalSpy>
#include <QTemporaryDir>
#include <QTest>
#include <QToolButton>
#include <QWheelEvent>
#include <filesystem>

#include "engine/image/exr.h"
#include "tests/render/measured_material.h"
#include "widgets/brdf_slices_panel.h"
#include "widgets/brdf_sphere_canvas.h"
#include "widgets/brdf_sphere_viewport.h"
#include "widgets/certainty_bar.h"
#include "widgets/flow_layout.h"
#include "widgets/plot_widget.h"
#include "widgets/slice_picture.h"

namespace patina {
namespace {

constexpr int kPatienceMs = 120000;  ///< a busy machine

std::shared_ptr<const TabulatedBrdf> redPlastic() {
  static const auto brdf = test::glossy({0.42, 0.09, 0.04}, 0.12, 400);
  return brdf;
}

/// Well known in and near the highlight, and less and less beyond.
std::shared_ptr<const std::vector<float>> someCertainty() {
  static const auto sd = [] {
    auto values = std::make_shared<std::vector<float>>(MerlGrid::kCells);
    for (std::size_t cell = 0; cell < MerlGrid::kCells; ++cell) {
      const HalfDiffAngles at = MerlGrid::centre(cell);
      const double far = std::hypot(at.thetaHRad - 0.2, 0.7 * (at.thetaDRad - 0.5));
      (*values)[cell] = static_cast<float>(0.06 + 0.84 * (1 - std::exp(-far * far / 0.18)));
    }
    return values;
  }();
  return sd;
}

struct SphereUnderTest {
  BrdfSphereViewport view;
  explicit SphereUnderTest(QSize size = {420, 480}, bool withMaterial = true) {
    view.resize(size);
    view.show();
    EXPECT_TRUE(QTest::qWaitForWindowExposed(&view));
    if (withMaterial) view.setMaterial(redPlastic(), someCertainty(), 0.9);
  }
  BrdfSphereCanvas& canvas() { return *view.canvas(); }
  /// Until a picture of what is set now has so many samples.
  bool until(int samples) {
    return QTest::qWaitFor([&] { return canvas().samples() >= samples && canvas().upToDate(); }, kPatienceMs);
  }
  QPoint at(double x, double y) { return canvas().widgetFromSphere({x, y}).toPoint(); }
  /// Mean of the picture round a place, red, green, blue, 0 to 255.
  Eigen::Array3d colourAt(double x, double y) {
    const QImage& picture = canvas().sphere();
    const int px = static_cast<int>((0.5 + x * kMeasuredSphereRadius) * picture.width()),
              py = static_cast<int>((0.5 - y * kMeasuredSphereRadius) * picture.height());
    Eigen::Array3d sum = Eigen::Array3d::Zero();
    for (int dy = -2; dy <= 2; ++dy)
      for (int dx = -2; dx <= 2; ++dx) {
        const QColor colour = picture.pixelColor(px + dx, py + dy);
        sum += Eigen::Array3d(colour.red(), colour.green(), colour.blue()) / 25;
      }
    return sum;
  }
};

void keep(QWidget& widget, const QString& name) {
  std::filesystem::create_directories(PATINA_SCREENSHOT_DIR);
  EXPECT_TRUE(widget.grab().save(QStringLiteral(PATINA_SCREENSHOT_DIR "/") + name));
}

TEST(BrdfSphereViewport, IsEmptyWithoutAMaterial) {
  SphereUnderTest under({420, 480}, false);
  EXPECT_TRUE(under.canvas().sphere().isNull());
  EXPECT_FALSE(under.view.findChild<QComboBox*>("sphereEnvironment")->isEnabled());
  keep(under.view, "brdf_sphere_empty.png");
  under.view.setMaterial(redPlastic());
  ASSERT_TRUE(under.until(16));
  EXPECT_FALSE(under.view.findChild<QCheckBox*>("sphereCertainty")->isEnabled());
  under.view.setMaterial(nullptr);
  QTest::qWait(300);
  EXPECT_TRUE(under.canvas().sphere().isNull()) << "a late picture was shown";
}

TEST(BrdfSphereViewport, ShowsACoarsePictureFirstAndThenAFineOne) {
  SphereUnderTest under({170, 260});  // small: the finest picture of a large one takes seconds
  QSignalSpy rendered(&under.view, &BrdfSphereViewport::rendered);
  ASSERT_TRUE(QTest::qWaitFor([&] { return !under.canvas().sphere().isNull(); }, kPatienceMs));
  const int first = under.canvas().sphere().width();
  ASSERT_TRUE(QTest::qWaitFor([&] { return rendered.count() > 0; }, kPatienceMs));
  EXPECT_GT(under.canvas().sphere().width(), first);
  EXPECT_TRUE(under.canvas().finest());
  const Eigen::Array3d colour = under.colourAt(0.2, -0.3);
  EXPECT_GT(colour[0], 1.4 * colour[1]) << "red plastic is red";
  // Opaque inside, nothing outside, and on the screen too.
  EXPECT_EQ(qAlpha(under.canvas().sphere().pixel(under.canvas().sphere().width() / 2, 40)), 255);
  EXPECT_EQ(qAlpha(under.canvas().sphere().pixel(1, 1)), 0);
  const QImage screen = under.view.grab().toImage();
  const QPoint middle = under.at(0.2, -0.3) * screen.devicePixelRatio();
  const QColor seen = screen.pixelColor(middle);
  EXPECT_NEAR(seen.red(), colour[0], 12);
  EXPECT_NEAR(seen.green(), colour[1], 12);
}

TEST(BrdfSphereViewport, TheWindowNeverWaits) {
  SphereUnderTest under({700, 760});
  ASSERT_TRUE(under.until(16));
  double longest = 0;
  for (int i = 0; i < 40; ++i) {
    QElapsedTimer timer;
    timer.start();
    under.view.setToLight({0.02f * static_cast<float>(i) - 0.4f, 0.3f, 0.8f});
    under.view.setExposureEv(0.05 * i);
    longest = std::max(longest, timer.nsecsElapsed() * 1e-6);
    QTest::qWait(5);
  }
  EXPECT_LT(longest, 100) << "milliseconds in a setter";
}

TEST(BrdfSphereViewport, ADragTurnsTheRoomAndSomethingFollowsWhileItMoves) {
  SphereUnderTest under;
  ASSERT_TRUE(under.until(32));
  const float before = under.canvas().yawRad();
  QSignalSpy shown(under.canvas().worker(), &SphereWorker::shown);
  QTest::mousePress(&under.canvas(), Qt::LeftButton, {}, under.at(-0.4, 0));
  for (int i = 1; i <= 40; ++i) {
    QTest::mouseMove(&under.canvas(), under.at(-0.4 + 0.02 * i, 0));
    QTest::qWait(15);
  }
  const int whileMoving = static_cast<int>(shown.count());
  QTest::mouseRelease(&under.canvas(), Qt::LeftButton, {}, under.at(0.4, 0));
  EXPECT_NE(under.canvas().yawRad(), before);
  EXPECT_GE(whileMoving, 2) << "nothing was shown until the cursor stood still";
  QTest::mouseDClick(&under.canvas(), Qt::LeftButton, {}, under.at(0, 0));
  EXPECT_FLOAT_EQ(under.canvas().yawRad(), 0);
}

TEST(BrdfSphereViewport, TheHighlightFollowsARightDrag) {
  SphereUnderTest under;
  under.view.setEnvironment("");
  under.view.setLightOn(true);
  QTest::mousePress(&under.canvas(), Qt::RightButton, {}, under.at(0, 0));
  QTest::mouseMove(&under.canvas(), under.at(0.2, 0));
  QTest::mouseMove(&under.canvas(), under.at(0.45, -0.3));
  QTest::mouseRelease(&under.canvas(), Qt::RightButton, {}, under.at(0.45, -0.3));
  ASSERT_TRUE(under.until(32));
  // Green and blue are the highlight's alone, nearly: it is where the cursor was.
  EXPECT_GT(under.colourAt(0.45, -0.3)[2], under.colourAt(-0.3, 0.3)[2] + 60);
  EXPECT_GT(under.colourAt(0.45, -0.3)[2], under.colourAt(0.2, 0)[2] + 30);
}

TEST(BrdfSphereViewport, TheLampCanBeTakenBehindTheSphere) {
  SphereUnderTest under;
  under.view.setLightOn(true);
  under.view.setToLight({1, 0, 0.3f});
  const QPointF lamp = QPointF(1, 0) * 1.13 * under.view.toLight().x();
  const QPoint from = under.canvas().widgetFromSphere(lamp).toPoint();
  QTest::mousePress(&under.canvas(), Qt::LeftButton, {}, from);
  QTest::mouseMove(&under.canvas(), from + QPoint(10, 0));
  QTest::mouseMove(&under.canvas(), from + QPoint(40, 0));
  QTest::mouseRelease(&under.canvas(), Qt::LeftButton, {}, from + QPoint(40, 0));
  EXPECT_LT(under.view.toLight().z(), 0);
  EXPECT_NEAR(under.view.toLight().norm(), 1, 1e-5);
}

TEST(BrdfSphereViewport, IsWorkedByKeys) {
  SphereUnderTest under;
  under.view.setLightOn(true);
  under.canvas().setFocus(Qt::TabFocusReason);
  const Eigen::Vector3f light = under.view.toLight();
  QTest::keyClick(&under.canvas(), Qt::Key_Left);
  QTest::keyClick(&under.canvas(), Qt::Key_Up);
  EXPECT_NE(under.canvas().yawRad(), 0);
  EXPECT_NE(under.canvas().pitchRad(), 0);
  EXPECT_EQ(under.view.toLight(), light);
  QTest::keyClick(&under.canvas(), Qt::Key_Right, Qt::ShiftModifier);
  EXPECT_GT(under.view.toLight().x(), light.x());
  QTest::keyClick(&under.canvas(), Qt::Key_Plus);
  EXPECT_GT(under.canvas().zoom(), 1);
  QTest::keyClick(&under.canvas(), Qt::Key_Home);
  EXPECT_EQ(under.canvas().zoom(), 1);
  EXPECT_FLOAT_EQ(under.canvas().yawRad(), 0);
}

TEST(BrdfSphereViewport, TheWheelZoomsAndTheSphereGetsMorePixels) {
  SphereUnderTest under;
  ASSERT_TRUE(under.until(32));  // the first picture of full size
  const int before = under.canvas().sphere().width();
  const QPointF middle = under.at(0, 0);
  QWheelEvent wheel(middle, under.canvas().mapToGlobal(middle), {}, {0, 480}, Qt::NoButton, Qt::NoModifier,
                    Qt::NoScrollPhase, false);
  QCoreApplication::sendEvent(&under.canvas(), &wheel);
  EXPECT_GT(under.canvas().zoom(), 1.5);
  EXPECT_TRUE(QTest::qWaitFor([&] { return under.canvas().sphere().width() > 1.4 * before; }, kPatienceMs));
}

TEST(BrdfSphereViewport, TheOverlayPaintsMeasuredBlueAndExtrapolatedOrange) {
  SphereUnderTest under;
  under.view.setEnvironment("");
  under.view.setLightOn(true);
  under.view.setToLight({-0.3f, 0.3f, 0.9f});
  under.view.setOverlayOn(true);
  ASSERT_TRUE(under.until(32));
  const auto* bar = under.view.findChild<CertaintyBar*>();
  ASSERT_NE(bar, nullptr);
  EXPECT_TRUE(bar->isVisible());
  const Eigen::Array3d known = under.colourAt(-0.15, 0.15), unknown = under.colourAt(0.6, -0.6);
  EXPECT_GT(known[2], known[0] + 20);
  EXPECT_GT(unknown[0], unknown[2] + 20);
  // And the number under the cursor is drawn without harm.
  QTest::mouseMove(&under.canvas(), under.at(0.3, 0.1));
  keep(under.view, "brdf_sphere_certainty_light.png");
  under.view.setOverlayOn(false);
  EXPECT_FALSE(bar->isVisible());
}

TEST(BrdfSphereViewport, OpensAPersonsSurroundingsAndSaysWhatIsWrongWithOthers) {
  QTemporaryDir folder;
  Image half(64, 32, 3, 0.02f);
  for (int y = 0; y < 32; ++y)
    for (int x = 32; x < 64; ++x) half.at(x, y, 2) = 3;  // blue from the right
  const QString good = folder.filePath("blue right.exr"), bad = folder.filePath("square.exr");
  ASSERT_TRUE(writeExr(good.toStdString(), half, {"R", "G", "B"}).ok());
  ASSERT_TRUE(writeExr(bad.toStdString(), Image(32, 32, 3, 1.0f), {"R", "G", "B"}).ok());
  SphereUnderTest under;
  QSignalSpy failed(&under.view, &BrdfSphereViewport::failed);
  auto* choice = under.view.findChild<QComboBox*>("sphereEnvironment");
  under.view.setChooseFile([&] { return bad; });
  const int open = choice->findData("open");
  Q_EMIT choice->activated(open);
  ASSERT_TRUE(QTest::qWaitFor([&] { return failed.count() == 1; }, kPatienceMs));
  EXPECT_TRUE(failed[0][0].toString().contains("32 x 32"));
  EXPECT_EQ(under.view.environment(), "studio") << "what was shown stays";
  under.view.setChooseFile([&] { return good; });
  Q_EMIT choice->activated(open);
  ASSERT_TRUE(QTest::qWaitFor([&] { return under.view.environment() == "file"; }, kPatienceMs));
  EXPECT_EQ(choice->currentText(), "blue right");
  ASSERT_TRUE(under.until(64));
  EXPECT_GT(under.colourAt(0.8, 0)[2], under.colourAt(-0.8, 0)[2] + 20);
  under.view.setChooseFile([] { return QString(); });
  Q_EMIT choice->activated(choice->findData("open"));
  EXPECT_EQ(under.view.environment(), "file") << "changing one's mind changes nothing";
}

TEST(BrdfSphereViewport, EveryControlHasANameAndAHint) {
  SphereUnderTest under;
  for (QWidget* widget : under.view.findChildren<QWidget*>()) {
    if (!(widget->focusPolicy() & Qt::TabFocus) || widget->inherits("QAbstractItemView") ||
        widget->parentWidget()->inherits("QAbstractSpinBox"))
      continue;
    const auto* box = qobject_cast<QAbstractButton*>(widget);
    EXPECT_FALSE(widget->accessibleName().isEmpty() && (!box || box->text().isEmpty()))
        << widget->metaObject()->className();
    EXPECT_FALSE(widget->toolTip().isEmpty()) << widget->metaObject()->className();
  }
}

TEST(BrdfSphereViewport, LooksRightAtSeveralSizes) {
  for (const QSize size : {QSize(300, 340), QSize(420, 480), QSize(900, 640)}) {
    for (const char* id : {"studio", "window", "clear"}) {
      SphereUnderTest under(size);
      under.view.setEnvironment(id);
      under.view.setLightOn(id == std::string("window"));
      under.view.setOverlayOn(id == std::string("clear"));
      ASSERT_TRUE(under.until(32));
      for (QWidget* child : under.view.findChildren<QWidget*>())
        if (child->isVisible()) {
          EXPECT_TRUE(
              under.view.rect().contains(QRect(child->mapTo(&under.view, QPoint(0, 0)), child->size())))
              << child->metaObject()->className() << " sticks out at " << size.width();
        }
      keep(under.view,
           QStringLiteral("brdf_sphere_%1_%2x%3.png").arg(id).arg(size.width()).arg(size.height()));
    }
  }
}

struct SlicesUnderTest {
  BrdfSlicesPanel panel;
  explicit SlicesUnderTest(QSize size = {760, 360}, bool withMaterial = true) {
    panel.resize(size);
    panel.show();
    EXPECT_TRUE(QTest::qWaitForWindowExposed(&panel));
    if (withMaterial) panel.setMaterial(redPlastic(), someCertainty(), 0.9);
  }
  int count(PlotSeries::Mark mark) {
    return static_cast<int>(std::count_if(panel.plot()->series().begin(), panel.plot()->series().end(),
                                          [&](const PlotSeries& series) { return series.mark == mark; }));
  }
};

TEST(BrdfSlicesPanel, ShowsCurvesWithBandsAndDashedReferences) {
  SlicesUnderTest under;
  EXPECT_EQ(under.count(PlotSeries::Mark::Line), 4);
  EXPECT_EQ(under.count(PlotSeries::Mark::Band), 4);
  under.panel.setReference(test::lambert(0.3, 0.3, 0.3), "matt");
  EXPECT_EQ(under.count(PlotSeries::Mark::DashedLine), 4);
  under.panel.findChild<QComboBox*>("sliceChannel")->setCurrentIndex(1);
  EXPECT_EQ(under.count(PlotSeries::Mark::Line), 12);
  // A curve's value is the BRDF's: green at the first thetaD, where the base and the lobe add up.
  const auto& series = under.panel.plot()->series();
  const auto green = std::find_if(series.begin(), series.end(), [](const PlotSeries& each) {
    return each.mark == PlotSeries::Mark::Line && each.name.contains("5") && each.name.endsWith("G");
  });
  ASSERT_NE(green, series.end());
  const Eigen::Array3d expected = redPlastic()->evaluate(
      HalfDiffAngles{30.0 / 180 * std::numbers::pi, 5.0 / 180 * std::numbers::pi, std::numbers::pi / 2});
  const auto near =
      std::min_element(green->points.begin(), green->points.end(), [](const QPointF& a, const QPointF& b) {
        const double wanted = partOfThetaH(30, ThetaHAxis::Root);
        return std::abs(a.x() - wanted) < std::abs(b.x() - wanted);
      });
  EXPECT_NEAR(near->y(), expected[1], 0.02 * expected[1]);
  under.panel.setReference(nullptr);
  EXPECT_EQ(under.count(PlotSeries::Mark::DashedLine), 0);
  under.panel.setMaterial(redPlastic());
  EXPECT_EQ(under.count(PlotSeries::Mark::Band), 0);
  under.panel.setMaterial(nullptr);
  EXPECT_TRUE(under.panel.plot()->series().empty());
}

TEST(BrdfSlicesPanel, ReadsOutADirectionAndShowsItsCurve) {
  SlicesUnderTest under;
  const QPoint at = under.panel.picture()->place(20, 40).toPoint();
  QTest::mouseMove(under.panel.picture(), at);
  ASSERT_TRUE(QTest::qWaitFor([&] { return under.panel.readout().contains("/sr"); }, 5000));
  const auto angles = under.panel.picture()->anglesAt(at);
  ASSERT_TRUE(angles.has_value());
  const Eigen::Array3d value = redPlastic()->evaluate(*angles);
  EXPECT_TRUE(under.panel.readout().contains(QString::number(value[0], 'g', 3)))
      << under.panel.readout().toStdString();
  EXPECT_TRUE(under.panel.readout().contains("%"));
  QTest::mouseClick(under.panel.picture(), Qt::LeftButton, {}, at);
  EXPECT_EQ(under.count(PlotSeries::Mark::Line), 5);
  auto* picked = under.panel.findChild<QToolButton*>("pickedThetaD");
  EXPECT_TRUE(picked->isVisible());
  EXPECT_NEAR(picked->text().chopped(1).toDouble(), 40, 1.5);
  under.panel.picture()->setFocus(Qt::TabFocusReason);
  QTest::keyClick(under.panel.picture(), Qt::Key_Up);
  EXPECT_NEAR(picked->text().chopped(1).toDouble(), 41, 1.6);
}

TEST(BrdfSlicesPanel, SavesTablesAndPicturesAndSaysWhatFails) {
  QTemporaryDir folder;
  SlicesUnderTest under;
  QSignalSpy saved(&under.panel, &BrdfSlicesPanel::saved), failed(&under.panel, &BrdfSlicesPanel::failed);
  QString wanted = folder.filePath("slices.csv");
  under.panel.setChooseFile([&] { return wanted; });
  QToolButton* save = nullptr;
  for (QToolButton* button : under.panel.findChildren<QToolButton*>())
    if (button->accessibleName().contains("Save")) save = button;
  ASSERT_NE(save, nullptr);
  save->click();
  EXPECT_EQ(saved.count(), 1);
  EXPECT_GT(std::filesystem::file_size(wanted.toStdString()), 10000u);
  wanted = folder.filePath("slice.png");
  save->click();
  EXPECT_EQ(saved.count(), 2);
  EXPECT_FALSE(QImage(wanted).isNull());
  wanted = folder.filePath("no folder/slices.csv");
  save->click();
  EXPECT_EQ(failed.count(), 1);
  EXPECT_FALSE(under.panel.readout().isEmpty());
}

TEST(BrdfSlicesPanel, LooksRightAtSeveralSizes) {
  std::vector<HalfDiffAngles> measured;
  for (int i = 0; i < 4000; ++i) {
    const double turn = 2.4 * i, far = std::sqrt(i / 4000.0) * 0.2;
    measured.push_back({std::abs(0.25 + far * std::cos(turn)), 0.66 + far * std::sin(turn), 1.57});
  }
  int number = 0;
  for (const QSize size : {QSize(300, 560), QSize(760, 360), QSize(1200, 460)}) {
    SlicesUnderTest under(size);
    under.panel.setMeasured(measured);
    under.panel.findChild<QComboBox*>("sliceLook")->setCurrentIndex(number);
    if (number == 2) {
      under.panel.findChild<QComboBox*>("sliceChannel")->setCurrentIndex(1);
      under.panel.setReference(test::glossy({0.3, 0.12, 0.08}, 0.1, 200), "reference");
    }
    if (number == 1) QTest::mouseMove(under.panel.picture(), under.panel.picture()->place(20, 40).toPoint());
    QTest::qWait(50);
    for (QWidget* child : under.panel.findChildren<QWidget*>())
      if (child->isVisible()) {
        EXPECT_TRUE(
            under.panel.rect().contains(QRect(child->mapTo(&under.panel, QPoint(0, 0)), child->size())))
            << child->metaObject()->className() << " sticks out at " << size.width();
      }
    keep(under.panel, QStringLiteral("brdf_slices_%1x%2.png").arg(size.width()).arg(size.height()));
    ++number;
  }
  SlicesUnderTest empty({760, 360}, false);
  keep(empty.panel, "brdf_slices_empty.png");
}

TEST(CertaintyText, SaysPerCentAndFactors) {
  EXPECT_TRUE(certaintyText(std::log(1.12)).contains("12"));
  EXPECT_TRUE(certaintyText(std::log(1.014)).contains("1.4"));
  EXPECT_TRUE(certaintyText(std::log(2.7)).contains("2.7"));
  EXPECT_FALSE(certaintyText(-1).isEmpty());
}

TEST(FlowLayout, BreaksLinesWhereTheRoomEnds) {
  QWidget host;
  auto* flow = new FlowLayout(&host, 5);
  for (int i = 0; i < 4; ++i) {
    auto* block = new QWidget(&host);
    block->setFixedSize(100, 20);
    flow->addWidget(block);
  }
  EXPECT_EQ(flow->heightForWidth(1000) - flow->contentsMargins().top() - flow->contentsMargins().bottom(),
            20);
  EXPECT_EQ(flow->heightForWidth(240 + flow->contentsMargins().left() + flow->contentsMargins().right()) -
                flow->contentsMargins().top() - flow->contentsMargins().bottom(),
            45);
}

}  // namespace
}  // namespace patina
