// The guided calibration of a rig whose screen lights the sample, and the guided two-shot capture.
#include "app/window/rig/camera_response_step.h"
#include "app/window/rig/checkerboard_step.h"
#include "app/window/rig/mirror_step.h"
#include "app/window/rig/plan_step.h"
#include "app/window/rig/rig_steps.h"
#include "app/window/rig/screen_response_step.h"
#include "app/window/rig/shots_step.h"
#include "app/window/rig/white_paper_step.h"
#include "app/window/rig/white_tile_step.h"
#include "widgets/guide_panel.h"

namespace patina {

void addFourierCalibrationSteps(GuidePanel& panel, RigController& rig) {
  panel.addStep(new CameraResponseStep(rig));
  panel.addStep(new CheckerboardStep(rig));
  panel.addStep(new MirrorStep(rig));
  panel.addStep(new ScreenResponseStep(rig));
  panel.addStep(new WhitePaperStep(rig));
}

void addTwoShotSteps(GuidePanel& panel, RigController& rig) {
  auto* task = new TwoShotTask(rig, &panel);
  panel.addStep(new CameraResponseStep(rig));
  panel.addStep(new CheckerboardStep(rig));
  panel.addStep(new WhiteTileStep(*task));
  panel.addStep(new PlanStep(*task));
  panel.addStep(new ShotsStep(*task));
}

}  // namespace patina
