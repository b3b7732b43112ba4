// The guided two-shot capture, led by clicks from the camera to the reconstruction.
#include "engine/acquire/two_shot_guide.h"

#include <QDoubleSpinBox>
#include <QLineEdit>
#include <QListWidget>

#include "app/window/rig/calibration_store.h"
#include "app/window/rig/checkerboard_step.h"
#include "app/window/rig/plan_step.h"
#include "app/window/rig/shots_step.h"
#include "app/window/rig/white_tile_step.h"
#include "app/window/two_shot_controller.h"
#include "engine/brdf/analytic_brdf.h"
#include "tests/guide/guide_fixture.h"

namespace patina::test {
namespace {

// The stated bounds.
constexpr double kIntrinsics = 1e-3, kIrradiance = 5e-3;

constexpr double kRadiusMm = 20, kDistanceMm = 150;
constexpr int kPixels = 720, kViews = 14;

class TwoShotGuideTest : public GuideTest {
 protected:
  void begin() {
    LiveRigSetup setup = LiveRig::desk("cardstock", 32, 320);
    AnalyticBrdfParameters parameters;
    parameters.alphaX = parameters.alphaY = 0.3;
    parameters.diffuse = {0.4, 0.25, 0.12};
    setup.brdfs = {makeAnalyticBrdf("ggx", parameters).value()};
    setup.fullScaleSecond = 0.02;
    setup.ambient = 0;
    // A camera on a stand whose picture holds sample and markers.
    const Camera lens = setup.camera;
    setup.camera = lookingAtCentre(Eigen::Vector3d(0.1, -0.35, 1).normalized(), kDistanceMm);
    setup.camera.width = setup.camera.height = kPixels;
    const double focal = 1.5 * kPixels, middle = 0.5 * (kPixels - 1);
    setup.camera.intrinsics << focal, 0, middle + 2, 0, focal, middle - 3, 0, 0, 1;
    setup.camera.distortion = lens.distortion;
    open(setup);
    // As the last capture left it.
    rigController().settings().set("rig/two_shot_distance_mm", kDistanceMm);
    rigController().settings().set("rig/two_shot_radius_mm", kRadiusMm);
    window_->startCapture(true);
  }
  GuidePanel& panel() { return guide(CaptureGuides::Kind::TwoShot); }
  template <typename Step>
  Step* current() {
    return dynamic_cast<Step*>(panel().steps()[static_cast<std::size_t>(panel().current())]);
  }
  void clickNamed(const char* name) {
    // Steps of both guides may have one of that name: the visible one is meant.
    for (auto* button : panel().findChildren<QPushButton*>(QLatin1String(name)))
      if (until([button] { return button->isVisible() && button->isEnabled(); }, 20000)) return click(button);
    FAIL() << name << " is not there or can't be clicked";
  }
  bool idle() {
    return until([this] { return !rigController().busy(); });
  }
  void next() {
    ASSERT_TRUE(until([&] { return panel().nextButton()->isEnabled(); }))
        << current<GuideStep>()->title().toStdString() << ": "
        << current<GuideStep>()->whyNot().toStdString();
    click(panel().nextButton());
  }
  void look(const QString& name) {
    const QSize before = window_->size();
    for (const QSize size : {QSize(1280, 720), QSize(1920, 1080)}) {
      window_->resize(size);
      QTest::qWait(40);
      screenshot(name);
    }
    window_->resize(before);
  }
};

TEST_F(TwoShotGuideTest, LeadsFromTheCheckerboardToTheReconstruction) {
  begin();
  if (HasFatalFailure()) return;
  // No step can be skipped.
  for (std::size_t i = 1; i < panel().steps().size(); ++i) EXPECT_FALSE(panel().goTo(static_cast<int>(i)));
  QListWidget* cameras = nullptr;
  ASSERT_TRUE(until(
      [&] { return (cameras = panel().findChild<QListWidget*>("cameraList")) && cameras->count() == 2; }));
  QTest::mouseClick(cameras->viewport(), Qt::LeftButton, {},
                    cameras->visualItemRect(cameras->item(1)).center());
  clickNamed("useCamera");
  next();

  // A linear camera's response need not be measured.
  next();
  auto* board = current<CheckerboardStep>();
  ASSERT_NE(board, nullptr);
  // A stand in which not all of the board is seen is left for the next one, as a person would.
  for (int hold = 0; hold < 2 * kViews && static_cast<int>(board->views().size()) < kViews; ++hold) {
    const std::size_t before = board->views().size();
    clickNamed("hand-board");
    until([&] { return board->views().size() > before; }, 5000);
  }
  ASSERT_EQ(static_cast<int>(board->views().size()), kViews);
  ASSERT_TRUE(
      until([&] { return board->result() && !board->solving() && board->result()->views.size() == kViews; }));
  clickNamed("board-keep");
  const auto lens = readCalibration(calibrations() / "camera.json", "camera");
  ASSERT_TRUE(lens.ok());
  const StoredCamera& stored = std::get<StoredCamera>(lens->content);
  const Camera found = stored.camera, truth = rig_->camera();
  for (int axis = 0; axis < 2; ++axis) {
    EXPECT_NEAR(found.intrinsics(axis, axis) / truth.intrinsics(axis, axis), 1, kIntrinsics);
    // The principal point of so narrow a lens is known to about a thousandth of the focal length only: it
    // must be as far off as it says, and say no more than that.
    const double sd = stored.sd[2 + axis];
    EXPECT_NEAR(found.intrinsics(axis, 2), truth.intrinsics(axis, 2), 3.5 * sd);
    EXPECT_LT(sd, 1.1 * kIntrinsics * truth.intrinsics(0, 0));
  }
  next();

  auto* tile = current<WhiteTileStep>();
  ASSERT_NE(tile, nullptr);
  EXPECT_FALSE(panel().nextButton()->isEnabled());
  const Eigen::Array3d reflectance = whiteTileReflectance();
  for (int c = 0; c < 3; ++c) tile->reflectance(c)->setValue(reflectance[c]);
  clickNamed("hand-tile");
  ASSERT_TRUE(idle());
  QTest::qWait(1500);  // the live picture's exposure settles, and the markers are found
  clickNamed("tile-take");
  ASSERT_TRUE(idle());
  look("two_shot_tile");
  ASSERT_EQ(tile->state(), GuideStep::State::Done) << tile->said().toStdString();
  // The lamp's light on the table, in full scales a second: what the simulated hands set.
  const Eigen::Vector3d toLamp = Eigen::Vector3d(-std::sin(0.5), 0.3, std::cos(0.5)).normalized();
  const Eigen::Array3d irradiance = Eigen::Array3d(1.0, 0.95, 0.88) * 18 * toLamp.z();
  double worst = 0;
  for (int c = 0; c < 3; ++c) {
    worst = std::max(worst, std::abs(tile->result()->mean[c] / irradiance[c] - 1));
    EXPECT_NEAR(tile->result()->mean[c] / irradiance[c], 1, kIrradiance) << c;
  }
  std::printf("irradiance off by %.5f at most\n", worst);
  next();

  auto* plan = current<PlanStep>();
  ASSERT_NE(plan, nullptr);
  EXPECT_FALSE(panel().nextButton()->isEnabled());
  plan->radius()->setValue(kRadiusMm);
  plan->distance()->setValue(kDistanceMm);
  clickNamed("plan-usual");
  ASSERT_TRUE(until([&] { return !plan->planning() && plan->state() == GuideStep::State::Done; }, 120000))
      << plan->words()->text().toStdString();
  look("two_shot_plan");
  next();

  auto* shots = current<ShotsStep>();
  ASSERT_NE(shots, nullptr);
  shots->folder()->setText(QString::fromStdString((temporary() / "bundle").string()));
  clickNamed("shots-begin");
  for (int shot = 0; shot < 2; ++shot) {
    clickNamed("hand-sample");
    ASSERT_TRUE(idle());
    clickNamed("hand-camera");
    ASSERT_TRUE(idle());
    until([&] { return shots->guide().has_value(); }, 3000);
    look(QStringLiteral("two_shot_camera_far_%1").arg(shot));
    ASSERT_TRUE(until(
        [&] { return shots->guide() && shots->guide()->offDeg > 3 && shots->guide()->offDeg < 10; }, 20000))
        << "no guidance at shot " << shot << ": "
        << panel().findChild<QLabel*>("shots-numbers")->text().toStdString();
    EXPECT_FALSE(panel().findChild<QPushButton*>("camera-place")->isEnabled());
    EXPECT_GE(shots->guide()->errorNow, 0);
    clickNamed("hand-follow");
    ASSERT_TRUE(idle());
    ASSERT_TRUE(until([&] { return shots->guide() && shots->guide()->within; }, 20000))
        << (shots->guide() ? shots->guide()->sentence : "no guidance");
    QTest::qWait(300);
    look(QStringLiteral("two_shot_camera_%1").arg(shot));
    clickNamed("camera-place");
    ASSERT_TRUE(until([&] { return shots->step() == TwoShotStep::PlaceLight; }, 5000))
        << shots->said().toStdString();
    clickNamed("hand-lamp");
    ASSERT_TRUE(idle());
    look(QStringLiteral("two_shot_light_%1").arg(shot));
    clickNamed("light-place");
    ASSERT_EQ(shots->step(), TwoShotStep::PhotographSample) << shots->said().toStdString();
    clickNamed("shots-photograph");
    ASSERT_TRUE(idle());
    ASSERT_EQ(shots->step(), TwoShotStep::PlaceTile) << shots->said().toStdString();
    look(QStringLiteral("two_shot_place_tile_%1").arg(shot));
    EXPECT_FALSE(panel().nextButton()->isEnabled());
    clickNamed("hand-shot-tile");
    ASSERT_TRUE(idle());
    clickNamed("shots-tile");
    clickNamed("shots-photograph");
    ASSERT_TRUE(idle());
  }
  ASSERT_EQ(shots->step(), TwoShotStep::Done) << shots->said().toStdString();
  look("two_shot_done");
  next();
  ASSERT_TRUE(until([&] { return window_->twoShot()->isOpen(); }));
  window_->action("fit")->trigger();
  ASSERT_TRUE(until([&] { return window_->twoShot()->fitted() && !window_->fitting(); }, 120000));
  look("two_shot_reconstructed");
  // The shots' own tiles: the same lamp from elsewhere.
  const auto capture = window_->twoShot()->document()->capture();
  ASSERT_EQ(capture->whiteShots.size(), 2u);
  for (const TwoShotPhoto& photo : capture->whiteShots) {
    const auto image = readPhoto(*capture, photo);
    ASSERT_TRUE(image.ok());
    WhiteTileOptions options;
    options.region = regionInDisc(photo.camera, kRadiusMm).value();
    options.exposureS = photo.exposureS;
    CertifiedReflectance certified;
    certified.rgb = reflectance.matrix();
    const auto light = calibrateWhiteTile(*image, certified, options);
    ASSERT_TRUE(light.ok()) << light.error().sentence();
    const Eigen::Array3d expected = Eigen::Array3d(1.0, 0.95, 0.88) * 18 * photo.toLight.z();
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(light->mean[c] / expected[c], 1, kIrradiance) << c;
  }
}

}  // namespace
}  // namespace patina::test
