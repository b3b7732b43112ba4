// The calibration steps one by one, each led by clicks on the simulated rig.
#include <QDoubleSpinBox>

#include "app/window/rig/camera_response_step.h"
#include "app/window/rig/checkerboard_step.h"
#include "app/window/rig/mirror_step.h"
#include "app/window/rig/screen_response_step.h"
#include "app/window/rig/white_paper_step.h"
#include "engine/acquire/rig_assembly.h"
#include "tests/guide/rig_fixture.h"

namespace patina::test {
namespace {

// The stated bounds.
constexpr double kIntrinsics = 1e-3;
constexpr double kScreenDeg = 0.2, kScreenMm = 0.5;
constexpr double kEmission = 0.01;

LiveRigSetup deskWith(int pixels, int screenPx) {
  LiveRigSetup setup = LiveRig::desk("cardstock", pixels, screenPx);
  setup.fullScaleSecond = 0.02;
  return setup;
}

class CalibrationSteps : public RigTest {
 protected:
  /// Writes the true lens as an earlier calibration.
  void knowLens(const Board& board = Board::forCamera()) {
    CalibrationRecord record;
    Camera lens = rig_->camera();
    lens.cameraFromWorld.setIdentity();
    lens.translationMm.setZero();
    record.content = StoredCamera{lens, IntrinsicVector::Zero(), board, 12};
    record.residual = 0.1;
    record.residualUnit = "px";
    record.taken = std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now());
    ASSERT_TRUE(CalibrationStore(controller_->folder()).keep(record).ok());
  }
};

TEST_F(CalibrationSteps, CheckerboardTakesViewsByItselfAndFindsTheLens) {
  // A webcam's lens: one that sees a few degrees only leaves its principal point uncertain, whatever the
  // views.
  LiveRigSetup setup = deskWith(480, 320);
  setup.camera.intrinsics(0, 0) = setup.camera.intrinsics(1, 1) = 1.2 * 480;
  start(setup);
  auto* step = new CheckerboardStep(*controller_);
  panel_->addStep(step);
  panel_->show();
  panel_->enter();
  constexpr std::size_t kViews = 14;
  // A stand in which not all of the board is seen is left for the next one, as a person would.
  for (int hold = 0; hold < 2 * static_cast<int>(kViews) && step->views().size() < kViews; ++hold) {
    const std::size_t before = step->views().size();
    click("hand-board");
    until([&] { return step->views().size() > before; }, 3500);
    if (hold == 5) keepPictures("rig_checkerboard");
  }
  ASSERT_EQ(step->views().size(), kViews) << panel_->findChild<QLabel*>("board-seen")->text().toStdString();
  ASSERT_TRUE(
      until([&] { return step->result() && step->result()->views.size() == kViews && !step->solving(); }));
  EXPECT_FALSE(step->canGoOn());
  // A view is left out and the lens found anew.
  auto* remove = panel_->findChild<QToolButton*>("view-remove-0");
  ASSERT_NE(remove, nullptr);
  QTest::mouseClick(remove, Qt::LeftButton);
  ASSERT_TRUE(until(
      [&] { return step->result() && step->result()->views.size() == kViews - 1 && !step->solving(); }));
  click("board-keep");
  EXPECT_EQ(step->state(), GuideStep::State::Done);
  EXPECT_TRUE(step->canGoOn());
  keepPictures("rig_checkerboard_done");
  const auto kept = readCalibration(controller_->file("camera"), "camera");
  ASSERT_TRUE(kept.ok()) << kept.error().sentence();
  const StoredCamera& stored = std::get<StoredCamera>(kept->content);
  const Camera& found = stored.camera;
  const Camera truth = rig_->camera();
  std::printf("focal off %.5f %.5f, middle off %.3f %.3f px, RMS %.3f px\n",
              found.intrinsics(0, 0) / truth.intrinsics(0, 0) - 1,
              found.intrinsics(1, 1) / truth.intrinsics(1, 1) - 1,
              found.intrinsics(0, 2) - truth.intrinsics(0, 2),
              found.intrinsics(1, 2) - truth.intrinsics(1, 2), kept->residual);
  for (int axis = 0; axis < 2; ++axis) {
    EXPECT_NEAR(found.intrinsics(axis, axis) / truth.intrinsics(axis, axis), 1, kIntrinsics);
    // The principal point of so narrow a lens is known to about a thousandth of the focal length only: it
    // must be as far off as it says, and say no more than that.
    const double sd = stored.sd[2 + axis];
    EXPECT_NEAR(found.intrinsics(axis, 2), truth.intrinsics(axis, 2), 3.5 * sd);
    EXPECT_LT(sd, 1.1 * kIntrinsics * truth.intrinsics(0, 0));
  }
}

TEST_F(CalibrationSteps, AnEarlierLensIsUsedAgainOnlyWhereAPhotographAgrees) {
  LiveRigSetup setup = deskWith(320, 320);
  setup.camera.intrinsics(0, 0) = setup.camera.intrinsics(1, 1) = 1.2 * 320;
  start(setup);
  Board board;
  board.squaresX = 8, board.squaresY = 6;
  board.dictionary = "4x4_250";
  board.squareMm = 8;
  knowLens(board);
  auto* step = new CheckerboardStep(*controller_);
  panel_->addStep(step);
  panel_->show();
  panel_->enter();
  EXPECT_FALSE(step->canGoOn()) << "not before the recheck";
  const auto hold = [&] {
    controller_->run<Done>(
        "hold",
        [this, board](const JobContext&) -> Status {
          SimulatedHands(rig_).holdBoard(board, 1);
          return Done{};
        },
        [](Status) {});
    return idle();
  };
  // An adapter that stretches the picture.
  const Camera truth = rig_->camera();
  Camera zoomed = truth;
  zoomed.intrinsics(0, 0) *= 1.15;
  rig_->moveCamera(zoomed);
  ASSERT_TRUE(hold());
  click("camera-reuse");
  ASSERT_TRUE(idle());
  EXPECT_EQ(step->state(), GuideStep::State::Failed);
  EXPECT_TRUE(step->said().contains("calibrate the camera again")) << step->said().toStdString();
  keepPictures("rig_recheck_failed");
  rig_->moveCamera(truth);
  ASSERT_TRUE(hold());
  click("camera-reuse");
  ASSERT_TRUE(idle());
  EXPECT_EQ(step->state(), GuideStep::State::Reused) << step->said().toStdString();
  EXPECT_TRUE(step->canGoOn());
}

TEST_F(CalibrationSteps, ALinearCamerasResponseIsStraightAndItsBlackIsFound) {
  LiveRigSetup setup = deskWith(160, 320);
  setup.camera.intrinsics(0, 0) = setup.camera.intrinsics(1, 1) = 1.2 * 160;
  setup.ambient = 0;
  start(setup);
  auto* step = new CameraResponseStep(*controller_);
  panel_->addStep(step);
  panel_->show();
  panel_->enter();
  EXPECT_TRUE(step->canGoOn()) << "a linear camera needs none";
  click("hand-scene");
  ASSERT_TRUE(idle());
  click("response-bracket");
  ASSERT_TRUE(idle());
  ASSERT_NE(step->result(), nullptr) << step->said().toStdString();
  click("hand-cover");
  ASSERT_TRUE(idle());
  click("response-dark");
  ASSERT_TRUE(idle());
  ASSERT_NE(step->dark(), nullptr) << step->said().toStdString();
  // The rig's own pedestal, to a hundredth of a per cent of full scale.
  EXPECT_NEAR(step->dark()->level.mean(), rig_->setup().pedestal, 1e-4);
  EXPECT_EQ(step->state(), GuideStep::State::Done);
  keepPictures("rig_response_done");
}

TEST_F(CalibrationSteps, MirrorFindsScreenAndCamera) {
  start(deskWith(480, 960));
  knowLens();
  auto* step = new MirrorStep(*controller_);
  panel_->addStep(step);
  panel_->show();
  panel_->enter();
  click("hand-mirror");
  ASSERT_TRUE(until(
      [&] {
        return step->sighting() && step->sighting()->found.size() == 2 && step->sighting()->found[0].found &&
               step->sighting()->found[1].found;
      },
      10000))
      << "the boards are not seen";
  keepPictures("rig_mirror");
  click("mirror-take");
  ASSERT_TRUE(idle());
  ASSERT_EQ(step->state(), GuideStep::State::Done) << step->said().toStdString();
  keepPictures("rig_mirror_done");
  const PoseDifference screen = differenceOf(step->result()->screen, rig_->setup().screen);
  const PoseDifference camera = differenceOf(step->result()->camera, rig_->camera());
  std::printf("screen off %.3f degrees %.3f mm (sd %.3f, %.3f), camera %.3f degrees %.3f mm\n",
              screen.angleDeg, screen.distanceMm, step->result()->screenAngleSdDeg,
              step->result()->screenPositionSdMm, camera.angleDeg, camera.distanceMm);
  EXPECT_LT(screen.angleDeg, kScreenDeg);
  EXPECT_LT(screen.distanceMm, kScreenMm);
}

TEST_F(CalibrationSteps, GreysAndWhitePaperFindTheScreensLight) {
  start(deskWith(64, 480));
  CalibrationRecord pose;
  StoredScreenPose placed;
  placed.camera = rig_->camera();
  placed.screen = rig_->setup().screen;
  pose.content = placed;
  pose.residual = 0.1;
  pose.residualUnit = "px";
  pose.taken = std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now());
  ASSERT_TRUE(CalibrationStore(controller_->folder()).keep(pose).ok());
  auto* greys = new ScreenResponseStep(*controller_);
  auto* step = new WhitePaperStep(*controller_);
  panel_->addStep(greys);
  panel_->addStep(step);
  panel_->show();
  panel_->enter();
  click("hand-paper-grey");
  ASSERT_TRUE(idle());
  click("grey-take");
  QTest::qWait(300);
  keepPictures("rig_greys");
  ASSERT_TRUE(idle());
  ASSERT_EQ(greys->state(), GuideStep::State::Done) << greys->said().toStdString();
  EXPECT_NEAR(greys->result()->exponent, rig_->setup().gamma, 0.02);
  keepPictures("rig_greys_done");
  QTest::mouseClick(panel_->nextButton(), Qt::LeftButton);
  click("hand-paper");
  ASSERT_TRUE(idle());
  const Eigen::Array3d albedo = whitePaperAlbedo();
  for (int c = 0; c < 3; ++c) step->albedo(c)->setValue(albedo[c]);
  click("paper-take");
  QTest::qWait(300);
  keepPictures("rig_paper");
  ASSERT_TRUE(idle());
  ASSERT_EQ(step->state(), GuideStep::State::Done) << step->said().toStdString();
  keepPictures("rig_paper_done");
  const auto parts = readRigParts(controller_->folder());
  ASSERT_TRUE(parts.ok()) << parts.error().sentence();
  const auto described = rigFromParts(*parts, 120, 120, "");
  ASSERT_TRUE(described.ok()) << described.error().sentence();
  const ScreenEmission& truth = *rig_->setup().screen.emission;
  const ScreenEmission& found = *described->screen.emission;
  std::printf("sigma off %.4f %.4f, gain %.4f, scale off %.4f\n", found.sigma.x() / truth.sigma.x() - 1,
              found.sigma.y() / truth.sigma.y() - 1, found.gain,
              described->radianceOfFullScaleSecond / rig_->description().radianceOfFullScaleSecond - 1);
  EXPECT_NEAR(found.sigma.x() / truth.sigma.x(), 1, kEmission);
  EXPECT_NEAR(found.sigma.y() / truth.sigma.y(), 1, kEmission);
  EXPECT_NEAR(found.gain * described->radianceOfFullScaleSecond /
                  (truth.gain * rig_->description().radianceOfFullScaleSecond),
              1, kEmission);
}

}  // namespace
}  // namespace patina::test
