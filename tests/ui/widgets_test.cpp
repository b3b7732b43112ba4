#include <gtest/gtest.h>

#include <QCheckBox>
#include <QComboBox>
#include <QDialogButtonBox>
#include <QDoubleSpinBox>
#include <QPushButton>
#include <QSignalSpy>
#include <QSpinBox>
#include <QTableWidget>
#include <QTemporaryDir>
#include <QTest>
#include <QWheelEvent>
#include <new>
#include <stdexcept>

#include "app/window/settings.h"
#include "tests/ui/fake_fit.h"
#include "widgets/document.h"
#include "widgets/fit_options_dialog.h"
#include "widgets/image_view.h"
#include "widgets/photo_library.h"
#include "widgets/plot_widget.h"
#include "widgets/sphere_view.h"
#include "widgets/texel_inspector.h"

namespace patina {
namespace {

using test::FakeFit;

FourierCapture someCapture() {
  FourierCapture capture;
  capture.sampleWidthMm = 60;
  capture.sampleHeightMm = 40;
  capture.screen.widthMm = 345;
  capture.screen.heightMm = 194;
  return capture;
}

std::shared_ptr<const FourierFit> someFit(int width = 24, int height = 16) {
  return std::make_shared<FakeFit>(someCapture(), width, height);
}

TEST(Document, UndoesAndRedoesARange) {
  Document document;
  const ToneSettings before = document.tone(ViewKind::Sigma);
  ToneSettings after = before;
  after.high = 0.25;
  document.setTone(ViewKind::Sigma, after);
  EXPECT_EQ(document.tone(ViewKind::Sigma), after);
  document.undoStack()->undo();
  EXPECT_EQ(document.tone(ViewKind::Sigma), before);
  document.undoStack()->redo();
  EXPECT_EQ(document.tone(ViewKind::Sigma), after);
}

TEST(Document, AGestureIsOneStepAndTheNextIsAnother) {
  Document document;
  for (int i = 1; i <= 20; ++i) {
    ToneSettings tone;
    tone.exposureEv = 0.1 * i;
    document.setTone(ViewKind::Diffuse, tone);
  }
  EXPECT_EQ(document.undoStack()->count(), 1);
  document.endGesture();
  ToneSettings tone;
  tone.exposureEv = 3;
  document.setTone(ViewKind::Diffuse, tone);
  EXPECT_EQ(document.undoStack()->count(), 2);
  document.undoStack()->undo();
  EXPECT_DOUBLE_EQ(document.tone(ViewKind::Diffuse).exposureEv, 2.0);
  document.undoStack()->undo();
  EXPECT_DOUBLE_EQ(document.tone(ViewKind::Diffuse).exposureEv, 0.0);
}

TEST(Document, UndoesOptionsPickAndLamp) {
  Document document;
  document.openCapture(std::make_shared<const FourierCapture>(someCapture()));
  FourierFitOptions options;
  options.maxIterations = 7;
  options.poolNeighbours = false;
  document.setFitOptions(options);
  document.setFitOptions(options);  // nothing new: not a step
  document.pickTexel(QPoint(3, 4));
  LampState lamp = document.lamp();
  lamp.positionMm.x() += 30;
  document.setLamp(lamp);
  ASSERT_EQ(document.undoStack()->count(), 3);
  document.undoStack()->undo();
  EXPECT_EQ(document.lamp(), LampState{});
  document.undoStack()->undo();
  EXPECT_FALSE(document.pickedTexel().has_value());
  document.undoStack()->undo();
  EXPECT_EQ(document.fitOptions(), FourierFitOptions{});
  document.undoStack()->redo();
  EXPECT_EQ(document.fitOptions(), options);
  FourierFitOptions pooled = options;
  pooled.poolNeighbours = true;
  document.setFitOptions(pooled);
  EXPECT_TRUE(document.fitOptions().poolNeighbours) << "a change of this field alone is lost";
}

TEST(Document, UndoBringsTheEarlierFitBackAndHoldsNoThird) {
  Document document;
  document.openCapture(std::make_shared<const FourierCapture>(someCapture()));
  std::weak_ptr<const FourierFit> first;
  {
    const auto fit = someFit();
    first = fit;
    document.adoptFit(fit, "fit");
  }
  const auto second = someFit();
  document.adoptFit(second, "fit");
  EXPECT_EQ(document.fit(), second);
  EXPECT_FALSE(first.expired());
  document.undoStack()->undo();
  EXPECT_EQ(document.fit(), first.lock());
  document.undoStack()->redo();
  document.adoptFit(someFit(), "fit");
  EXPECT_TRUE(first.expired()) << "the history keeps more than two fits in memory";
  document.undoStack()->undo();
  EXPECT_EQ(document.fit(), second);
  while (document.undoStack()->canUndo()) document.undoStack()->undo();  // past what was let go of
  EXPECT_EQ(document.fit(), second);
}

TEST(Document, AFitOfAnotherSizeDropsThePickToTheMiddle) {
  Document document;
  document.openCapture(std::make_shared<const FourierCapture>(someCapture()));
  document.adoptFit(someFit(24, 16), "fit");
  document.pickTexel(QPoint(20, 15));
  document.adoptFit(someFit(12, 8), "fit");
  EXPECT_EQ(document.pickedTexel(), QPoint(6, 4));
}

struct ViewUnderTest {
  ImageView view;
  std::optional<QPoint> hovered;
  ViewUnderTest() {
    auto image = std::make_shared<Image>(40, 20, 1);
    for (int y = 0; y < 20; ++y)
      for (int x = 0; x < 40; ++x) image->at(x, y) = x / 39.0f;
    view.resize(500, 400);
    view.setPicture(image, ToneStyle::Scalar);
    view.show();
    EXPECT_TRUE(QTest::qWaitForWindowExposed(&view));
    QObject::connect(&view, &ImageView::hovered, &view,
                     [this](std::optional<QPoint> pixel) { hovered = pixel; });
  }
};

TEST(ImageView, WheelZoomsAtTheCursor) {
  ViewUnderTest under;
  const QPointF cursor(123, 210);
  const QPointF before = under.view.pictureFromWidget(cursor);
  const double zoom = under.view.zoom();
  QWheelEvent wheel(cursor, under.view.mapToGlobal(cursor), {}, {0, 360}, Qt::NoButton, Qt::NoModifier,
                    Qt::NoScrollPhase, false);
  QCoreApplication::sendEvent(&under.view, &wheel);
  EXPECT_GT(under.view.zoom(), 1.5 * zoom);
  const QPointF after = under.view.pictureFromWidget(cursor);
  EXPECT_NEAR(after.x(), before.x(), 1e-6);
  EXPECT_NEAR(after.y(), before.y(), 1e-6);
}

TEST(ImageView, DragPansAndDoesNotPick) {
  ViewUnderTest under;
  QSignalSpy clicks(&under.view, &ImageView::clicked);
  const QPointF before = under.view.widgetFromPicture({0, 0});
  QTest::mousePress(&under.view, Qt::LeftButton, {}, {200, 200});
  QTest::mouseMove(&under.view, {240, 220});
  QTest::mouseMove(&under.view, {260, 230});
  QTest::mouseRelease(&under.view, Qt::LeftButton, {}, {260, 230});
  EXPECT_EQ(clicks.count(), 0);
  EXPECT_GT(under.view.widgetFromPicture({0, 0}).x(), before.x() + 20);
  QTest::mouseClick(&under.view, Qt::LeftButton, {}, under.view.widgetFromPicture({10.5, 5.5}).toPoint());
  ASSERT_EQ(clicks.count(), 1);
  EXPECT_EQ(static_cast<int>(clicks[0][0].toPointF().x()), 10);
}

TEST(ImageView, ShowsSquarePixelsWhenMagnified) {
  ViewUnderTest under;
  under.view.zoomTo(32);
  const QImage shot = under.view.grab().toImage();
  const double ratio = shot.devicePixelRatio();
  // Two places in one picture pixel have one colour; the neighbour has another.
  const QPointF corner = under.view.widgetFromPicture({20, 10});
  const auto colourAt = [&](double dx) { return shot.pixel(((corner + QPointF(dx, 5)) * ratio).toPoint()); };
  EXPECT_EQ(colourAt(4), colourAt(28));
  EXPECT_NE(colourAt(28), colourAt(36));
}

TEST(ImageView, ReportsThePixelUnderTheCursorAndItsLeaving) {
  ViewUnderTest under;
  QTest::mouseMove(&under.view, under.view.widgetFromPicture({7.5, 3.5}).toPoint());
  ASSERT_TRUE(QTest::qWaitFor([&] { return under.hovered.has_value(); }, 2000));
  EXPECT_EQ(*under.hovered, QPoint(7, 3));
  QTest::mouseMove(&under.view, QPoint(3, 3));
  EXPECT_TRUE(QTest::qWaitFor([&] { return !under.hovered.has_value(); }, 2000));
}

TEST(TexelInspector, ShowsSpectrumLobeAndParameters) {
  Document document;
  document.openCapture(std::make_shared<const FourierCapture>(someCapture()));
  TexelInspector inspector(&document);
  inspector.resize(460, 420);
  EXPECT_TRUE(inspector.magnitudePlot()->series().empty());
  document.adoptFit(someFit(), "fit");
  document.pickTexel(QPoint(5, 5));
  const auto named = [](PlotWidget* plot, const QString& name) -> const PlotSeries* {
    for (const PlotSeries& series : plot->series())
      if (series.name == name) return &series;
    return nullptr;
  };
  const PlotSeries* measured = named(inspector.magnitudePlot(), "measured");
  ASSERT_NE(measured, nullptr);
  EXPECT_EQ(measured->mark, PlotSeries::Mark::Dots);
  EXPECT_EQ(measured->points.size(), 4u);  // DC, 1, 2, 8
  const PlotSeries* held = named(inspector.magnitudePlot(), "held out");
  ASSERT_NE(held, nullptr);
  EXPECT_EQ(held->mark, PlotSeries::Mark::HollowDots);
  ASSERT_EQ(held->points.size(), 1u);
  EXPECT_EQ(held->points[0].x(), 4);
  for (const char* part : {"diffuse", "specular"}) {
    ASSERT_NE(named(inspector.magnitudePlot(), part), nullptr);
    EXPECT_EQ(named(inspector.magnitudePlot(), part)->mark, PlotSeries::Mark::DashedLine);
  }
  EXPECT_TRUE(inspector.magnitudePlot()->horizontalAxis().logarithmic &&
              inspector.magnitudePlot()->verticalAxis().logarithmic);
  // The measurements are the model's here: phases about the lobe vanish.
  for (const PlotSeries& series : inspector.phasePlot()->series()) {
    if (series.mark != PlotSeries::Mark::Dots) continue;
    for (const QPointF& point : series.points) EXPECT_LT(std::abs(point.y()), 40) << point.x();
  }

  inspector.setPage(1);
  const PlotSeries* model = named(inspector.lobePlot(), "model");
  ASSERT_NE(model, nullptr);
  const double half = model->points.back().x();
  EXPECT_NEAR(half, 345 / 2.0, 1e-6);  // pattern coordinates run over the screen's width
  inspector.setPage(2);
  EXPECT_GE(inspector.table()->rowCount(), 9);
  inspector.setHovered(QPoint(0, 0));  // a texel that no photograph sees
  inspector.setPage(0);
  EXPECT_TRUE(inspector.magnitudePlot()->series().empty());
}

TEST(TexelInspector, FollowsTheCursorOnlyWhenAsked) {
  Document document;
  document.openCapture(std::make_shared<const FourierCapture>(someCapture()));
  TexelInspector inspector(&document);
  document.adoptFit(someFit(), "fit");
  document.pickTexel(QPoint(5, 5));
  inspector.setHovered(QPoint(9, 2));
  EXPECT_EQ(inspector.shownTexel(), QPoint(9, 2));
  inspector.setFollowsCursor(false);
  EXPECT_EQ(inspector.shownTexel(), QPoint(5, 5));
  inspector.setFollowsCursor(true);
  inspector.setHovered(std::nullopt);
  EXPECT_EQ(inspector.shownTexel(), QPoint(5, 5));
}

/// What the inspector's table says of the held-out error at a texel.
QString heldOutError(FourierCapture capture, bool cancelled, bool read, const QPoint& texel) {
  Document document;
  document.openCapture(std::make_shared<const FourierCapture>(capture));
  TexelInspector inspector(&document);
  auto fit = std::make_shared<FakeFit>(std::move(capture), 24, 16, cancelled);
  if (!read) fit->leaveHeldOutUnread();
  document.adoptFit(fit, "fit");
  inspector.setPage(2);
  inspector.setHovered(texel);
  QTest::qWait(100);  // it draws a little later
  for (int row = 0; row < inspector.table()->rowCount(); ++row)
    if (inspector.table()->item(row, 0)->text() == "Held-out error")
      return inspector.table()->item(row, 1)->text();
  return {};
}

TEST(TexelInspector, SaysWhyThereIsNoHeldOutError) {
  const FourierCapture none = someCapture();
  FourierCapture some = someCapture();
  some.photos.resize(4);
  for (FourierPhoto& photo : some.photos) photo.holdout = true;
  EXPECT_EQ(heldOutError(some, false, true, {5, 5}), "0.0000");  // the measurements are the model's here
  EXPECT_EQ(heldOutError(none, false, false, {5, 5}), "none held out");
  EXPECT_EQ(heldOutError(some, true, false, {5, 5}), "held-out photographs were not read");
  EXPECT_EQ(heldOutError(some, false, false, {5, 5}), "held-out photographs were not read");
  EXPECT_EQ(heldOutError(some, false, true, {0, 0}), "not measured here");
}

TEST(SphereView, HighlightIsWhereTheLightIsMirrored) {
  SphereView sphere;
  sphere.resize(150, 150);
  SvbrdfParameters gloss;
  gloss.specular.setConstant(0.05f);
  gloss.sigma = 0.08f;
  sphere.setMaterial(gloss);
  sphere.setToLight(Eigen::Vector3f(0.6f, 0.0f, 0.8f));
  const QImage picture = sphere.picture();
  QPoint brightest;
  int most = -1;
  for (int y = 0; y < picture.height(); ++y)
    for (int x = 0; x < picture.width(); ++x)
      if (qGreen(picture.pixel(x, y)) > most) {
        most = qGreen(picture.pixel(x, y));
        brightest = {x, y};
      }
  // The half-vector of (0.6, 0, 0.8) and the eye: x = 0.316 of the radius.
  const double radius = picture.width() / 2.0;
  EXPECT_NEAR((brightest.x() + 0.5 - radius) / radius, 0.316, 0.12);
  EXPECT_NEAR((brightest.y() + 0.5 - radius) / radius, 0.0, 0.12);
}

TEST(FitOptionsDialog, GivesBackWhatItWasGiven) {
  FourierFitOptions options;
  options.size = 96;
  options.maxIterations = 12;
  options.lobe = LobeMapping::PaperAffine;
  options.weights = MeasurementWeights::PaperConstant;
  options.neighbourRestarts = false;
  options.poolNeighbours = false;
  options.tolerance = 3e-6;  // not one that the form can show exactly
  FitOptionsDialog dialog(options);
  const FourierFitOptions back = dialog.options();
  EXPECT_EQ(back.size, 96);
  EXPECT_EQ(back.maxIterations, 12);
  EXPECT_EQ(back.lobe, LobeMapping::PaperAffine);
  EXPECT_EQ(back.weights, MeasurementWeights::PaperConstant);
  EXPECT_FALSE(back.neighbourRestarts);
  EXPECT_FALSE(back.poolNeighbours);
  EXPECT_EQ(back.tolerance, 3e-6);
  EXPECT_EQ(back, options) << "a field that the form does not keep";
  dialog.setOptions(FourierFitOptions{});
  EXPECT_EQ(dialog.options(), FourierFitOptions{});
}

TEST(FitOptionsDialog, EveryFieldCanBeChanged) {
  FitOptionsDialog dialog(FourierFitOptions{});
  dialog.findChild<QSpinBox*>("optionSize")->setValue(16384);  // the most that the engine takes
  dialog.findChild<QSpinBox*>("optionIterations")->setValue(33);
  dialog.findChild<QComboBox*>("optionLobe")->setCurrentIndex(1);
  dialog.findChild<QComboBox*>("optionWeights")->setCurrentIndex(1);
  dialog.findChild<QDoubleSpinBox*>("optionTolerance")->setValue(-3);
  dialog.findChild<QCheckBox*>("optionRestarts")->click();
  dialog.findChild<QCheckBox*>("optionPool")->click();
  const FourierFitOptions changed = dialog.options();
  EXPECT_EQ(changed.size, 16384);
  EXPECT_EQ(changed.maxIterations, 33);
  EXPECT_EQ(changed.lobe, LobeMapping::PaperAffine);
  EXPECT_EQ(changed.weights, MeasurementWeights::PaperConstant);
  EXPECT_NEAR(changed.tolerance, 1e-3, 1e-12);
  EXPECT_FALSE(changed.neighbourRestarts);
  EXPECT_FALSE(changed.poolNeighbours);
  EXPECT_TRUE(changed.validate().empty());
  EXPECT_TRUE(dialog.findChild<QDialogButtonBox*>()->button(QDialogButtonBox::Ok)->isEnabled());
}

TEST(Settings, KeepsEveryFitOption) {
  QTemporaryDir folder;
  FourierFitOptions options;
  options.size = 200;
  options.lobe = LobeMapping::PaperAffine;
  options.weights = MeasurementWeights::PaperConstant;
  options.maxIterations = 17;
  options.tolerance = 3e-6;
  options.neighbourRestarts = false;
  options.poolNeighbours = false;
  {
    Settings settings(folder.filePath("patina.ini"));
    EXPECT_EQ(settings.fitOptions(), FourierFitOptions{});
    settings.setFitOptions(options);
  }
  EXPECT_EQ(Settings(folder.filePath("patina.ini")).fitOptions(), options);
}

TEST(PhotoLibrary, AReaderThatThrowsFailsOnePhotographOnly) {
  auto capture = std::make_shared<FourierCapture>(someCapture());
  for (const char* file : {"memory.exr", "bug.exr", "oddity.exr", "good.exr"}) {
    capture->photos.emplace_back();
    capture->photos.back().file = file;
  }
  PhotoLibrary library([](const FourierCapture&, const FourierPhoto& photo) -> Result<Image> {
    if (photo.file == "memory.exr") throw std::bad_alloc();
    if (photo.file == "bug.exr") throw std::out_of_range("row 7");
    if (photo.file == "oddity.exr") throw 42;
    return Image(8, 8, 3, 0.5f);
  });
  std::map<int, Error> failures;
  QObject::connect(&library, &PhotoLibrary::photoFailed, &library,
                   [&](int photo, Error error) { failures[photo] = std::move(error); });
  library.setCapture(capture);
  for (int photo = 0; photo < 4; ++photo) library.thumbnail(photo);
  ASSERT_TRUE(QTest::qWaitFor([&] { return !library.thumbnail(3).isNull() && failures.size() == 3; }, 5000));
  EXPECT_NE(failures[0].what.find("memory"), std::string::npos);
  EXPECT_NE(failures[1].what.find("row 7"), std::string::npos);
  for (int photo = 0; photo < 3; ++photo) {
    EXPECT_TRUE(library.failed(photo));
    EXPECT_EQ(failures[photo].where, capture->photos[photo].file);
    EXPECT_FALSE(failures[photo].tryThis.empty());
  }
  EXPECT_FALSE(library.failed(3));
}

}  // namespace
}  // namespace patina
