// A simulated operator is led by the window through checkerboard, mirror, white paper, capture, fit and
// explain on two simulated monitors, by clicks and keys.
#include <gmock/gmock.h>

#include <QDoubleSpinBox>
#include <QListWidget>
#include <chrono>
#include <cstdio>
#include <numbers>

#include "app/window/explain_controller.h"
#include "app/window/rig/checkerboard_step.h"
#include "app/window/rig/fourier_capture_step.h"
#include "app/window/rig/mirror_step.h"
#include "app/window/rig/white_paper_step.h"
#include "devices/simulated/simulated_rig.h"
#include "engine/acquire/rig_assembly.h"
#include "engine/fourier/fit.h"
#include "tests/guide/guide_fixture.h"
#include "widgets/capture_panel.h"
#include "widgets/error_banner.h"
#include "widgets/explain_page.h"

namespace patina::test {
namespace {

// The stated bounds of a recovered calibration.
constexpr double kIntrinsics = 1e-3;
constexpr double kScreenDeg = 0.2, kScreenMm = 0.5;
constexpr double kEmission = 0.01;
constexpr double kMapsWorse = 1.10;  ///< errors of the maps over those with the true calibration
constexpr int kViews = 15, kStands = 20;

struct Medians {
  double diffuse = 0, normalDeg = 0, sigma = 0;
};

/// Median errors of a fit's maps against what the sheet is made of.
Medians mediansOf(const FourierFit& fit, const SimulatedSheet& sheet) {
  const SvbrdfMaps& maps = fit.maps();
  const SheetTruth truth = sheetTruth(sheet, maps.width, maps.height, 2);
  std::vector<double> diffuse, normal, sigma;
  for (int y = 0; y < maps.height; ++y)
    for (int x = 0; x < maps.width; ++x) {
      const auto status = static_cast<TexelStatus>(static_cast<int>(maps.status.at(x, y)));
      if (status != TexelStatus::Converged || truth.material.at(x, y) < 0) continue;
      double cosine = 0;
      for (int c = 0; c < 3; ++c)
        cosine += static_cast<double>(maps.normal.at(x, y, c)) * truth.normal.at(x, y, c);
      normal.push_back(std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi);
      diffuse.push_back(std::abs(maps.diffuse.at(x, y, 1) / truth.diffuse.at(x, y, 1) - 1));
      sigma.push_back(std::abs(maps.sigma.at(x, y) / truth.sigma.at(x, y) - 1));
    }
  EXPECT_GT(normal.size(), 300u);
  const auto median = [](std::vector<double>& values) {
    if (values.empty()) return 0.0;
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                     values.end());
    return values[values.size() / 2];
  };
  return {median(diffuse), median(normal), median(sigma)};
}

class WholeRig : public GuideTest {
 protected:
  using Clock = std::chrono::steady_clock;
  void lap(const char* what) {
    const auto now = Clock::now();
    std::printf("%-14s %6.1f s\n", what, std::chrono::duration<double>(now - lap_).count());
    std::fflush(stdout);
    lap_ = now;
  }
  template <typename Step>
  Step& step(const char* title) {
    auto* found = dynamic_cast<Step*>(guide().steps()[static_cast<std::size_t>(stepOf(guide(), title))]);
    EXPECT_NE(found, nullptr) << title;
    return *found;
  }
  /// Nothing may be skipped: the button is off, and the list lets nobody past.
  void expectHeldHere() {
    GuidePanel& panel = guide();
    EXPECT_FALSE(panel.nextButton()->isEnabled());
    EXPECT_FALSE(panel.nextButton()->toolTip().isEmpty());
    EXPECT_FALSE(panel.mayEnter(panel.current() + 1));
    const int here = panel.current();
    QTest::mouseClick(panel.nextButton(), Qt::LeftButton);
    EXPECT_EQ(panel.current(), here);
  }
  bool idle(int milliseconds = 240000) {
    return until([this] { return !rigController().busy(); }, milliseconds);
  }
  void next() {
    GuidePanel& panel = guide();
    ASSERT_TRUE(until([&] { return panel.nextButton()->isEnabled(); }, 10000))
        << panel.nextButton()->toolTip().toStdString();
    click(panel.nextButton());
  }
  void pictures(const char* name) {
    QTest::qWait(60);
    for (const QSize size : {QSize(1280, 720), QSize(1920, 1080)}) {
      window_->resize(size);
      QTest::qWait(60);
      screenshot(QString::fromLatin1(name));
    }
    window_->resize(1280, 720);
  }
  Clock::time_point lap_ = Clock::now();
};

TEST_F(WholeRig, LeadsThroughCalibrationCaptureFitAndExplain) {
  constexpr int kPixels = 480;
  LiveRigSetup setup = LiveRig::desk("cardstock", kPixels, 960);
  setup.fullScaleSecond = 0.02;
  // A webcam's lens: one that sees a few degrees only leaves its principal point uncertain, whatever the
  // views.
  setup.camera.intrinsics(0, 0) = setup.camera.intrinsics(1, 1) = 1.2 * kPixels;
  open(setup);
  if (HasFatalFailure()) return;
  click(find<QPushButton>("emptyCapture"));
  GuidePanel& panel = guide();
  expectHeldHere();
  pictures("guide_camera_choose");
  chooseDevices();
  if (HasFatalFailure()) return;
  lap("devices");
  next();  // a linear camera's response need not be measured

  auto& board = step<CheckerboardStep>("Checkerboard");
  ASSERT_EQ(panel.steps()[static_cast<std::size_t>(panel.current())], &board);
  expectHeldHere();
  // Where the board can't be read (its markers a few pixels large) the operator holds it elsewhere.
  for (int stand = 0; stand < kStands && static_cast<int>(board.views().size()) < kViews; ++stand) {
    const std::size_t before = board.views().size();
    click(find<QPushButton>("hand-board"));
    until([&] { return board.views().size() > before; }, 5000);
  }
  ASSERT_GE(static_cast<int>(board.views().size()), kViews) << board.said().toStdString();
  ASSERT_TRUE(until([&] {
    return board.result() && board.result()->views.size() == board.views().size() && !board.solving();
  }));
  expectHeldHere();
  click(find<QPushButton>("board-keep"));
  pictures("guide_checkerboard");
  lap("checkerboard");
  next();

  auto& mirror = step<MirrorStep>("Mirror");
  ASSERT_EQ(panel.steps()[static_cast<std::size_t>(panel.current())], &mirror);
  expectHeldHere();
  click(find<QPushButton>("hand-mirror"));
  ASSERT_TRUE(until(
      [&] {
        return mirror.sighting() && mirror.sighting()->found.size() == 2 &&
               mirror.sighting()->found[0].found && mirror.sighting()->found[1].found;
      },
      40000))
      << mirror.said().toStdString();
  click(find<QPushButton>("mirror-take"));
  ASSERT_TRUE(idle());
  ASSERT_EQ(mirror.state(), GuideStep::State::Done) << mirror.said().toStdString();
  pictures("guide_mirror");
  lap("mirror");
  next();

  click(find<QPushButton>("hand-paper-grey"));
  ASSERT_TRUE(idle());
  click(find<QPushButton>("grey-take"));
  ASSERT_TRUE(idle());
  pictures("guide_greys");
  lap("greys");
  next();

  auto& paper = step<WhitePaperStep>("White paper");
  ASSERT_EQ(panel.steps()[static_cast<std::size_t>(panel.current())], &paper);
  expectHeldHere();
  click(find<QPushButton>("hand-paper"));
  ASSERT_TRUE(idle());
  for (int c = 0; c < 3; ++c) paper.albedo(c)->setValue(whitePaperAlbedo()[c]);
  click(find<QPushButton>("paper-take"));
  ASSERT_TRUE(idle());
  ASSERT_EQ(paper.state(), GuideStep::State::Done) << paper.said().toStdString();
  pictures("guide_paper");
  lap("paper");
  next();

  expectHeldHere();
  click(find<QPushButton>("hand-sample"));
  ASSERT_TRUE(idle());
  click(find<QPushButton>("checkRig"));
  ASSERT_TRUE(
      until([&] { return panel.nextButton()->isEnabled() || window_->banner()->isVisible(); }, 240000));
  ASSERT_FALSE(window_->banner()->isVisible()) << window_->banner()->text().toStdString();
  pictures("guide_checklist");
  lap("checklist");
  next();

  auto& capture = step<FourierCaptureStep>("Capture");
  expectHeldHere();
  pictures("guide_capture_ready");
  capture.setFolder(temporary() / "bundle");
  CapturePlanOptions plan;  // some of the paper's frequencies: enough for both lobes
  plan.fitted.clear();
  for (const int w : {1, 2, 4, 8, 16})
    for (const Eigen::Vector2i& f : {Eigen::Vector2i(w, 0), Eigen::Vector2i(0, w)}) plan.fitted.push_back(f);
  plan.heldOut = {{3, 3}};
  capture.setPlan(plan);
  click(find<QPushButton>("captureStart"));
  ASSERT_TRUE(
      until([&] { return capture.panel()->strip()->currentRow() >= 20 || !capture.running(); }, 240000));
  pictures("guide_capture_running");
  ASSERT_TRUE(until([&] { return !capture.running(); }, 600000));
  ASSERT_FALSE(window_->banner()->isVisible()) << window_->banner()->text().toStdString();
  pictures("guide_capture_done");
  lap("capture");
  next();
  ASSERT_TRUE(until([&] { return window_->document()->capture() != nullptr; }));

  // What was recovered, against what the rig truly is.
  const auto parts = readRigParts(calibrations());
  ASSERT_TRUE(parts.ok()) << parts.error().sentence();
  const FourierCapture& taken = *window_->document()->capture();
  const RigDescription truth = rig_->description();
  for (int axis = 0; axis < 2; ++axis) {
    EXPECT_NEAR(taken.camera.intrinsics(axis, axis) / truth.camera.intrinsics(axis, axis), 1, kIntrinsics);
    EXPECT_NEAR(taken.camera.intrinsics(axis, 2), truth.camera.intrinsics(axis, 2),
                kIntrinsics * truth.camera.intrinsics(0, 0));
  }
  const PoseDifference screen = differenceOf(taken.screen, truth.screen);
  EXPECT_LT(screen.angleDeg, kScreenDeg);
  EXPECT_LT(screen.distanceMm, kScreenMm);
  ASSERT_TRUE(taken.screen.emission.has_value());
  const ScreenEmission &found = *taken.screen.emission, &emitted = *truth.screen.emission;
  EXPECT_NEAR(found.sigma.x() / emitted.sigma.x(), 1, kEmission);
  EXPECT_NEAR(found.sigma.y() / emitted.sigma.y(), 1, kEmission);
  EXPECT_NEAR(found.gain * taken.radianceScale / (emitted.gain * truth.radianceOfFullScaleSecond), 1,
              kEmission);
  std::printf(
      "focal %.5f %.5f, middle %.3f %.3f px; screen %.3f degrees %.3f mm; sigma %.4f %.4f, gain %.4f\n",
      taken.camera.intrinsics(0, 0) / truth.camera.intrinsics(0, 0) - 1,
      taken.camera.intrinsics(1, 1) / truth.camera.intrinsics(1, 1) - 1,
      taken.camera.intrinsics(0, 2) - truth.camera.intrinsics(0, 2),
      taken.camera.intrinsics(1, 2) - truth.camera.intrinsics(1, 2), screen.angleDeg, screen.distanceMm,
      found.sigma.x() / emitted.sigma.x() - 1, found.sigma.y() / emitted.sigma.y() - 1,
      found.gain * taken.radianceScale / (emitted.gain * truth.radianceOfFullScaleSecond) - 1);

  QTest::keyClick(window_.get(), Qt::Key_F5);
  ASSERT_TRUE(until([&] { return window_->fitting(); }, 5000));
  ASSERT_TRUE(until([&] { return !window_->fitting(); }, 600000));
  ASSERT_NE(window_->document()->fit(), nullptr) << window_->banner()->text().toStdString();
  pictures("guide_fitted");
  lap("fit");
  const Medians led = mediansOf(*window_->document()->fit(), setup.sheet);
  // The same photographs with what the rig truly is.
  FourierCapture known = taken;
  known.camera = truth.camera;
  known.screen = truth.screen;
  known.radianceScale = truth.radianceOfFullScaleSecond;
  const auto best = fitFourier(known, {}, {});
  ASSERT_TRUE(best.ok()) << best.error().sentence();
  const Medians ideal = mediansOf(**best, setup.sheet);
  std::printf("diffuse %.5f / %.5f, normal %.4f / %.4f degrees, sigma %.5f / %.5f\n", led.diffuse,
              ideal.diffuse, led.normalDeg, ideal.normalDeg, led.sigma, ideal.sigma);
  EXPECT_LT(led.diffuse, kMapsWorse * ideal.diffuse);
  EXPECT_LT(led.normalDeg, kMapsWorse * ideal.normalDeg);
  EXPECT_LT(led.sigma, kMapsWorse * ideal.sigma);
  lap("fit, known");

  QTest::keyClick(window_.get(), Qt::Key_E, Qt::ControlModifier);
  ASSERT_TRUE(until([&] { return window_->explainShown(); }, 5000));
  ASSERT_TRUE(until(
      [&] { return window_->explanation()->explanation() != nullptr || window_->banner()->isVisible(); },
      600000));
  ASSERT_NE(window_->explanation()->explanation(), nullptr) << window_->banner()->text().toStdString();
  pictures("guide_explained");
  lap("explain");
}

}  // namespace
}  // namespace patina::test
